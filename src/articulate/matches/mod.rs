//! Matches of two states, lifted to 3D.

pub(crate) mod lift;
#[cfg(any(feature = "onnx", test))]
pub mod model_image;

#[cfg(test)]
mod matched_scenes_tests;
