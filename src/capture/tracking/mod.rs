//! Camera tracking by images and depth, for recordings without camera poses. See docs/method.md 2.14.
//!
//! Every frame is located relative to keyframes (frame to model). Matching landmarks give an approximate pose
//! after any motion; surfels and landmarks together refine it. If surfaces contradict each other or leave a
//! motion undetermined, the frame is lost. Keyframes that see known surface again close loops. Finally all
//! keyframes are adjusted jointly, by the equations of the correction of reported poses.

mod adjust;
mod between;
mod closure;
mod gravity;
mod imu;
mod keyframes;
mod landmark_motion;
mod live;
mod locate;
mod lost;
mod observation;
mod pose_graph;
mod seen_motion;
mod track;
mod tracked_state;
mod tracker;
mod world_up;

use serde::{Deserialize, Serialize};

pub use self::{
    between::{Unaligned, align_tracks},
    gravity::{UpBy, Upright},
    imu::{Accelerometer, MeasuredUp, NoGravity},
    live::{LiveTracker, LiveView},
    lost::Lost,
    observation::Observation,
    seen_motion::seen_motion,
    track::{Track, TrackingFindings},
    tracked_state::TrackedState,
    tracker::Tracker,
    world_up::{WorldUp, world_up},
};

/// Whether the camera is tracked by its images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrackCamera {
    /// If the recording holds no camera poses.
    #[default]
    Auto,
    /// Also if it does.
    Always,
    /// Not at all: recordings without camera poses are refused.
    Never,
}

#[cfg(test)]
mod tests;
