//! Image features of both states, matched and lifted to 3D.

pub(crate) mod descriptor;
pub(crate) mod features;
pub(crate) mod lift;
pub(crate) mod luma;
pub(crate) mod matcher;
#[cfg(any(feature = "onnx", test))]
pub(crate) mod model_image;
pub(crate) mod scale_space;
