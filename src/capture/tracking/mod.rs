//! Camera poses of a recording that has none, by what its frames see of each other. See docs/method.md 2.14.
//!
//! Every frame is placed by keyframes (frame to model): landmarks that look alike give a guess where the
//! camera is, however far it moved; surfels and landmarks together say where exactly; surfaces that
//! contradict each other, or that leave a motion open, say that the frame is lost. Keyframes that see the
//! same again close loops. In the end all keyframes are put together by the equations that also refine
//! reported poses.

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
    imu::Accelerometer,
    live::{LiveTracker, LiveView},
    lost::Lost,
    observation::Observation,
    track::{Track, TrackingFindings},
    tracked_state::TrackedState,
    tracker::Tracker,
};

/// Whether the camera is tracked by what it sees.
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
