//! The messages of the services and actions, as `msg/` defines them.

use ros2_client::Message;
use serde::{Deserialize, Serialize};

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
    /// The action done, or the reason against it.
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
    /// The action done, or the reason against it.
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
    /// The present activity.
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
    /// The action done, or the reason against it.
    pub message: String,
}

/// Goal of `artitwin_msgs/action/Diagnose`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DiagnoseGoal {
    /// URDF; empty: the node's last twin.
    pub twin: String,
    /// Bags with `sensor_msgs/JointState`.
    pub runs: Vec<String>,
    /// Bags for the proof alone; empty: every third run.
    pub held_out: Vec<String>,
    /// In the root's frame, m/s^2; all 0: earth's, down z.
    pub gravity: [f64; 3],
    /// Whether the effort runs straight to the next sample; else it is held.
    pub linear_effort: bool,
    /// Of the permutation tests.
    pub seed: u64,
}

/// Result of `artitwin_msgs/action/Diagnose`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnoseResult {
    /// Whether there is a report.
    pub success: bool,
    /// The finding, or the reason against one.
    pub message: String,
    /// Folder of the result.
    pub folder: String,
    /// Over all joints.
    pub verdict: String,
}

/// Feedback of `artitwin_msgs/action/Diagnose`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DiagnoseFeedback {
    /// The present activity.
    pub stage: String,
    /// Of the joints, 0 to 1.
    pub fraction: f32,
    /// NaN until a joint is done.
    pub seconds_left: f64,
}

impl Message for SetStateRequest {}
impl Message for SetStateResponse {}
impl Message for ReconstructGoal {}
impl Message for ReconstructResult {}
impl Message for ReconstructFeedback {}
impl Message for TriggerRequest {}
impl Message for TriggerResponse {}
impl Message for DiagnoseGoal {}
impl Message for DiagnoseResult {}
impl Message for DiagnoseFeedback {}
