//! A twin seen by cameras: rigid parts with meshes, and joints.

use nalgebra::{Point3, Unit, Vector3};

use crate::camera::model::own_error::OwnErrors;
use geometry::{AxisMotion, Pose};
use surface::TriangleMesh;

/// A rigid part: links tied by fixed joints.
#[derive(Clone, Debug)]
pub struct SeenPart {
    /// Name of its first link.
    pub name: String,
    /// Visual meshes in the frame of the first link.
    pub mesh: TriangleMesh,
    /// Joint carrying the part; `None` for the root.
    pub joint: Option<usize>,
    /// Center of its bounding box, part frame, meters.
    pub center: Point3<f64>,
    /// Half the diagonal of its bounding box, meters.
    pub radius_m: f64,
}

/// A joint of the twin; the joint frame is the frame of the child part.
#[derive(Clone, Debug)]
pub struct SeenJoint {
    /// Name.
    pub name: String,
    /// Parent part.
    pub parent: usize,
    /// Child part.
    pub child: usize,
    /// Joint frame in the parent part's frame at position 0.
    pub parent_from_joint: Pose,
    /// How it moves.
    pub kind: AxisMotion,
    /// Direction in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// A point of the axis in the joint frame, meters; the origin in every description file.
    pub point: Point3<f64>,
    /// Lowest and highest position, where the twin has limits.
    pub limit: Option<(f64, f64)>,
    /// For a mimic joint: index of the leader, factor, offset.
    pub mimic: Option<(usize, f64, f64)>,
}

/// A twin seen by cameras. Each part comes after its parent.
#[derive(Clone, Debug)]
pub struct SeenTwin {
    /// Parts; the first is the root.
    pub parts: Vec<SeenPart>,
    /// Joints in tree order: each before those carried by its child.
    pub joints: Vec<SeenJoint>,
    /// Its own errors.
    pub own: OwnErrors,
}

impl SeenTwin {
    /// Whether a part moves with a joint.
    pub fn carries(&self, joint: usize, part: usize) -> bool {
        let mut at = part;
        while let Some(j) = self.parts[at].joint {
            if j == joint {
                return true;
            }
            at = self.joints[j].parent;
        }
        false
    }

    /// Half the diagonal of the largest part, meters.
    pub fn radius_m(&self) -> f64 {
        self.parts.iter().map(|p| p.radius_m).fold(f64::MIN_POSITIVE, f64::max)
    }
}
