//! Links and joints with the evidence they rest on.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, SMatrix, Unit, Vector3};

use crate::{
    geometry::Pose,
    surface::{ConvexSolid, TriangleMesh},
};

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
    /// The collision-free interval around it: the joint reaches no further, unless the solids are wrong.
    Swept,
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
    /// Interval without collision, the outer bound of the true one; `None` where it was not swept.
    pub swept: Option<[f64; 2]>,
}

/// What resists a joint's motion; SI units per radian or metre. Zero where nothing is known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointDynamics {
    /// Coulomb friction, N m or N.
    pub friction: f64,
    /// Viscous damping, N m s/rad or N s/m.
    pub damping: f64,
    /// Inertia added at the joint, kg m^2 or kg.
    pub armature: f64,
    /// Stiffness of a spring, N m/rad or N/m.
    pub stiffness: f64,
    /// Position at which that spring rests, radians or metres.
    pub spring_reference: f64,
    /// What these numbers rest on.
    pub assumption: String,
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
    /// Lowest and highest mass under the assumption, kg.
    pub mass_range_kg: [f64; 2],
}

/// A rigid part.
#[derive(Clone, Debug)]
pub struct Link {
    /// Unique name, `[A-Za-z][A-Za-z0-9_]*`.
    pub name: String,
    /// Coloured surface in the link frame.
    pub visual: TriangleMesh,
    /// Convex solids that collide, in the link frame.
    pub collision: Vec<ConvexSolid>,
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
    /// Friction, damping, springs.
    pub dynamics: JointDynamics,
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
