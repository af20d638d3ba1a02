//! What is read of the `report.json` of a reconstruction.

use serde::{Deserialize, de::IgnoredAny};

use super::report_json::{SpreadReport, StateReport};

/// What is read of a [`Report`](super::Report), of this version or an earlier one: what is missing is empty,
/// and other keys may hold anything. A whole report is not read: codes come and go, and `null` stands for
/// what is not finite.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct ReadReport {
    /// Name of the object.
    pub name: String,
    /// Joint positions of the observed states.
    pub states: Vec<StateReport>,
    /// Joints.
    pub joints: Vec<ReadJoint>,
    /// As many as there are links.
    pub links: Vec<IgnoredAny>,
    /// As many as there are warnings.
    pub warnings: Vec<IgnoredAny>,
    /// Box about the object in all states, lower and upper corner in the world, meters.
    pub object_box_m: Option<[[f64; 3]; 2]>,
    /// Digest of recordings, settings, seed and version.
    pub fingerprint: String,
}

/// What is read of a joint; `None` for what is not determined.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct ReadJoint {
    /// Name.
    pub name: String,
    /// Link that it moves.
    pub child: String,
    /// Advance along the axis per radian of a screw or free motion.
    pub pitch_m_per_rad: Option<f64>,
    /// Motion between the states.
    pub motion: Option<SpreadReport>,
    /// Standard deviation of the axis' direction, degrees.
    pub axis_std_deg: Option<f64>,
    /// Standard deviation of the axis' place, millimeters.
    pub origin_std_mm: Option<f64>,
    /// Standard deviation of the motion.
    pub motion_std: Option<SpreadReport>,
    /// Root mean square distance of the supporting points after the motion, millimeters.
    pub residual_rms_mm: Option<f64>,
}
