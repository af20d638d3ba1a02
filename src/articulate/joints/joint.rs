//! A joint between a parent and a moving part.

use nalgebra::{Matrix6, Point3, Unit, Vector3, Vector6};
use serde::{Deserialize, Serialize};

use crate::joints::joint_motion::{Freedom, PlacedJoint};
use geometry::Pose;
use model::{JointEvidence, JointKind};

/// A joint between a parent and a moving part; it is given in the world frame, as it is in state 0.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct JointEstimate {
    /// Type with the best evidence.
    pub kind: JointKind,
    /// Unit axis direction; the position farthest from state 0 is positive.
    pub axis: Unit<Vector3<f64>>,
    /// A point of the axis near the part, meters.
    pub point: Point3<f64>,
    /// Position in every state but state 0, where it is 0, radians or meters.
    pub positions: Vec<f64>,
    /// Rigid motions of the part in the world from state 0 to these states: the parent's motion and the
    /// joint's.
    pub motions: Vec<Pose>,
    /// Covariance of a left perturbation (translation 3, rotation 3) of each motion.
    pub covariances: Vec<Matrix6<f64>>,
    /// Effect of the drawn errors of poses and depth common to all parts on each motion: one left
    /// perturbation per draw, on top of its covariance.
    pub drawn: Vec<Vec<Vector6<f64>>>,
    /// Evidence for the joint.
    pub evidence: JointEvidence,
}

impl JointEstimate {
    /// Largest distance of a position from state 0, radians or meters.
    pub fn largest_position(&self) -> f64 {
        self.positions.iter().copied().fold(0.0, |a, b| if b.abs() > f64::abs(a) { b } else { a })
    }

    /// The joint as a family of motions.
    pub fn placed_joint(&self) -> PlacedJoint {
        PlacedJoint {
            freedom: match self.kind {
                JointKind::Prismatic => Freedom::Slide,
                JointKind::Revolute => Freedom::Turn,
                // A part of unknown joint type moves along the screw of its motion.
                JointKind::Screw { .. } | JointKind::Free { .. } => Freedom::Helix,
            },
            direction: self.axis,
            point: self.point,
            pitch_m_per_rad: self.kind.pitch_m_per_rad().unwrap_or_default(),
            positions: self.positions.clone(),
        }
    }
}
