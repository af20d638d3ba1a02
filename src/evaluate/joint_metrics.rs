//! Errors of a found joint against the true one.

use nalgebra::Point3;
use serde::Serialize;

use super::{run_files::RunFiles, surface_metrics::mean_of, truth::TrueJoint};
use geometry::{Pose, line_distance_m, rotation_angle_rad};

/// One movable part against the truth. Numbers meaningless for the true joint's type are left out, and all
/// numbers if the part was not found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct JointRow {
    /// Name of the true part.
    pub part: String,
    /// True type: `revolute`, `prismatic` or `screw`.
    pub type_true: String,
    /// Whether no found part was matched with this one.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub missing: bool,
    /// Name of the matched joint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint: Option<String>,
    /// Type of the matched joint in the run's file.
    #[serde(rename = "type", skip_serializing_if = "Option::is_none")]
    pub kind: Option<String>,
    /// Whether the found type is the true one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub type_right: Option<bool>,
    /// Angle between the axes regardless of sign, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis_deg: Option<f64>,
    /// Mean displacement of the true part's vertices between the found and the true motion, over all states,
    /// millimeters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error_mm: Option<f64>,
    /// For revolute and screw joints: distance between the axes as lines, millimeters; parallel lines keep
    /// their distance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis_mm: Option<f64>,
    /// For revolute and screw joints: angle between the found and the true rotation to state 1, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion_deg: Option<f64>,
    /// For prismatic joints: length of the difference of the translations to state 1, millimeters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion_mm: Option<f64>,
    /// The same for further states present in both run and truth, degrees or millimeters.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub further_motions: Vec<f64>,
}

impl JointRow {
    /// The row of a part without a match.
    pub fn missing(part: &str, truth: &TrueJoint) -> Self {
        Self { part: part.to_owned(), type_true: truth.kind.clone(), missing: true, ..Self::default() }
    }

    /// The row of a matched part; `error_m` is its mean displacement.
    pub fn matched(part: &str, truth: &TrueJoint, run: &RunFiles, found: usize, error_m: f64) -> Self {
        let kind = run.kind(found);
        let axis = run.axis(found);
        // By the true type, as in the tables: a wrong type only shows in `type_right`.
        let turns = truth.kind != "prismatic";
        let mut motions = Vec::new();
        for (k, t) in truth.motions().take(run.states.len() - 1).enumerate() {
            let m = run.motion(found, k + 1);
            motions.push(if turns {
                rotation_angle_rad(&(m.rotation * t.rotation.inverse())).to_degrees()
            } else {
                1000.0 * (m.translation.vector - t.translation.vector).norm()
            });
        }
        // docs/method.md (13.1) by atan2: the arccosine loses precision at small angles.
        let axis_rad =
            axis.as_ref().map(|(d, _)| d.cross(&truth.axis).norm().atan2(d.dot(&truth.axis).abs()));
        let axis_m = axis.map(|(d, p)| line_distance_m(&p, &d, &truth.origin, &truth.axis));
        Self {
            part: part.to_owned(),
            type_true: truth.kind.clone(),
            missing: false,
            joint: run.tree.joint_of(run.parts[found][0]).map(|j| j.name.clone()),
            kind: Some(kind.to_owned()),
            type_right: Some(kind == truth.kind),
            axis_deg: axis_rad.map(f64::to_degrees),
            error_mm: Some(1000.0 * error_m),
            axis_mm: axis_m.filter(|_| turns).map(|m| 1000.0 * m),
            motion_deg: turns.then(|| motions[0]),
            motion_mm: (!turns).then(|| motions[0]),
            further_motions: motions[1..].to_vec(),
        }
    }
}

/// Mean displacement of points between two motions, meters; `None` without points.
pub(crate) fn displacement_m(points: &[Point3<f32>], a: &Pose, b: &Pose) -> Option<f64> {
    let distances: Vec<f64> =
        points.iter().map(|p| p.cast::<f64>()).map(|p| (a * p - b * p).norm()).collect();
    mean_of(&distances)
}
