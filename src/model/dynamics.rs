//! Friction and damping that the recording implies or that are assumed.

use nalgebra::Vector3;

use super::{ArticulatedModel, JointDynamics, JointKind};
use crate::geometry::Pose;

/// Standard gravity along the world's z axis, m/s^2.
const GRAVITY_M_S2: f64 = 9.80665;
/// Friction against the load that it must hold in the observed states.
const HOLD: f64 = 1.25;
/// Least friction as a share of the child's weight (times its lever for a revolute joint): a drawer on
/// runners, a hinge.
const LEAST_SHARE: f64 = 0.02;
/// A moving part left alone slows down within this time, seconds.
const SLOWING_S: f64 = 0.5;

/// Friction and damping of a joint, from what is known: in each observed state the object was at rest, so
/// friction (or a stop) held the child's weight there; the world's z axis is taken for up. The least friction
/// is 2 % of the weight. Damping stops the moving mass within half a second. Armature and spring are zero
/// until measured. See docs/method.md (10.4).
#[must_use]
pub fn assumed_dynamics(model: &ArticulatedModel, j: usize) -> JointDynamics {
    let joint = &model.joints[j];
    let (mut load, mut inertia, mut weight) = (0.0f64, 0.0f64, 0.0f64);
    for state in &model.states {
        let frame = model.world_from_link(joint.parent, state) * joint.parent_from_joint;
        let axis = frame.rotation * joint.axis.into_inner();
        // Whatever hangs on the child loads the joint, too.
        let below = (0..model.links.len()).filter(|&l| l == joint.child || model.is_below(l, joint.child));
        let (mut torque, mut moved, mut pull) = (0.0, 0.0, 0.0);
        for link in below {
            let (effort, mass, lever_m) = pull_on(model, link, state, &frame, &axis, joint.kind);
            (torque, moved, pull) = (
                torque + effort,
                moved + mass,
                pull + model.links[link].inertial.mass_kg * GRAVITY_M_S2 * lever_m,
            );
        }
        (load, inertia, weight) = (load.max(torque.abs()), inertia.max(moved), weight.max(pull));
    }
    // docs/method.md (10.4), by the worst of the observed states.
    let friction = (HOLD * load).max(LEAST_SHARE * weight);
    JointDynamics {
        friction,
        damping: inertia / SLOWING_S,
        assumption: format!(
            "friction: {HOLD} times the load of gravity (world z is up) in the observed states \
             ({load:.3}), at least {LEAST_SHARE} of the \
             weight; damping: slows down within {SLOWING_S} s (assumed, not measured)"
        ),
        ..JointDynamics::default()
    }
}

/// Effort of a link's weight on a joint, inertia that the joint moves with it, and the lever of its weight (1
/// for a prismatic joint).
fn pull_on(
    model: &ArticulatedModel,
    link: usize,
    state: &[f64],
    frame: &Pose,
    axis: &Vector3<f64>,
    kind: JointKind,
) -> (f64, f64, f64) {
    let inertial = &model.links[link].inertial;
    let world_from_link = model.world_from_link(link, state);
    let arm = (world_from_link * inertial.center_of_mass).coords - frame.translation.vector;
    let weight = Vector3::new(0.0, 0.0, -GRAVITY_M_S2 * inertial.mass_kg);
    match kind {
        JointKind::Prismatic => (axis.dot(&weight), inertial.mass_kg, 1.0),
        JointKind::Revolute | JointKind::Screw { .. } | JointKind::Free { .. } => {
            // Inertia about the axis: that about the center of mass and the distance (parallel axes).
            let across = arm.cross(axis).norm();
            let turned = world_from_link.rotation.inverse() * axis;
            (
                axis.dot(&arm.cross(&weight)),
                turned.dot(&(inertial.inertia * turned)) + inertial.mass_kg * across * across,
                across,
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::example::cabinet;

    #[test]
    fn friction_holds_what_was_seen_at_rest() {
        let mut model = cabinet();
        // A lid: its hinge lies along y, its mass 0.2 m from it.
        model.joints[0].parent_from_joint = Pose::translation(0.0, 0.0, 0.5);
        model.joints[0].axis = Vector3::y_axis();
        model.links[1].inertial.center_of_mass = nalgebra::Point3::new(0.2, 0.0, 0.0);
        model.states = vec![vec![0.0, 0.0], vec![1.25, 0.18]];
        let lid = assumed_dynamics(&model, 0);
        assert!((lid.friction - 1.25 * 1.5 * GRAVITY_M_S2 * 0.2).abs() < 1e-9, "{lid:?}");
        // A drawer that slides level carries no load: the least friction stands.
        model.joints[1].parent_from_joint = Pose::identity();
        model.joints[1].axis = Vector3::x_axis();
        let drawer = assumed_dynamics(&model, 1);
        assert!((drawer.friction - 0.02 * GRAVITY_M_S2).abs() < 1e-9 && (drawer.damping - 2.0).abs() < 1e-9);
    }
}
