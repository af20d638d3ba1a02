//! A joint with another type in the frames than in the twin.

use nalgebra::{DVector, Point3, Unit, Vector3};

use crate::{
    camera::{
        fit::problem::FrameProblem,
        judge::{
            finding::{CameraFinding, Subject},
            select::Selected,
        },
        model::parameter::HypothesisParameter,
    },
    judge::finding::{Finding, ParameterEstimate},
};
use geometry::{AxisMotion, normals_of};
use numeric::statistics::HALF_WIDTH_95;

/// Index in reports, after the catalogue's effects.
const INDEX: usize = 100;

/// A joint with another type in the frames than in the twin.
#[derive(Clone, Debug, PartialEq)]
pub struct TypeChange {
    /// Joint.
    pub joint: usize,
    /// Type in the twin.
    pub from: AxisMotion,
    /// Type found in the frames.
    pub to: AxisMotion,
    /// Axis in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// A point of the axis in the joint frame, meters.
    pub point: Point3<f64>,
    /// Mean cost of the pixels with the twin's type and with the new one.
    pub cost: [f64; 2],
}

/// Half the width of the 95 % interval of a linear combination of the trials' parameters, with factors
/// `weight`.
fn half_width(problem: &FrameProblem, freed: &Selected, weight: impl Fn(HypothesisParameter) -> f64) -> f64 {
    let mut weights = DVector::zeros(freed.chosen.solution.values.len());
    let columns = freed.chosen.set.iter().flat_map(|&t| &problem.trials[t].columns);
    for (w, c) in weights.iter_mut().skip(problem.nuisance.len()).zip(columns) {
        *w = weight(c.parameter);
    }
    HALF_WIDTH_95 * weights.dot(&(&freed.chosen.solution.covariance * &weights)).max(0.0).sqrt()
}

impl TypeChange {
    /// Trials freeing the law of the joint: its axis, and the pitch of a screw.
    pub fn freeing_trials(&self, problem: &FrameProblem) -> Vec<usize> {
        let of =
            |name: &str| problem.trials.iter().position(|t| t.joint == Some(self.joint) && t.name == name);
        let pitch = if matches!(self.to, AxisMotion::Screw { .. }) { of("wrong_joint_type") } else { None };
        of("axis_offset").into_iter().chain(pitch).collect()
    }

    /// The finding, with law and intervals from a selection with this law free.
    pub fn as_finding(&self, problem: &FrameProblem, freed: &Selected) -> CameraFinding {
        let law = freed.state.hypothesis.laws[self.joint];
        let normals = normals_of(&law.axis);
        let joint = self.joint;
        let mut parameters = Vec::new();
        for (k, name) in ["axis_x", "axis_y", "axis_z"].into_iter().enumerate() {
            let half = half_width(problem, freed, |p| match p {
                // A turn about one normal moves the axis along the other.
                HypothesisParameter::AxisTurn(j, n) if j == joint => normals[n].cross(&law.axis)[k],
                _ => 0.0,
            });
            parameters.push(ParameterEstimate::with_half_width(name, law.axis[k], "1", half));
        }
        if self.to.is_turning() {
            // The axis point nearest the part's center: turns of the axis do not move it there.
            let center = problem.twin.parts[problem.twin.joints[joint].child].center;
            let point = law.point + law.axis.into_inner() * law.axis.dot(&(center - law.point));
            for (k, name) in ["x", "y", "z"].into_iter().enumerate() {
                let half = half_width(problem, freed, |p| match p {
                    HypothesisParameter::AxisShift(j, n) if j == joint => normals[n][k],
                    _ => 0.0,
                });
                parameters.push(ParameterEstimate::with_half_width(name, point[k], "m", half));
            }
        }
        if let AxisMotion::Screw { pitch_m_per_rad } = law.kind {
            let half =
                half_width(problem, freed, |p| f64::from(u8::from(p == HypothesisParameter::Pitch(joint))));
            parameters.push(ParameterEstimate::with_half_width("pitch", pitch_m_per_rad, "m/rad", half));
        }
        let finding = Finding {
            index: INDEX,
            effect: "wrong_joint_type".into(),
            parameters,
            weight: 1.0,
            alternatives: Vec::new(),
            experiment: "film the joint at three more positions over its whole range".into(),
            is_sure: true,
        };
        CameraFinding {
            subject: Subject::Joint(self.joint),
            finding,
            types: Some([self.from.name(), self.to.name()]),
            in_urdf: "native",
        }
    }
}
