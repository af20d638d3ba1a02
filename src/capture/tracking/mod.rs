//! Camera poses of a recording without any, by its frames alone. See docs/method.md 2.14.
//!
//! Every frame is placed by keyframes (frame to model): similar landmarks give a guess of the camera's place,
//! after any motion; surfels and landmarks together give it exactly; with contradicting surfaces, or an open
//! motion, the frame is lost. Keyframes with known surface close loops. In the end all keyframes are put
//! together by the equations of the refinement of reported poses.

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
mod track;
mod tracked_state;
mod tracker;

use serde::{Deserialize, Serialize};

pub use self::{
    between::{Unaligned, align_tracks},
    gravity::{UpBy, Upright},
    imu::{Accelerometer, MeasuredUp, NoGravity},
    live::{LiveTracker, LiveView},
    lost::Lost,
    observation::Observation,
    track::{Track, TrackingFindings},
    tracked_state::TrackedState,
    tracker::Tracker,
};

/// Whether the camera is tracked by its images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrackCamera {
    /// Where the recording holds no camera poses.
    #[default]
    Auto,
    /// Also where it does.
    Always,
    /// A recording without camera poses is refused.
    Never,
}

#[cfg(test)]
mod tests;
