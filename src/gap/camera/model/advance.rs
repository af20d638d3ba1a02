//! Adds increments of parameters to a hypothesis.

use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::camera::model::{
    hypothesis::{Hypothesis, MotionLaw},
    parameter::{HypothesisParameter, unit_component},
    small_motion::small_motion,
    twin::SeenTwin,
};
use geometry::{AxisMotion, Pose, normals_of};

/// Adds parameter increments to a hypothesis. All are taken about its poses at the start.
pub fn advance_hypothesis(
    hypothesis: &mut Hypothesis,
    twin: &SeenTwin,
    steps: &[(HypothesisParameter, f64)],
) {
    // The increments of one solution are consistent only about the state they were solved for.
    let start = hypothesis.clone();
    let poses: Vec<_> = (0..start.positions.len()).map(|r| start.part_and_joint_poses(twin, r)).collect();
    for &(parameter, x) in steps {
        match parameter {
            HypothesisParameter::Root(run, k) => {
                let by = component_motion_about(&poses[run].0[0], twin.parts[0].center, k, x);
                hypothesis.world_from_root[run] = by * hypothesis.world_from_root[run];
            }
            HypothesisParameter::Position(run, joint) => hypothesis.positions[run][joint] += x,
            HypothesisParameter::EncoderBias(joint) => {
                hypothesis.positions.iter_mut().for_each(|p| p[joint] += x)
            }
            HypothesisParameter::EncoderScale(joint) => {
                hypothesis.positions.iter_mut().for_each(|p| p[joint] *= 1.0 + x)
            }
            HypothesisParameter::Extrinsic(k) => {
                hypothesis.camera.reported_from_true *= component_motion(k, x)
            }
            HypothesisParameter::DepthScale => hypothesis.camera.scale += x,
            HypothesisParameter::DepthBias => hypothesis.camera.bias_m += x,
            HypothesisParameter::Delay => hypothesis.camera.delay_s += x,
            HypothesisParameter::AxisTurn(joint, _)
            | HypothesisParameter::AxisShift(joint, _)
            | HypothesisParameter::Frame(joint, _)
            | HypothesisParameter::Pitch(joint) => {
                let center = twin.parts[twin.joints[joint].child].center;
                advance_law(&mut hypothesis.laws[joint], &start.laws[joint], &center, parameter, x);
            }
            HypothesisParameter::Extra(run, joint, k) => {
                let child = twin.joints[joint].child;
                let frame = &poses[run].1[joint];
                let center = frame.inverse_transform_point(&(poses[run].0[child] * twin.parts[child].center));
                let by = component_motion_about(&Pose::identity(), center, k, x);
                hypothesis.extra[run][joint] = by * hypothesis.extra[run][joint];
            }
            // Meshes stay: their placement only absorbs errors of a reconstruction.
            HypothesisParameter::Mesh(..) => {}
        }
    }
}

/// Adds an increment to the law of a joint; `center` is the child's center; directions are those of the law
/// at the start of the step.
fn advance_law(
    law: &mut MotionLaw,
    start: &MotionLaw,
    center: &Point3<f64>,
    parameter: HypothesisParameter,
    x: f64,
) {
    let [u, v] = normals_of(&start.axis);
    match parameter {
        HypothesisParameter::AxisTurn(_, k) => {
            // About the axis point nearest the child, where turning and shifting the axis are least coupled.
            let pivot = start.point + start.axis.into_inner() * start.axis.dot(&(center - start.point));
            let turn = UnitQuaternion::from_scaled_axis([u, v][k] * x);
            law.axis = turn * law.axis;
            law.point = pivot + turn * (law.point - pivot);
        }
        HypothesisParameter::AxisShift(_, k) => law.point += [u, v][k] * x,
        HypothesisParameter::Frame(_, k) => {
            let e = [u, v, start.axis.into_inner(), u, v][k] * x;
            law.frame *= if k < 3 {
                Pose::from_parts(e.into(), UnitQuaternion::identity())
            } else {
                let r = UnitQuaternion::from_scaled_axis(e);
                // Rotation about a fixed point of the axis.
                Pose::from_parts((start.point.coords - r * start.point.coords).into(), r)
            };
        }
        HypothesisParameter::Pitch(_) if law.kind.is_turning() => {
            let before =
                if let AxisMotion::Screw { pitch_m_per_rad } = law.kind { pitch_m_per_rad } else { 0.0 };
            law.kind = AxisMotion::Screw { pitch_m_per_rad: before + x };
        }
        _ => {}
    }
}

/// A shift or turn by `x` in component `k`.
fn component_motion(k: usize, x: f64) -> Pose {
    let (e, turns) = unit_component(k);
    let zero = Vector3::zeros();
    if turns { small_motion(&zero, &(e * x)) } else { small_motion(&(e * x), &zero) }
}

/// The same in a given frame; turns are about `center` in that frame.
fn component_motion_about(frame: &Pose, center: Point3<f64>, k: usize, x: f64) -> Pose {
    let (e, turns) = unit_component(k);
    let e = frame.rotation * e * x;
    if !turns {
        return small_motion(&e, &Vector3::zeros());
    }
    let r = UnitQuaternion::from_scaled_axis(e);
    let c = frame * center;
    Pose::from_parts((c.coords - r * c.coords).into(), r)
}
