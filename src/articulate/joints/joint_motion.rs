//! The motions of one joint: an axis with some freedom, and a position in every state but state 0.
//!
//! The parameters are those of the axis (direction 2; point 2 where it turns; pitch 1 of a screw) and one
//! position a state.

use nalgebra::{DMatrix, DVector, Point3, Unit, Vector3};

use crate::joints::minimise::{DIFFERENCE, left_difference};
use geometry::{Pose, Screw, log_so3};
use model::JointFamily;

/// Cosine above which an axis is too close to a direction to span the plane perpendicular to it.
/// chosen: the other one is then at least 36 degrees off: the product keeps its digits
const HELPER_COSINE: f64 = 0.6;

/// How a joint moves its part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freedom {
    Slide,
    Turn,
    Helix,
}

impl Freedom {
    /// The joint type with this freedom.
    pub fn family(self) -> JointFamily {
        match self {
            Self::Slide => JointFamily::Prismatic,
            Self::Turn => JointFamily::Revolute,
            Self::Helix => JointFamily::Screw,
        }
    }
}

/// A rotation smaller than this, radians, gives no axis to start a fit from.
///
/// chosen: a motion by a tenth of the part's radius puts the axis of such a turn a hundred radii away,
/// farther than any hinge (`far` in joint_type.rs)
const LEAST_ANGLE_RAD: f64 = 1e-3;
/// A slide shorter than this, meters, has no direction.
///
/// chosen: above the rounding of coordinates, below any reading
const LEAST_SLIDE_M: f64 = 1e-9;

/// A joint and its position in every state but state 0. The axis is given as it is in state 0.
#[derive(Clone, Debug)]
pub struct PlacedJoint {
    pub freedom: Freedom,
    pub direction: Unit<Vector3<f64>>,
    pub point: Point3<f64>,
    pub pitch_m_per_rad: f64,
    pub positions: Vec<f64>,
}

impl PlacedJoint {
    /// The slide that displaces a point as a motion relative to the parent does; without positions.
    pub fn slide(motion: &Pose, near: &Point3<f64>) -> Self {
        let direction = Unit::try_new(motion * near - near, LEAST_SLIDE_M).unwrap_or_else(Vector3::x_axis);
        let point = *near;
        let positions = Vec::new();
        Self { freedom: Freedom::Slide, direction, point, pitch_m_per_rad: 0.0, positions }
    }

    /// The turn about the screw axis of a motion relative to the parent, with the axis point nearest to
    /// `near`; without positions. `None` where the motion hardly turns.
    pub fn turn(motion: &Pose, near: &Point3<f64>) -> Option<Self> {
        let screw = Screw::of_motion(motion).filter(|s| s.angle_rad > LEAST_ANGLE_RAD)?;
        let point = foot_on_line(&screw.point, &screw.direction, near);
        Some(Self {
            freedom: Freedom::Turn,
            direction: screw.direction,
            point,
            pitch_m_per_rad: 0.0,
            positions: Vec::new(),
        })
    }

    /// The screw of a motion relative to the parent, otherwise as [`Self::turn`].
    pub fn helix(motion: &Pose, near: &Point3<f64>) -> Option<Self> {
        let pitch_m_per_rad = Screw::of_motion(motion).map_or(0.0, |s| s.advance_m / s.angle_rad);
        Self::turn(motion, near).map(|turn| Self { freedom: Freedom::Helix, pitch_m_per_rad, ..turn })
    }

    /// Number of parameters of the axis; the positions follow them.
    pub fn axis_dimension(&self) -> usize {
        match self.freedom {
            Freedom::Slide => 2,
            Freedom::Turn => 4,
            Freedom::Helix => 5,
        }
    }

    /// Number of parameters.
    pub fn dimension(&self) -> usize {
        self.axis_dimension() + self.positions.len()
    }

    /// The joint moved by a step of its parameters.
    pub fn stepped(&self, s: &DVector<f64>) -> Self {
        // Moves only perpendicular to the axis: a point shifted along its line gives the same joint.
        let (a, b) = frame_across(&self.direction);
        let mut next = self.clone();
        next.direction = Unit::new_normalize(self.direction.into_inner() + a * s[0] + b * s[1]);
        if self.freedom != Freedom::Slide {
            next.point = self.point + a * s[2] + b * s[3];
        }
        if self.freedom == Freedom::Helix {
            next.pitch_m_per_rad += s[4];
        }
        next.positions.iter_mut().enumerate().for_each(|(k, q)| *q += s[self.axis_dimension() + k]);
        next
    }

    /// Motion relative to the parent at a position.
    pub fn motion_at(&self, position: f64) -> Pose {
        let (angle_rad, advance_m) = match self.freedom {
            Freedom::Slide => (0.0, position),
            Freedom::Turn => (position, 0.0),
            Freedom::Helix => (position, self.pitch_m_per_rad * position),
        };
        Screw { direction: self.direction, point: self.point, angle_rad, advance_m }.to_motion()
    }

    /// Motion number `k` in the world, given the parent's motion.
    pub fn world_motion(&self, k: usize, parent: &Pose) -> Pose {
        parent * self.motion_at(self.positions[k])
    }

    /// The position nearest to a motion relative to the parent.
    pub fn nearest_position(&self, relative: &Pose, near: &Point3<f64>) -> f64 {
        match self.freedom {
            // Measured at the part's middle: a rotation in the motion moves this point least.
            Freedom::Slide => self.direction.dot(&(relative * near - near)),
            Freedom::Turn | Freedom::Helix => log_so3(&relative.rotation).dot(&self.direction),
        }
    }

    /// Left perturbation of motion `k` in the world per unit of each parameter, 6 x dimension (central
    /// differences).
    pub fn motion_tangent(&self, k: usize, parent: &Pose) -> DMatrix<f64> {
        let n = self.dimension();
        let mut tangent = DMatrix::zeros(6, n);
        for i in 0..n {
            let mut step = DVector::zeros(n);
            step[i] = DIFFERENCE;
            let plus = self.stepped(&step).world_motion(k, parent);
            let minus = self.stepped(&-step).world_motion(k, parent);
            tangent.column_mut(i).copy_from(&(left_difference(&plus, &minus) / (2.0 * DIFFERENCE)));
        }
        tangent
    }
}

/// Two unit vectors perpendicular to a direction and to each other; deterministic for each direction.
pub(crate) fn frame_across(direction: &Unit<Vector3<f64>>) -> (Vector3<f64>, Vector3<f64>) {
    let d = direction.into_inner();
    let helper = if d.x.abs() < HELPER_COSINE { Vector3::x() } else { Vector3::y() };
    let a = d.cross(&helper).normalize();
    (a, d.cross(&a))
}

/// The point of a line nearest to another point.
pub(crate) fn foot_on_line(
    point: &Point3<f64>,
    direction: &Unit<Vector3<f64>>,
    near: &Point3<f64>,
) -> Point3<f64> {
    point + direction.into_inner() * direction.dot(&(near - point))
}

#[cfg(test)]
#[path = "joint_motion_tests.rs"]
mod tests;
