//! The space that an object can reach in any state.

use nalgebra::{Point3, Vector3};

use super::{Object, Solid, workspace::whole_way};
use geometry::Pose;

/// A box along the axes, meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Extent {
    /// Lower corner.
    pub lower: Point3<f64>,
    /// Upper corner.
    pub upper: Point3<f64>,
}

impl Extent {
    /// The box around a solid.
    pub(super) fn of_solid(solid: &Solid) -> Self {
        let pose = solid.part_from_solid;
        let reach = pose.rotation.to_rotation_matrix().matrix().abs() * solid.shape.half_sides();
        let center = Point3::from(pose.translation.vector);
        Self { lower: center - reach, upper: center + reach }
    }

    /// Its center.
    pub(super) fn center(&self) -> Point3<f64> {
        nalgebra::center(&self.lower, &self.upper)
    }

    /// Half its diagonal, meters.
    pub(super) fn half_diagonal_m(&self) -> f64 {
        0.5 * (self.upper - self.lower).norm()
    }

    /// Whether two boxes are nearer to each other than a gap along every axis.
    pub(super) fn meets(&self, other: &Self, gap_m: f64) -> bool {
        (0..3).all(|k| self.lower[k] < other.upper[k] + gap_m && other.lower[k] < self.upper[k] + gap_m)
    }
}

/// The box around an object with its joints anywhere, in its rest frame. Where parts hang on parts that move,
/// it is that of balls around the joints.
pub(super) fn reach_of_object(object: &Object) -> Extent {
    let at_rest = Object { world_from_rest: Pose::identity(), ..object.clone() };
    let [lower, upper] = whole_way(&at_rest);
    let mut reach = Extent { lower: Point3::new(lower.x, lower.y, 0.0), upper };
    if object.parts.iter().all(|p| p.joint.is_none_or(|j| j.parent == 0)) {
        return reach;
    }
    for (k, part) in object.parts.iter().enumerate() {
        let Some(joint) = part.joint.filter(|j| j.parent == 0) else { continue };
        let around = Vector3::repeat(reach_about_joint(object, k));
        reach.lower = reach.lower.inf(&(joint.origin - around));
        reach.upper = reach.upper.sup(&(joint.origin + around));
    }
    // Nothing goes through the floor.
    reach.lower.z = 0.0;
    reach
}

/// The farthest that anything on a part gets from its joint, meters: distances to the joints of its children
/// stay as they are.
fn reach_about_joint(object: &Object, part: usize) -> f64 {
    let Some(joint) = object.parts[part].joint else { return 0.0 };
    let own = object.mesh_of_part(part).vertices.into_iter();
    let own = own.map(|v| (v.cast::<f64>() - joint.origin).norm()).fold(0.0, f64::max);
    let children = (part + 1..object.parts.len()).filter_map(|k| {
        let child = object.parts[k].joint.filter(|j| j.parent == part)?;
        Some((child.origin - joint.origin).norm() + reach_about_joint(object, k))
    });
    children.fold(own, f64::max)
}
