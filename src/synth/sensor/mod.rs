//! A consumer depth camera carried by hand: effects that clean recordings lack, a file each.
//!
//! Each file says how large its effect is at level 1 and where that comes from. Depth that is off by half a
//! percent, poses of an odometry without loop closure, and surroundings without masks are what the program
//! meets in measured recordings; the literature that a file names says what its sizes stand for.

mod bilinear;
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
