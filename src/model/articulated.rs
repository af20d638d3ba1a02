//! Links and joints with the evidence they rest on.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, SMatrix, Unit, Vector3};

use crate::{geometry::Pose, surface::TriangleMesh};

/// What a joint lets its child do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Turns about the axis; positions in radians.
    Revolute,
    /// Slides along the axis; positions in metres.
    Prismatic,
}

/// Where a limit comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LimitSource {
    /// The interval between the observed states: the joint reaches at least this far.
    Observed,
}

/// Interval of joint positions, radians or metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// Lowest position.
    pub lower: f64,
    /// Highest position.
    pub upper: f64,
    /// Largest effort, N m or N; assumed.
    pub effort: f64,
    /// Largest speed, rad/s or m/s; assumed.
    pub velocity: f64,
    /// What the interval rests on.
    pub source: LimitSource,
}

/// Mass properties in the link frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Inertial {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass in the link frame, metres.
    pub center_of_mass: Point3<f64>,
    /// Inertia about the centre of mass, axes of the link frame, kg m^2.
    pub inertia: Matrix3<f64>,
    /// How it was computed: model, density, thickness.
    pub assumption: String,
}

/// A rigid part.
#[derive(Clone, Debug)]
pub struct Link {
    /// Unique name, `[A-Za-z][A-Za-z0-9_]*`.
    pub name: String,
    /// Coloured surface in the link frame.
    pub visual: TriangleMesh,
    /// Mass properties.
    pub inertial: Inertial,
}

/// What a joint's estimate rests on.
#[derive(Clone, Debug, PartialEq)]
pub struct JointEvidence {
    /// Covariance of (axis direction 3, point on the axis 3, motion 1), world frame, rad and metres.
    pub covariance: SMatrix<f64, 7, 7>,
    /// Full rigid motion of the child from state 0 to state 1 in the world, before the joint constraint.
    pub state1_from_state0: Pose,
    /// Surface points and lifted matches that support the motion.
    pub inliers: usize,
    /// Those that were tried.
    pub tried: usize,
    /// Root mean square distance of the inliers after the motion, metres.
    pub residual_rms_m: f64,
    /// Cost of each joint type (Bayesian information criterion; lower is better), by name.
    pub type_scores: BTreeMap<String, f64>,
    /// Sentences about low information or disagreement; empty where all is well.
    pub cautions: Vec<String>,
}

/// A joint; its frame is the child link's frame.
#[derive(Clone, Debug)]
pub struct Joint {
    /// Unique name, `[A-Za-z][A-Za-z0-9_]*`.
    pub name: String,
    /// What it lets the child do.
    pub kind: JointKind,
    /// Index of the parent link.
    pub parent: usize,
    /// Index of the child link.
    pub child: usize,
    /// Joint frame in the parent link's frame at position 0.
    pub parent_from_joint: Pose,
    /// Axis in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// Position interval.
    pub limit: Limit,
    /// What it rests on.
    pub evidence: JointEvidence,
}

/// Links in a tree of joints. Link 0 is the root; its frame is the world frame of the recording.
#[derive(Clone, Debug)]
pub struct ArticulatedModel {
    /// Robot name, `[A-Za-z][A-Za-z0-9_]*`.
    pub name: String,
    /// Links; 0 is the root.
    pub links: Vec<Link>,
    /// Joints; every link but the root is the child of one.
    pub joints: Vec<Joint>,
    /// Joint positions in each observed state, in the order of `joints`.
    pub states: Vec<Vec<f64>>,
}

impl Joint {
    /// Motion of the child at a joint position: child frame in the parent frame.
    #[must_use]
    pub fn parent_from_child(&self, position: f64) -> Pose {
        let step = match self.kind {
            JointKind::Revolute => Pose::rotation(self.axis.into_inner() * position),
            JointKind::Prismatic => Pose::from_parts((self.axis.into_inner() * position).into(), nalgebra::UnitQuaternion::identity()),
        };
        self.parent_from_joint * step
    }
}

impl ArticulatedModel {
    /// Pose of a link in the world at the given joint positions (order of `joints`).
    #[must_use]
    pub fn world_from_link(&self, link: usize, positions: &[f64]) -> Pose {
        match self.joints.iter().position(|j| j.child == link) {
            None => Pose::identity(),
            Some(j) => self.world_from_link(self.joints[j].parent, positions) * self.joints[j].parent_from_child(positions[j]),
        }
    }
}
