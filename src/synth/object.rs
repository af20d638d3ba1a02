//! Articulated objects built from solids.

use nalgebra::{Point3, Unit, Vector3};

use super::{Family, Handle, Solid};
use geometry::{AxisMotion, Pose, bounding_box};
use surface::{TriangleMesh, merged_mesh};

/// The joint between a part and its parent. Positions are in radians, or meters for a prismatic joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartJoint {
    /// Index of the parent part.
    pub parent: usize,
    /// Type of joint.
    pub kind: AxisMotion,
    /// Axis direction in the object's rest frame.
    pub axis: Unit<Vector3<f64>>,
    /// A point on the axis in the object's rest frame, meters.
    pub origin: Point3<f64>,
    /// Lower and upper limit.
    pub limits: [f64; 2],
    /// Position in each state.
    pub positions: [f64; 2],
}

impl PartJoint {
    /// Motion of the part in the rest frame at a joint position; identity at 0.
    pub fn motion_at(&self, position: f64) -> Pose {
        self.kind.motion_to(self.axis, self.origin, position)
    }
}

/// A rigid part. With every joint at 0, the frames of all parts equal the object's rest frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Name of letters, digits and `_`.
    pub name: String,
    /// Joint with its parent; `None` for the static part, the first one.
    pub joint: Option<PartJoint>,
    /// Its solids.
    pub solids: Vec<Solid>,
    /// Its handle, if handles were requested.
    pub handle: Option<Handle>,
}

impl Part {
    /// A moving part on part `parent`; `axis` is in the rest frame, and positions are not set yet.
    pub(super) fn moving_on(
        name: String,
        parent: usize,
        kind: AxisMotion,
        axis: [f64; 3],
        origin: [f64; 3],
        limits: [f64; 2],
        solids: Vec<Solid>,
    ) -> Self {
        let joint = PartJoint {
            parent,
            kind,
            axis: Unit::new_normalize(axis.into()),
            origin: Point3::from(origin),
            limits,
            positions: [0.0; 2],
        };
        Self { name, joint: Some(joint), solids, handle: None }
    }

    /// The static part.
    pub(super) fn static_part(name: &str, solids: Vec<Solid>) -> Self {
        Self { name: name.to_owned(), joint: None, solids, handle: None }
    }
}

/// An articulated object; parents come before their children.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Name of its family.
    pub family: &'static str,
    /// Parts; the first is static.
    pub parts: Vec<Part>,
    /// Pose of the rest frame in the world.
    pub world_from_rest: Pose,
}

impl Object {
    /// Whether one of two parts is the other's parent and may overlap it: links of a chain at their pins,
    /// caps over their necks. Parts of a cabinet may not.
    pub(super) fn are_pinned(&self, a: usize, b: usize) -> bool {
        let parents = [a, b].map(|part| self.parts[part].joint.map(|j| j.parent));
        self.family != Family::Cabinet.name() && (parents[0] == Some(b) || parents[1] == Some(a))
    }

    /// Motion of every part in the rest frame, with each joint at `share` of its way from state 0 to state 1.
    pub fn rest_from_parts(&self, share: f64) -> Vec<Pose> {
        let mut poses: Vec<Pose> = Vec::with_capacity(self.parts.len());
        for part in &self.parts {
            poses.push(part.joint.map_or_else(Pose::identity, |j| {
                poses[j.parent] * j.motion_at(j.positions[0] + (j.positions[1] - j.positions[0]) * share)
            }));
        }
        poses
    }

    /// Pose of every part in the world, by state.
    pub fn world_from_parts(&self, state: usize) -> Vec<Pose> {
        self.rest_from_parts(state as f64).iter().map(|p| self.world_from_rest * p).collect()
    }

    /// Joint axis and origin of a part in the world in state 0; `None` for the static part.
    pub fn axis_in_world(&self, part: usize) -> Option<(Unit<Vector3<f64>>, Point3<f64>)> {
        let joint = self.parts[part].joint.as_ref()?;
        let world_from_parent = self.world_from_parts(0)[joint.parent];
        Some((
            Unit::new_unchecked(world_from_parent * joint.axis.into_inner()),
            world_from_parent * joint.origin,
        ))
    }

    /// Mesh of a part in its own frame.
    pub fn mesh_of_part(&self, part: usize) -> TriangleMesh {
        let meshes: Vec<TriangleMesh> = self.parts[part]
            .solids
            .iter()
            .map(|s| s.shape.closed_mesh().transformed(&s.part_from_solid))
            .collect();
        merged_mesh(&meshes.iter().collect::<Vec<_>>())
    }

    /// Surface mesh of every part in the world, by state.
    pub fn meshes_in_world(&self, state: usize) -> Vec<TriangleMesh> {
        let poses = self.world_from_parts(state);
        poses.iter().enumerate().map(|(part, pose)| self.mesh_of_part(part).transformed(pose)).collect()
    }

    /// A sphere around the object in both states.
    pub fn bounding_sphere(&self) -> BoundingSphere {
        let mut points: Vec<Point3<f64>> = Vec::new();
        for state in 0..2 {
            for (k, pose) in self.world_from_parts(state).iter().enumerate() {
                points.extend(self.mesh_of_part(k).vertices.iter().map(|v| pose * v.cast::<f64>()));
            }
        }
        let (lower, upper) = bounding_box(points.iter().copied()).unwrap_or_default();
        let center = nalgebra::center(&lower, &upper);
        BoundingSphere { center, radius_m: points.iter().map(|p| (p - center).norm()).fold(0.0, f64::max) }
    }
}

/// A sphere in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundingSphere {
    /// Its center, meters.
    pub center: Point3<f64>,
    /// Its radius, meters.
    pub radius_m: f64,
}
