//! Motions that one joint makes: families with few parameters, alone or carried by the motion of the parent.

use nalgebra::{DVector, Point3, Unit, UnitQuaternion, Vector3};

use super::motion_fit::MotionModel;
use crate::geometry::{Pose, Screw};

/// Rotation about a fixed line: axis direction (2), point (2), angle (1).
#[derive(Clone, Copy, Debug)]
pub struct RevoluteMotion {
    /// Unit direction of the axis.
    pub direction: Unit<Vector3<f64>>,
    /// A point of the axis, near the part.
    pub point: Point3<f64>,
    /// Rotation, radians.
    pub angle_rad: f64,
}

impl RevoluteMotion {
    /// The rotation of a motion's screw, its point moved along the axis to be nearest to `near`; `None` for a motion that
    /// hardly turns.
    #[must_use]
    pub fn of(motion: &Pose, near: &Point3<f64>) -> Option<Self> {
        let screw = Screw::of(motion)?;
        (screw.angle_rad > LEAST_ANGLE_RAD).then(|| Self {
            direction: screw.direction,
            point: foot(&screw.point, &screw.direction, near),
            angle_rad: screw.angle_rad,
        })
    }
}

/// A smaller rotation has no axis to start a fit from.
const LEAST_ANGLE_RAD: f64 = 1e-3;

impl MotionModel for RevoluteMotion {
    fn dimension(&self) -> usize {
        5
    }

    fn stepped(&self, s: &DVector<f64>) -> Self {
        let (a, b) = frame_across(&self.direction);
        let direction = Unit::new_normalize(self.direction.into_inner() + a * s[0] + b * s[1]);
        Self { direction, point: self.point + a * s[2] + b * s[3], angle_rad: self.angle_rad + s[4] }
    }

    fn motion(&self) -> Pose {
        Screw { direction: self.direction, point: self.point, angle_rad: self.angle_rad, advance_m: 0.0 }.motion()
    }
}

/// Translation without rotation.
#[derive(Clone, Copy, Debug)]
pub struct PrismaticMotion(pub Vector3<f64>);

impl MotionModel for PrismaticMotion {
    fn dimension(&self) -> usize {
        3
    }

    fn stepped(&self, s: &DVector<f64>) -> Self {
        Self(self.0 + Vector3::new(s[0], s[1], s[2]))
    }

    fn motion(&self) -> Pose {
        Pose::from_parts(self.0.into(), UnitQuaternion::identity())
    }
}

/// Rotation about a line with an advance along it: the rotation's parameters (5) and the advance (1). Any rigid motion
/// that turns is one (Chasles).
#[derive(Clone, Copy, Debug)]
pub struct ScrewMotion {
    /// The rotation.
    pub turn: RevoluteMotion,
    /// Translation along the axis, metres.
    pub advance_m: f64,
}

impl MotionModel for ScrewMotion {
    fn dimension(&self) -> usize {
        6
    }

    fn stepped(&self, s: &DVector<f64>) -> Self {
        Self { turn: self.turn.stepped(&s.rows(0, 5).into_owned()), advance_m: self.advance_m + s[5] }
    }

    fn motion(&self) -> Pose {
        let RevoluteMotion { direction, point, angle_rad } = self.turn;
        Screw { direction, point, angle_rad, advance_m: self.advance_m }.motion()
    }
}

/// A turn or a screw whose axis keeps its direction: the joint's parameters but the first two.
#[derive(Clone, Copy, Debug)]
pub struct Directed<M>(pub M);

impl<M: MotionModel> MotionModel for Directed<M> {
    fn dimension(&self) -> usize {
        self.0.dimension() - 2
    }

    fn stepped(&self, s: &DVector<f64>) -> Self {
        Self(self.0.stepped(&s.clone().insert_rows(0, 2, 0.0)))
    }

    fn motion(&self) -> Pose {
        self.0.motion()
    }
}

/// A motion relative to a parent that moved itself: `parent * joint`. The joint stands as in state 0.
#[derive(Clone, Copy, Debug)]
pub struct Carried<M> {
    /// `state1_from_state0` of the parent, not fitted.
    pub parent: Pose,
    /// Motion relative to the parent.
    pub joint: M,
}

impl<M: MotionModel> MotionModel for Carried<M> {
    fn dimension(&self) -> usize {
        self.joint.dimension()
    }

    fn stepped(&self, step: &DVector<f64>) -> Self {
        Self { parent: self.parent, joint: self.joint.stepped(step) }
    }

    fn motion(&self) -> Pose {
        self.parent * self.joint.motion()
    }
}

/// Two unit vectors that span the plane across a direction, a fixed choice for each direction.
pub(super) fn frame_across(direction: &Unit<Vector3<f64>>) -> (Vector3<f64>, Vector3<f64>) {
    let d = direction.into_inner();
    let helper = if d.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let a = d.cross(&helper).normalize();
    (a, d.cross(&a))
}

/// The point of a line nearest to another point.
pub(super) fn foot(point: &Point3<f64>, direction: &Unit<Vector3<f64>>, near: &Point3<f64>) -> Point3<f64> {
    point + direction.into_inner() * direction.dot(&(near - point))
}
