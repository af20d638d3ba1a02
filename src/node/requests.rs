//! Messages of the services and actions, as defined in `msg/`.

use serde::{Deserialize, Serialize};

/// Request of `artitwin_msgs/srv/SetState`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetStateRequest {
    /// Index of the state, 0 or 1.
    pub state: u8,
}

/// Response of `artitwin_msgs/srv/SetState`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetStateResponse {
    /// Whether it succeeded.
    pub success: bool,
    /// What was done, or why not.
    pub message: String,
    /// Number of views kept in this state.
    pub keyframes: u32,
}

/// Goal of `artitwin_msgs/action/Reconstruct`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReconstructGoal {
    /// Number of rigid parts, the static one included; 0: the parameter.
    pub parts: u32,
    /// Name of the twin; empty: the parameter.
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
    /// Per joint, position in state 1 minus position in state 0, radians or meters.
    pub motions: Vec<f64>,
}

/// Feedback of `artitwin_msgs/action/Reconstruct`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReconstructFeedback {
    /// Current stage.
    pub stage: String,
    /// Progress of the whole, 0 to 1.
    pub fraction: f32,
    /// Current loss; NaN in stages without one.
    pub loss: f64,
    /// Estimated time to the end; NaN while unknown.
    pub seconds_left: f64,
}

/// Request of `std_srvs/srv/Trigger`; it is empty, but CDR has no empty structs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerRequest {
    /// Unused.
    pub structure_needs_at_least_one_member: u8,
}

/// Response of `std_srvs/srv/Trigger`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerResponse {
    /// Whether it succeeded.
    pub success: bool,
    /// What was done, or why not.
    pub message: String,
}

/// Goal of `artitwin_msgs/action/Diagnose`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DiagnoseGoal {
    /// URDF file; empty: the node's last twin.
    pub twin: String,
    /// Bags with `sensor_msgs/JointState`.
    pub runs: Vec<String>,
    /// Bags used only to confirm the result; empty: every third run.
    pub held_out: Vec<String>,
    /// Gravity in the root's frame, m/s^2; all 0: standard gravity along -z.
    pub gravity: [f64; 3],
    /// Whether efforts are samples of a smooth signal; else the runs decide.
    pub linear_effort: bool,
    /// Seed of the permutation tests.
    pub seed: u64,
}

/// Result of `artitwin_msgs/action/Diagnose`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnoseResult {
    /// Whether there is a report.
    pub success: bool,
    /// The result, or why there is none.
    pub message: String,
    /// Folder of the result.
    pub folder: String,
    /// Verdict over all joints.
    pub verdict: String,
}

/// Feedback of `artitwin_msgs/action/Diagnose`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DiagnoseFeedback {
    /// Current stage.
    pub stage: String,
    /// Share of the joints that are done, 0 to 1.
    pub fraction: f32,
    /// Estimated time to the end; NaN until a joint is done.
    pub seconds_left: f64,
}
