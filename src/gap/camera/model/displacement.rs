//! Displacement of the surface due to joints and their errors.

use crate::camera::model::{hypothesis::Hypothesis, twin::SeenTwin};

/// An effect within this many standard deviations of a joint's own error counts as that error.
///
/// chosen: 99.7 % of a normal distribution
const SIGMAS: f64 = 3.0;

/// Displacement of the surface due to the twin's own errors, meters: of the parts moved by a joint, or of all
/// parts (`None`).
pub fn made_m(twin: &SeenTwin, joint: Option<usize>) -> f64 {
    let Some(j) = joint else { return twin.own.surface_m };
    let e = twin.own.joints.get(j).copied().unwrap_or_default();
    (SIGMAS * e.place_m.hypot(e.axis_rad * twin.parts[twin.joints[j].child].radius_m)).max(twin.own.surface_m)
}

/// Largest displacement of a joint's child between two hypotheses, over the runs, meters.
pub fn apart_m(joint: usize, one: (&SeenTwin, &Hypothesis), other: (&SeenTwin, &Hypothesis)) -> f64 {
    let child = one.0.joints[joint].child;
    let part = &one.0.parts[child];
    let mut largest_m = 0.0f64;
    for r in 0..one.1.positions.len() {
        let [a, b] = [one, other].map(|(twin, hypothesis)| hypothesis.part_and_joint_poses(twin, r).0[child]);
        let apart = (a * part.center - b * part.center).norm();
        // A part turning in place moves most at its rim.
        largest_m = largest_m.max(apart.hypot(a.rotation.angle_to(&b.rotation) * part.radius_m));
    }
    largest_m
}

/// Joints moving their child by less than `least_m` over all runs, with this displacement, meters.
pub fn joints_at_rest(twin: &SeenTwin, hypothesis: &Hypothesis, least_m: f64) -> Vec<(usize, f64)> {
    let mut still = Vec::new();
    for (j, joint) in twin.joints.iter().enumerate() {
        let at = (0..hypothesis.positions.len()).map(|r| hypothesis.joint_position(twin, r, j));
        let (low, high) = at.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), q| (l.min(q), h.max(q)));
        let lever = if joint.kind.is_turning() { twin.parts[joint.child].radius_m } else { 1.0 };
        let way_m = (high - low).max(0.0) * lever;
        if way_m < least_m {
            still.push((j, way_m));
        }
    }
    still
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::camera::model::{
        hypothesis::Hypothesis,
        own_error::{JointError, OwnErrors},
        twin::{SeenJoint, SeenPart},
    };
    use geometry::{AxisMotion, Pose};
    use surface::TriangleMesh;

    fn door() -> SeenTwin {
        let part = |name: &str, joint, center: Point3<f64>| SeenPart {
            name: name.into(),
            mesh: TriangleMesh::default(),
            joint,
            center,
            radius_m: 0.4,
        };
        let joint = SeenJoint {
            name: "hinge".into(),
            parent: 0,
            child: 1,
            parent_from_joint: Pose::identity(),
            kind: AxisMotion::Revolute,
            axis: Vector3::z_axis(),
            point: Point3::origin(),
            limit: None,
            mimic: None,
        };
        SeenTwin {
            parts: vec![
                part("base", None, Point3::origin()),
                part("door", Some(0), Point3::new(0.3, 0.0, 0.0)),
            ],
            joints: vec![joint],
            own: OwnErrors::default(),
        }
    }

    #[test]
    fn errors_of_an_axis_move_its_child_by_three_standard_deviations() {
        let mut twin = door();
        assert!(twin.own.is_exact());
        assert_eq!(made_m(&twin, Some(0)), 0.0);
        let joints = vec![JointError { axis_rad: 0.01, place_m: 0.003 }];
        twin.own = OwnErrors { surface_m: 0.001, joints };
        assert!((made_m(&twin, Some(0)) - 0.015).abs() < 1e-12);
        assert_eq!(made_m(&twin, None), 0.001);
        assert!(!twin.own.is_exact());
    }

    #[test]
    fn a_joint_that_stands_still_in_all_runs_is_found() {
        let twin = door();
        let mut hypothesis = Hypothesis::of_twin(&twin, 2);
        (hypothesis.positions[0][0], hypothesis.positions[1][0]) = (0.5, 0.51);
        let found = joints_at_rest(&twin, &hypothesis, 0.01);
        assert!(found.len() == 1 && (found[0].1 - 0.004).abs() < 1e-12, "{found:?}");
        hypothesis.positions[1][0] = 0.6;
        assert!(joints_at_rest(&twin, &hypothesis, 0.01).is_empty());
        let mut other = hypothesis.clone();
        other.positions[1][0] = 0.7;
        let apart = apart_m(0, (&twin, &hypothesis), (&twin, &other));
        assert!((apart - (0.6 * 0.05f64.sin()).hypot(0.04)).abs() < 1e-9, "{apart}");
    }
}
