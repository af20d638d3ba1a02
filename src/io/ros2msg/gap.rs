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
    /// Unit of these three numbers.
    pub unit: String,
}

/// `artitwin_msgs/msg/GapFinding`: a missing effect of a twin.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GapFinding {
    /// Name of the joint.
    pub joint: String,
    /// Name of the effect.
    pub effect: String,
    /// Weight relative to its alternatives, 0 to 1.
    pub weight: f64,
    /// Its parameters.
    pub parameters: Vec<GapParameter>,
}

/// `artitwin_msgs/msg/GapReport`: the findings of a diagnosis.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GapReport {
    /// Stamp of the report.
    pub header: Header,
    /// The diagnosed URDF.
    pub twin: String,
    /// Folder of the result.
    pub folder: String,
    /// `none`, `named`, `ambiguous`, `unknown` or `insufficient`.
    pub verdict: String,
    /// Effects with their parameters.
    pub findings: Vec<GapFinding>,
    /// Root mean square residual on held-out runs, NaN where there are none.
    pub gap_before: f64,
    /// The same for the updated twin.
    pub gap_after: f64,
    /// The residual that the recording's noise explains.
    pub noise_floor: f64,
    /// Unit of these three numbers, `rad` or `m`.
    pub unit: String,
    /// A summary for people.
    pub summary: String,
    /// Text of `report.json`.
    pub report: String,
}
