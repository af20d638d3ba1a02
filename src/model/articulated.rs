//! Links and joints with the evidence they rest on.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, SMatrix, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::{JointFamily, JointRemark, TypeScores};
use geometry::Pose;
use surface::{ConvexSolid, TriangleMesh};

/// Type of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum JointKind {
    /// Turns about the axis; positions in radians.
    Revolute,
    /// Slides along the axis; positions in meters.
    Prismatic,
    /// Turns about the axis and advances along it; positions in radians.
    Screw {
        /// Advance per turn of one radian, meters; negative for a left-handed thread.
        pitch_m_per_rad: f64,
    },
    /// No joint with one degree of freedom explains the motion. The model moves the part along the screw of
    /// the observed motion, the shortest way; positions in radians.
    Free {
        /// Advance of the screw per radian, meters.
        pitch_m_per_rad: f64,
    },
}

/// Least advance of a thread that files keep, meters per radian. chosen: a tenth of a fine screw's
const LEAST_THREAD_M_PER_RAD: f64 = 1e-5;

impl JointKind {
    /// Motion to a position along an axis through the origin of the frame; the identity at 0.
    pub fn motion_to(self, axis: &Unit<Vector3<f64>>, position: f64) -> Pose {
        let (angle_rad, advance_m) = match self.pitch_m_per_rad() {
            Some(pitch) => (position, pitch * position),
            None if self.turns() => (position, 0.0),
            None => (0.0, position),
        };
        // docs/method.md (1.4), with the axis through the origin of the frame.
        let turn = UnitQuaternion::from_scaled_axis(axis.into_inner() * angle_rad);
        Pose::from_parts((axis.into_inner() * advance_m).into(), turn)
    }

    /// Whether positions are radians.
    pub fn turns(self) -> bool {
        self != Self::Prismatic
    }

    /// Advance per radian, meters, of a joint that turns and advances; `None` for others.
    pub fn pitch_m_per_rad(self) -> Option<f64> {
        match self {
            Self::Revolute | Self::Prismatic => None,
            Self::Screw { pitch_m_per_rad } | Self::Free { pitch_m_per_rad } => Some(pitch_m_per_rad),
        }
    }

    /// Advance per radian, meters, of a joint that files describe as a turn with a slide tied to it; `None`
    /// for others. Below a hundredth of a millimeter per radian the joint is written as a hinge.
    pub fn thread_m_per_rad(self) -> Option<f64> {
        self.pitch_m_per_rad().filter(|pitch| pitch.abs() > LEAST_THREAD_M_PER_RAD)
    }

    /// One word: `revolute`, `prismatic`, `screw`, `free`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Revolute => "revolute",
            Self::Prismatic => "prismatic",
            Self::Screw { .. } => "screw",
            Self::Free { .. } => "free",
        }
    }

    /// The fitted family of motions: a free motion moves along its screw.
    pub fn family(self) -> JointFamily {
        match self {
            Self::Prismatic => JointFamily::Prismatic,
            Self::Revolute => JointFamily::Revolute,
            Self::Screw { .. } | Self::Free { .. } => JointFamily::Screw,
        }
    }

    /// The nearest type that every format knows: any turning joint becomes revolute.
    #[must_use]
    pub fn nearest_simple(self) -> Self {
        if self.turns() { Self::Revolute } else { Self::Prismatic }
    }
}

/// What a limit is based on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LimitSource {
    /// The interval between the observed states: the joint reaches at least this far.
    Observed,
    /// The observed interval with a margin; on the closed end it ends at the part's seat ([`Limit::closed`]).
    Seated,
    /// The collision-free interval around the observed states: the joint goes no farther, unless the solids
    /// are wrong.
    Swept,
}

/// An end of a joint where a face of its child meets its parent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Seat {
    /// Position of contact, radians or meters.
    pub position: f64,
    /// Root mean square deviation of the contact positions of the meeting cells, radians or meters.
    pub std: f64,
    /// Share of the part's leading surface cells that meet.
    pub contact_share: f64,
    /// Whether this is the upper end.
    pub above: bool,
}

/// Interval of joint positions, radians or meters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Limit {
    /// Lowest position.
    pub lower: f64,
    /// Highest position.
    pub upper: f64,
    /// Largest effort, N m or N; assumed.
    pub effort: f64,
    /// Largest speed, rad/s or m/s; assumed.
    pub velocity: f64,
    /// What the interval is based on.
    pub source: LimitSource,
    /// Collision-free interval, the outer bound of the true one; `None` if it was not computed.
    pub swept: Option<[f64; 2]>,
    /// Where the joint is closed; `None` if neither end shows it.
    pub closed: Option<Seat>,
}

/// Resistance to a joint's motion; SI units per radian or meter. Zero where nothing is known.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointDynamics {
    /// Coulomb friction, N m or N.
    pub friction: f64,
    /// Viscous damping, N m s/rad or N s/m.
    pub damping: f64,
    /// Inertia added at the joint, kg m^2 or kg.
    pub armature: f64,
    /// Stiffness of a spring, N m/rad or N/m.
    pub stiffness: f64,
    /// Position of the spring at rest, radians or meters.
    pub spring_reference: f64,
    /// What these numbers are based on.
    pub assumption: String,
}

/// Mass properties in the link frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Inertial {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Center of mass in the link frame, meters.
    pub center_of_mass: Point3<f64>,
    /// Inertia about the center of mass, axes of the link frame, kg m^2.
    pub inertia: Matrix3<f64>,
    /// How it was computed: model, density, thickness.
    pub assumption: String,
    /// Lowest and highest mass under the assumption, kg.
    pub mass_range_kg: [f64; 2],
}

/// A pose at which a parallel gripper can hold a part.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Grasp {
    /// Pose of the hand in the link frame: x is the closing direction, z the approach, the origin lies
    /// between the fingertips.
    pub link_from_grasp: Pose,
    /// Width of the part there, meters.
    pub width_m: f64,
    /// Largest angle between the closing direction and the normal of a face at a pad, radians.
    pub off_rad: f64,
    /// Whether views saw both faces; otherwise one is assumed, at the wall thickness.
    pub is_seen: bool,
}

/// A rigid part.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Link {
    /// Unique name, `[A-Za-z][A-Za-z0-9_]*`.
    pub name: String,
    /// Colored surface in the link frame.
    pub visual: TriangleMesh,
    /// Area of closed holes in it that no view saw, square meters.
    pub assumed_m2: f64,
    /// Faces of unseen walls, from the solids, in the link frame; for display.
    #[serde(default)]
    pub assumed: TriangleMesh,
    /// Convex solids for collision, in the link frame.
    pub collision: Vec<ConvexSolid>,
    /// Mass properties.
    pub inertial: Inertial,
    /// Grasps, best first; empty for a link that does not move.
    #[serde(default)]
    pub grasps: Vec<Grasp>,
}

/// How well a link fits as the parent of a part.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParentScore {
    /// Score of the best joint with one degree of freedom, less the free motion's: the lower it is, the
    /// simpler the part moves relative to the link.
    pub excess: f64,
    /// Distance between link and part, the largest over the states, meters.
    pub gap_m: f64,
}

/// The evidence for a joint.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointEvidence {
    /// Covariance of (axis direction 3, point on the axis 3, motion 1), world frame, radians and meters. With
    /// several states, the motion is the one farthest from state 0's position.
    pub covariance: SMatrix<f64, 7, 7>,
    /// Full rigid motion of the child from state 0 to state 1 (with several: to the state farthest from state
    /// 0) in the world, before the joint constrains it.
    pub state1_from_state0: Pose,
    /// Number of surface points and lifted matches that support the motion.
    pub inliers: usize,
    /// Number of points and matches tried.
    pub tried: usize,
    /// Root mean square distance of the inliers after the motion, meters.
    pub residual_rms_m: f64,
    /// Standard deviation of the position in every state but state 0, radians or meters; infinite in a state
    /// that was left out of the fit.
    pub position_std: Vec<f64>,
    /// Standard deviation of the pitch, meters per radian; 0 for a joint without one.
    pub pitch_std_m_per_rad: f64,
    /// Ratio of the squared error of the parameters to that of independent observations; included in the
    /// covariance.
    pub dispersion: f64,
    /// Score of every type of joint.
    pub type_scores: TypeScores,
    /// Possible parents of the part, by the index of their link.
    pub parents: BTreeMap<usize, ParentScore>,
    /// The axis from the motion alone, if the object's other axes and faces influenced the final one.
    pub axis_alone: Option<AxisAlone>,
    /// What speaks against the estimate: little information, disagreement; empty if nothing does.
    pub cautions: Vec<JointRemark>,
    /// Properties that the states cannot show.
    pub not_observable: Vec<JointRemark>,
}

/// An axis estimated from the motion of its part alone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AxisAlone {
    /// Unit direction in the world, in state 0.
    pub axis: Unit<Vector3<f64>>,
    /// Its standard deviation, radians.
    pub std_rad: f64,
}

/// A joint; its frame is the child link's frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Joint {
    /// Unique name, `[A-Za-z][A-Za-z0-9_]*`.
    pub name: String,
    /// Its type.
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
    /// The evidence for the joint.
    pub evidence: JointEvidence,
}

/// Links in a tree of joints. Link 0 is the root; its frame is the world frame of the recording.
#[derive(Clone, Debug, Serialize, Deserialize)]
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
    /// Name of the slide tied to the turn of a thread, in files that split it into both.
    pub fn advance_name(&self) -> String {
        format!("{}_advance", self.name)
    }

    /// Pose of the child's frame in the parent's frame at a joint position.
    pub fn parent_from_child(&self, position: f64) -> Pose {
        self.parent_from_joint * self.kind.motion_to(&self.axis, position)
    }
}

impl ArticulatedModel {
    /// Largest deviation of a joint's position from that in state 0, signed, radians or meters; 0 without
    /// states.
    pub fn motion_of_joint(&self, joint: usize) -> f64 {
        let Some((first, others)) = self.states.split_first() else { return 0.0 };
        let motions = others.iter().map(|s| s[joint] - first[joint]);
        // Of equally far states the first.
        motions.reduce(|a, b| if b.abs() > a.abs() { b } else { a }).unwrap_or_default()
    }

    /// Positions with every joint closed whose closed end is known, within its limits, and the others as in
    /// state 0; `None` if no closed end is known.
    pub fn closed_state(&self) -> Option<Vec<f64>> {
        let first = self.states.first()?;
        if self.joints.iter().all(|j| j.limit.closed.is_none()) {
            return None;
        }
        let limits = self.joints.iter().map(|j| &j.limit);
        let positions =
            limits.zip(first).map(|(l, q)| l.closed.map_or(*q, |s| s.position.clamp(l.lower, l.upper)));
        Some(positions.collect())
    }

    /// Pose of a link in the world at the given joint positions (order of `joints`).
    pub fn world_from_link(&self, link: usize, positions: &[f64]) -> Pose {
        match self.joints.iter().position(|j| j.child == link) {
            // The root's frame is the world's.
            None => Pose::identity(),
            Some(j) => {
                self.world_from_link(self.joints[j].parent, positions)
                    * self.joints[j].parent_from_child(positions[j])
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example::cabinet;

    #[test]
    fn a_screw_turns_and_advances() {
        let mut joint = cabinet().joints.remove(0);
        joint.parent_from_joint = Pose::identity();
        joint.axis = Vector3::z_axis();
        joint.kind = JointKind::Screw { pitch_m_per_rad: -0.02 };
        let moved = joint.parent_from_child(std::f64::consts::FRAC_PI_2) * Point3::new(1.0, 0.0, 0.0);
        assert!(
            (moved - Point3::new(0.0, 1.0, -0.02 * std::f64::consts::FRAC_PI_2)).norm() < 1e-12,
            "{moved}"
        );
        assert_eq!((joint.kind.nearest_simple(), joint.kind.name()), (JointKind::Revolute, "screw"));
    }
}
