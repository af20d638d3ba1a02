//! An active stereo camera: two infrared images under a projected dot pattern, matched, aligned to color.
//!
//! Nothing here models errors of depth. They come from matching noisy 8-bit images (`census`, `semi_global`,
//! `winner`, `subpixel`, `speckle`) of a rig whose geometry is not quite the nominal one (`rig`).

mod aligned;
mod camera;
mod census;
mod depth_source;
mod infrared;
mod matcher;
mod pattern;
mod rig;
mod semi_global;
mod speckle;
mod subpixel;
mod winner;

pub use camera::StereoCamera;
pub use depth_source::{DepthSource, ParseDepthError};
pub use rig::StereoRig;
