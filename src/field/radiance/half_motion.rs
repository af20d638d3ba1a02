//! Half the motion of a mobile part: from state 0 to the canonical frame midway between the states (Liu,
//! Mahdavi-Amiri and Savva 2023: `t* = 0.5`). The same motion leads from there to state 1.
//!
//! Rotations are updated from the left, `R <- exp(w) R`. A step of `e` in a unit quaternion's components
//! rotates by `2 e` radians, so the published rates of quaternions are doubled for `w`.

use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use geometry::{Pose, Screw, exp_so3};

/// Number of coordinates of a half motion's step.
pub(super) const COORDINATES: usize = 6;

/// Half the motion of a part in normalised coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum HalfMotion {
    /// Any rigid motion (the published SE3): `R x + t`.
    Free {
        /// Pose `canonical_from_state0`.
        pose: Pose,
    },
    /// A rotation about a line: `R (x - o) + o`.
    Revolute {
        /// A point `o` on the line.
        pivot: Point3<f64>,
        /// The rotation `R`.
        rotation: UnitQuaternion<f64>,
    },
    /// A translation along a direction: `x + d u`.
    Prismatic {
        /// Unit direction `u`.
        direction: Unit<Vector3<f64>>,
        /// Half the distance `d`, normalised units.
        distance: f64,
    },
}

/// Gradient by a pose: by a rotation step from the left, and by the translation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct PoseGradient {
    pub torque: Vector3<f64>,
    pub force: Vector3<f64>,
}

impl PoseGradient {
    /// Adds the gradient, given that by the image `R x + t` of a point.
    pub(super) fn add_forward(&mut self, pose: &Pose, image: &Point3<f64>, by_image: &Vector3<f64>) {
        // y = R x + t: dy = w x (R x) + dt.
        self.torque += (image.coords - pose.translation.vector).cross(by_image);
        self.force += by_image;
    }

    /// Adds the gradient, given that by the image `R^T (x - t)` of `point`.
    pub(super) fn add_inverse(&mut self, pose: &Pose, point: &Point3<f64>, by_image: &Vector3<f64>) {
        // y = R^T (x - t): dy = -R^T (w x (x - t) + dt).
        let force = -(pose.rotation * by_image);
        self.torque += (point.coords - pose.translation.vector).cross(&force);
        self.force += force;
    }

    /// Adds the gradient, given that by a rotated direction `R d`.
    pub(super) fn add_turned(&mut self, image: &Vector3<f64>, by_image: &Vector3<f64>) {
        self.torque += image.cross(by_image);
    }

    /// Adds the gradient, given that by the direction `R^T d`.
    pub(super) fn add_turned_back(&mut self, pose: &Pose, direction: &Vector3<f64>, by_image: &Vector3<f64>) {
        self.torque -= direction.cross(&(pose.rotation * by_image));
    }

    /// Adds another gradient.
    pub(super) fn add_pose_gradient(&mut self, other: &Self) {
        self.torque += other.torque;
        self.force += other.force;
    }
}

/// The published initial direction of every axis.
fn diagonal_direction() -> Unit<Vector3<f64>> {
    Unit::new_normalize(Vector3::new(1.0, 1.0, 1.0))
}

impl HalfMotion {
    /// The published start of a free motion: rotations by 0.02 rad and a translation by 0.001 along every
    /// axis.
    pub fn free_start() -> Self {
        let rotation = UnitQuaternion::from_axis_angle(&diagonal_direction(), 0.02);
        Self::Free { pose: Pose::from_parts(Vector3::new(0.001, 0.001, 0.001).into(), rotation) }
    }

    /// The published start of a prismatic joint: a translation by 0.1.
    pub fn prismatic_start() -> Self {
        Self::Prismatic { direction: diagonal_direction(), distance: 0.1 }
    }

    /// Half of the motion `state1_from_state0`, in normalised coordinates; the motion must rotate by less
    /// than half a turn.
    pub fn of_whole(whole: &Pose) -> Self {
        let pose = Screw::of_motion(whole)
            .map_or_else(Pose::identity, |s| s.motion_by(0.5 * s.angle_rad, 0.5 * s.advance_m));
        Self::Free { pose }
    }

    /// `canonical_from_state0` in normalised coordinates.
    pub fn pose(&self) -> Pose {
        match self {
            Self::Free { pose } => *pose,
            Self::Revolute { pivot, rotation } => {
                Pose::from_parts((pivot.coords - rotation * pivot.coords).into(), *rotation)
            }
            Self::Prismatic { direction, distance } => {
                Pose::from_parts((direction.into_inner() * *distance).into(), UnitQuaternion::identity())
            }
        }
    }

    /// Gradient by the coordinates of [`Self::stepped_by`], given the gradient by the pose.
    pub(super) fn coordinate_gradient(&self, by_pose: &PoseGradient) -> [f64; COORDINATES] {
        let PoseGradient { torque, force } = by_pose;
        let [a, b] = match self {
            Self::Free { .. } => [*torque, *force],
            // t = o - R o: dt = (I - R) do - w x (R o).
            Self::Revolute { pivot, rotation } => [
                torque - (rotation * pivot.coords).cross(force),
                force - rotation.inverse_transform_vector(force),
            ],
            // t = d v / |v|, at |v| = 1.
            Self::Prismatic { direction, distance } => {
                let along = direction.dot(force);
                [(force - direction.into_inner() * along) * *distance, Vector3::new(along, 0.0, 0.0)]
            }
        };
        [a.x, a.y, a.z, b.x, b.y, b.z]
    }

    /// The motion after a change of its coordinates: rotation step and translation, rotation step and pivot,
    /// or direction (normalised again) and distance, with two unused coordinates.
    #[must_use]
    pub(super) fn stepped_by(&self, change: &[f64; COORDINATES]) -> Self {
        let [a, b] = [0, 3].map(|k| Vector3::new(change[k], change[k + 1], change[k + 2]));
        // Renormalised, since rounding accumulates over thousands of products.
        let turned = |r: &UnitQuaternion<f64>| UnitQuaternion::new_normalize((exp_so3(&a) * r).into_inner());
        match self {
            Self::Free { pose } => {
                let t = pose.translation.vector + b;
                Self::Free { pose: Pose::from_parts(t.into(), turned(&pose.rotation)) }
            }
            Self::Revolute { pivot, rotation } => {
                Self::Revolute { pivot: pivot + b, rotation: turned(rotation) }
            }
            Self::Prismatic { direction, distance } => Self::Prismatic {
                direction: Unit::new_normalize(direction.into_inner() + a),
                distance: distance + b.x,
            },
        }
    }

    /// Published learning rate of each coordinate.
    pub(super) fn coordinate_rates(&self) -> [f64; COORDINATES] {
        let [a, b] = match self {
            Self::Free { .. } => [0.02, 0.001],
            Self::Revolute { .. } => [0.02, 0.01],
            Self::Prismatic { .. } => [0.005, 0.005],
        };
        [a, a, a, b, b, b]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motions() -> [HalfMotion; 3] {
        let rotation = exp_so3(&Vector3::new(0.3, -0.4, 0.2));
        [
            HalfMotion::Free { pose: Pose::from_parts(Vector3::new(0.1, 0.2, -0.3).into(), rotation) },
            HalfMotion::Revolute { pivot: Point3::new(0.4, -0.1, 0.3), rotation },
            HalfMotion::Prismatic {
                direction: Unit::new_normalize(Vector3::new(0.3, 0.5, -0.4)),
                distance: 0.2,
            },
        ]
    }

    #[test]
    fn gradients_are_those_of_images_and_turned_directions() {
        let x = Point3::new(0.2, 0.5, -0.7);
        let d = Vector3::new(0.6, 0.0, 0.8);
        let by_x = Vector3::new(0.3, -0.8, 0.5);
        let by_d = Vector3::new(-0.2, 0.4, 0.9);
        for motion in motions() {
            for back in [false, true] {
                let value = |m: &HalfMotion| {
                    let pose = if back { m.pose().inverse() } else { m.pose() };
                    by_x.dot(&(pose * x).coords) + by_d.dot(&(pose * d))
                };
                let pose = motion.pose();
                let mut g = PoseGradient::default();
                if back {
                    g.add_inverse(&pose, &x, &by_x);
                    g.add_turned_back(&pose, &d, &by_d);
                } else {
                    g.add_forward(&pose, &(pose * x), &by_x);
                    g.add_turned(&(pose * d), &by_d);
                }
                for (k, expected) in motion.coordinate_gradient(&g).into_iter().enumerate() {
                    let nudged = |h: f64| {
                        let mut change = [0.0; COORDINATES];
                        change[k] = h;
                        value(&motion.stepped_by(&change))
                    };
                    let numeric = (nudged(1e-5) - nudged(-1e-5)) / 2e-5;
                    assert!((numeric - expected).abs() < 1e-8, "{motion:?} {k}: {expected} {numeric}");
                }
            }
        }
    }

    #[test]
    fn two_halves_are_the_whole() {
        let whole = Pose::new(Vector3::new(0.3, 0.1, -0.2), Vector3::new(0.5, -1.0, 0.7));
        let half = HalfMotion::of_whole(&whole).pose();
        let twice = half * half;
        assert!((twice.translation.vector - whole.translation.vector).norm() < 1e-12);
        assert!(twice.rotation.angle_to(&whole.rotation) < 1e-12);
        assert_eq!(HalfMotion::of_whole(&Pose::identity()).pose(), Pose::identity());
    }

    #[test]
    fn starts_are_the_published_ones() {
        assert!((HalfMotion::free_start().pose().rotation.angle() - 0.02).abs() < 1e-12);
        assert!((HalfMotion::prismatic_start().pose().translation.vector.norm() - 0.1).abs() < 1e-12);
    }
}
