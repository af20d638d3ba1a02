//! The parts of a reconstruction's `report.json` that later commands read.

use serde::{Deserialize, de::IgnoredAny};

use super::report_json::{SpreadReport, StateReport};

/// The parts of a [`Report`](super::Report) that are read, from this version or an earlier one. Missing keys
/// are empty, and other keys may hold anything. A whole report is not read, as codes come and go and `null`
/// replaces numbers that are not finite.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct ReadReport {
    /// Name of the object.
    pub name: String,
    /// Joint positions of the observed states.
    pub states: Vec<StateReport>,
    /// Joints.
    pub joints: Vec<ReadJoint>,
    /// Only their number is used.
    pub links: Vec<IgnoredAny>,
    /// Only their number is used.
    pub warnings: Vec<IgnoredAny>,
    /// Bounding box of the object over all states, lower and upper corner in the world, meters.
    pub object_box_m: Option<[[f64; 3]; 2]>,
    /// Digest of recordings, settings, seed and version.
    pub fingerprint: String,
}

/// The parts of a joint that are read; `None` for what is not determined.
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
    /// Standard deviation of the axis line's place, millimeters.
    pub origin_std_mm: Option<f64>,
    /// Standard deviation of the motion.
    pub motion_std: Option<SpreadReport>,
    /// Root mean square distance of the supporting points after the motion, millimeters.
    pub residual_rms_mm: Option<f64>,
}
