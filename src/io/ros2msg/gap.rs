//! The messages of a diagnosis, as `msg/` defines them.

use serde::{Deserialize, Serialize};

use super::Header;

/// `artitwin_msgs/msg/GapParameter`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GapParameter {
    /// Its name.
    pub name: String,
    /// Estimate.
    pub value: f64,
    /// Lower end of the 95 % interval.
    pub lower: f64,
    /// Upper end of the 95 % interval.
    pub upper: f64,
    /// Of the three.
    pub unit: String,
}

/// `artitwin_msgs/msg/GapFinding`: an effect that a twin lacks.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GapFinding {
    /// Where.
    pub joint: String,
    /// Its name.
    pub effect: String,
    /// Against its alternatives, 0 to 1.
    pub weight: f64,
    /// Its parameters.
    pub parameters: Vec<GapParameter>,
}

/// `artitwin_msgs/msg/GapReport`: what a diagnosis found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GapReport {
    /// When.
    pub header: Header,
    /// The URDF that was diagnosed.
    pub twin: String,
    /// Folder of the result.
    pub folder: String,
    /// `none`, `named`, `ambiguous`, `unknown` or `insufficient`.
    pub verdict: String,
    /// Effects with their parameters.
    pub findings: Vec<GapFinding>,
    /// Root mean square residual on held-out runs, NaN where there are none.
    pub gap_before: f64,
    /// The same of the updated twin.
    pub gap_after: f64,
    /// What the recording's noise explains.
    pub noise_floor: f64,
    /// Of the three, `rad` or `m`.
    pub unit: String,
    /// For people.
    pub summary: String,
    /// `report.json`.
    pub report: String,
}

/// Goal of `artitwin_msgs/action/Diagnose`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DiagnoseGoal {
    /// URDF; empty: the twin that the node made last.
    pub twin: String,
    /// Bags with `sensor_msgs/JointState`.
    pub runs: Vec<String>,
    /// Bags that the proof alone reads; empty: every third run.
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
    /// What was found, or why nothing.
    pub message: String,
    /// Folder of the result.
    pub folder: String,
    /// Over all joints.
    pub verdict: String,
}

/// Feedback of `artitwin_msgs/action/Diagnose`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DiagnoseFeedback {
    /// What is being done.
    pub stage: String,
    /// Of the joints, 0 to 1.
    pub fraction: f32,
    /// NaN until a joint is done.
    pub seconds_left: f64,
}
