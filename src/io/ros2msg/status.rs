//! The project's own messages, as `msg/` defines them.

use serde::{Deserialize, Serialize};

use super::Header;

/// `artitwin_msgs/msg/CollectionStatus`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CollectionStatus {
    /// When.
    pub header: Header,
    /// 0 idle, 1 collecting, 2 moving, 3 ready, 4 reconstructing, 5 done.
    pub phase: u8,
    /// State being collected, or collected last.
    pub state: u8,
    /// Kept in each state.
    pub keyframes: [u32; 2],
    /// Sets of images that belong together, since the last reset.
    pub matched: u64,
    /// Images without partner, since the last reset.
    pub unmatched: u64,
    /// Folder of the recordings.
    pub session: String,
    /// Whether the camera is tracked by what it sees.
    pub tracked: bool,
    /// Placed by tracking.
    pub views_per_second: f32,
    /// Share of the surface that the last view and the map see alike; 0: lost.
    pub inliers: f32,
    /// Standard deviation of the last view's place, meters; infinite: lost.
    pub position_error: f32,
    /// What to do; empty: go on.
    pub hint: String,
}

/// Request of `artitwin_msgs/srv/SetState`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetStateRequest {
    /// 0 or 1.
    pub state: u8,
}

/// Response of `artitwin_msgs/srv/SetState`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetStateResponse {
    /// Whether it was done.
    pub success: bool,
    /// What was done, or why not.
    pub message: String,
    /// Kept in this state.
    pub keyframes: u32,
}

/// Goal of `artitwin_msgs/action/Reconstruct`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReconstructGoal {
    /// Rigid parts, the static one included; 0: the parameter.
    pub parts: u32,
    /// Of the twin; empty: the parameter.
    pub name: String,
}

/// Result of `artitwin_msgs/action/Reconstruct`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReconstructResult {
    /// Whether there is a twin.
    pub success: bool,
    /// What was done, or why not.
    pub message: String,
    /// The run folder.
    pub folder: String,
    /// Names of the joints.
    pub joints: Vec<String>,
    /// Position in state 1 minus position in state 0, radians or meters.
    pub motions: Vec<f64>,
}

/// Feedback of `artitwin_msgs/action/Reconstruct`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReconstructFeedback {
    /// What is being done.
    pub stage: String,
    /// Of the whole, 0 to 1.
    pub fraction: f32,
    /// NaN where the stage has none.
    pub loss: f64,
    /// Of the whole; NaN where it is not known yet.
    pub seconds_left: f64,
}

/// Request of `std_srvs/srv/Trigger`: empty, but CDR has no empty structs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerRequest {
    /// Unused.
    pub structure_needs_at_least_one_member: u8,
}

/// Response of `std_srvs/srv/Trigger`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerResponse {
    /// Whether it was done.
    pub success: bool,
    /// What was done, or why not.
    pub message: String,
}
