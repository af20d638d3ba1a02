//! Errors that a twin has of itself, because it was reconstructed: what frames show within them is no change of the object.

use super::twin::{Hypothesis, SeenTwin};

/// Standard deviations of a joint within which an effect counts as the twin's own error.
const SIGMAS: f64 = 3.0;

/// How well a twin is known; all zero for one that is taken as exact.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OwnErrors {
    /// Root mean square by which its surfaces in different states miss each other, metres.
    pub surface_m: f64,
    /// Of its joints, in their order; none where they are exact.
    pub joints: Vec<JointError>,
}

/// Standard deviations of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointError {
    /// Of its axis' direction, radians.
    pub axis_rad: f64,
    /// Of its axis' place, metres.
    pub place_m: f64,
}

impl OwnErrors {
    /// Whether the twin is taken as exact.
    #[must_use]
    pub fn is_exact(&self) -> bool {
        *self == Self::default()
    }

    /// What the errors can move of what is seen, metres: of the parts behind a joint, or of everything (`None`).
    #[must_use]
    pub fn made_m(&self, twin: &SeenTwin, joint: Option<usize>) -> f64 {
        let Some(j) = joint else { return self.surface_m };
        let e = self.joints.get(j).copied().unwrap_or_default();
        (SIGMAS * e.place_m.hypot(e.axis_rad * twin.parts[twin.joints[j].child].radius_m)).max(self.surface_m)
    }
}

/// How far two hypotheses put a joint's child apart, in the run where that is farthest, metres.
#[must_use]
pub fn apart_m(joint: usize, one: (&SeenTwin, &Hypothesis), other: (&SeenTwin, &Hypothesis)) -> f64 {
    let child = one.0.joints[joint].child;
    let part = &one.0.parts[child];
    let of = |r: usize| {
        let [a, b] = [one, other].map(|(twin, hypothesis)| hypothesis.poses(twin, r).0[child]);
        let apart = (a * part.center - b * part.center).norm();
        apart.hypot(a.rotation.angle_to(&b.rotation) * part.radius_m)
    };
    (0..one.1.positions.len()).map(of).fold(0.0, f64::max)
}

/// Joints that stand at one place in all runs, with the way of their child between the runs, metres: below `least_m`.
#[must_use]
pub fn still(twin: &SeenTwin, hypothesis: &Hypothesis, least_m: f64) -> Vec<(usize, f64)> {
    let way = |j: usize| {
        let at = (0..hypothesis.positions.len()).map(|r| hypothesis.position(twin, r, j));
        let (low, high) = at.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), q| (l.min(q), h.max(q)));
        let lever = if twin.joints[j].hinge.turns() { twin.parts[twin.joints[j].child].radius_m } else { 1.0 };
        (high - low).max(0.0) * lever
    };
    (0..twin.joints.len()).map(|j| (j, way(j))).filter(|(_, m)| *m < least_m).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::{
        gap::camera::twin::{Hinge, SeenJoint, SeenPart},
        geometry::Pose,
        surface::TriangleMesh,
    };

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
            hinge: Hinge::Revolute,
            axis: Vector3::z_axis(),
            point: Point3::origin(),
            limit: None,
            mimic: None,
        };
        SeenTwin {
            parts: vec![part("base", None, Point3::origin()), part("door", Some(0), Point3::new(0.3, 0.0, 0.0))],
            joints: vec![joint],
            own: OwnErrors::default(),
        }
    }

    #[test]
    fn errors_of_an_axis_move_its_child_by_three_standard_deviations() {
        let twin = door();
        let own = OwnErrors { surface_m: 0.001, joints: vec![JointError { axis_rad: 0.01, place_m: 0.003 }] };
        assert!((own.made_m(&twin, Some(0)) - 0.015).abs() < 1e-12);
        assert_eq!(own.made_m(&twin, None), 0.001);
        assert_eq!(OwnErrors::default().made_m(&twin, Some(0)), 0.0);
        assert!(twin.own.is_exact() && !own.is_exact());
    }

    #[test]
    fn a_joint_that_stands_still_in_all_runs_is_told() {
        let twin = door();
        let mut hypothesis = Hypothesis::of(&twin, 2);
        (hypothesis.positions[0][0], hypothesis.positions[1][0]) = (0.5, 0.51);
        let found = still(&twin, &hypothesis, 0.01);
        assert!(found.len() == 1 && (found[0].1 - 0.004).abs() < 1e-12, "{found:?}");
        hypothesis.positions[1][0] = 0.6;
        assert!(still(&twin, &hypothesis, 0.01).is_empty());
        let mut other = hypothesis.clone();
        other.positions[1][0] = 0.7;
        let apart = apart_m(0, (&twin, &hypothesis), (&twin, &other));
        assert!((apart - (0.6 * 0.05f64.sin()).hypot(0.04)).abs() < 1e-9, "{apart}");
    }
}
