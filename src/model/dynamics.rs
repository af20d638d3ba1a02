//! Friction and damping of joints, implied by the recording or assumed.

use nalgebra::Vector3;

use super::{ArticulatedModel, JointDynamics, JointKind};
use geometry::Pose;

/// Standard gravity along the world's z axis, m/s^2. derived: the standard value
const GRAVITY_M_S2: f64 = 9.80665;
/// Ratio of friction to the load it holds in the observed states.
/// chosen: an assumption, stated in the files (docs/method.md 10)
const HOLD: f64 = 1.25;
/// Least friction as a share of the child's weight (times its lever for a turning joint, with the advance per
/// radian for a thread): a drawer on runners, a hinge.
/// chosen: an assumption, stated in the files (docs/method.md 10)
const LEAST_SHARE: f64 = 0.02;
/// Time within which a moving part left alone slows down, seconds.
/// chosen: an assumption, stated in the files (docs/method.md 10)
const SLOWING_S: f64 = 0.5;

/// Gravity and inertia at a joint: the largest over the observed states, with the world's z axis up. Efforts
/// are in N m where the joint turns and in N where it slides.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointLoad {
    /// Effort of gravity.
    pub effort: f64,
    /// Moving inertia, kg m^2 or kg.
    pub inertia: f64,
    /// Effort of the child's weight at its lever, whatever the direction of the axis.
    pub weight: f64,
}

/// Friction and damping of a joint from the observed states: the object was at rest in each, so friction (or
/// a stop) held the child's weight there; the world's z axis is taken as up. Friction is at least 2 % of the
/// weight. Damping stops the moving mass within half a second. Armature and spring are zero until measured.
/// See docs/method.md (10.4).
pub fn assumed_dynamics(model: &ArticulatedModel, j: usize) -> JointDynamics {
    let JointLoad { effort: load, inertia, weight } = joint_load(model, j);
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

/// Load of a joint in the observed states.
pub fn joint_load(model: &ArticulatedModel, j: usize) -> JointLoad {
    let joint = &model.joints[j];
    let mut most = JointLoad::default();
    for state in &model.states {
        let frame = model.world_from_link(joint.parent, state) * joint.parent_from_joint;
        let axis = frame.rotation * joint.axis.into_inner();
        // Links below the child also load the joint.
        let below = (0..model.links.len()).filter(|&l| l == joint.child || model.is_below(l, joint.child));
        let mut all = JointLoad::default();
        for link in below {
            let one = pull_of(model, link, state, &frame, &axis, joint.kind);
            all = JointLoad {
                effort: all.effort + one.effort,
                inertia: all.inertia + one.inertia,
                weight: all.weight + one.weight,
            };
        }
        most = JointLoad {
            effort: most.effort.max(all.effort.abs()),
            inertia: most.inertia.max(all.inertia),
            weight: most.weight.max(all.weight),
        };
    }
    most
}

/// Load of one link at a joint in a state.
fn pull_of(
    model: &ArticulatedModel,
    link: usize,
    state: &[f64],
    frame: &Pose,
    axis: &Vector3<f64>,
    kind: JointKind,
) -> JointLoad {
    let inertial = &model.links[link].inertial;
    let world_from_link = model.world_from_link(link, state);
    let arm = (world_from_link * inertial.center_of_mass).coords - frame.translation.vector;
    let mass_kg = inertial.mass_kg;
    let weight_n = GRAVITY_M_S2 * inertial.mass_kg;
    let weight = Vector3::new(0.0, 0.0, -weight_n);
    if !kind.turns() {
        return JointLoad { effort: axis.dot(&weight), inertia: mass_kg, weight: weight_n };
    }
    // Inertia about the axis: about the center of mass, and the distance (parallel axes). A thread also lifts
    // the link by its pitch, by virtual work at the turn.
    let across = arm.cross(axis).norm();
    let pitch = kind.pitch_m_per_rad().unwrap_or(0.0);
    let turned = world_from_link.rotation.inverse() * axis;
    JointLoad {
        effort: axis.dot(&arm.cross(&weight)) + pitch * axis.dot(&weight),
        inertia: turned.dot(&(inertial.inertia * turned)) + mass_kg * (across * across + pitch * pitch),
        weight: weight_n * (across + pitch.abs()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example::cabinet;

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

    #[test]
    fn friction_of_a_thread_holds_what_it_lifts() {
        let mut model = cabinet();
        model.joints[1].kind = JointKind::Screw { pitch_m_per_rad: -0.012 };
        model.joints[1].parent_from_joint = Pose::identity();
        model.joints[1].axis = Vector3::z_axis();
        model.links[2].inertial.center_of_mass = nalgebra::Point3::new(0.0, 0.0, 0.1);
        let upright = assumed_dynamics(&model, 1);
        assert!((upright.friction - 1.25 * GRAVITY_M_S2 * 0.012).abs() < 1e-9, "{upright:?}");
        let about_z = model.links[2].inertial.inertia[(2, 2)];
        assert!((upright.damping - 2.0 * (about_z + 0.012 * 0.012)).abs() < 1e-9, "{upright:?}");
        // Lying, it lifts nothing: the least friction stands, and is not nothing.
        model.joints[1].axis = Vector3::x_axis();
        model.links[2].inertial.center_of_mass = nalgebra::Point3::new(0.1, 0.0, 0.0);
        let lying = assumed_dynamics(&model, 1);
        assert!((lying.friction - 0.02 * GRAVITY_M_S2 * 0.012).abs() < 1e-9, "{lying:?}");
    }
}
