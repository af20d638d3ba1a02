//! Model of a handheld consumer depth camera: effects beyond recordings without errors, one file each.
//!
//! Each file states the size of its effect at level 1 and where it comes from. Depth errors of half a
//! percent, poses from odometry without loop closure, and surroundings without masks are usual in real
//! recordings.

mod camera;
mod clutter;
mod color_shift;
mod depth_loss;
mod depth_noise;
mod depth_scale;
mod depth_warp;
mod effect;
mod exposure;
mod flying_pixels;
mod hand;
mod handheld;
mod highlights;
mod lamp;
mod motion_blur;
mod pose_drift;
mod pose_jitter;
mod pose_lag;
mod relocalization;
#[cfg(test)]
mod test_view;
mod vignetting;

pub use camera::{HandheldCamera, TakePoses};
pub use effect::Effect;
pub use handheld::HandheldSensor;
