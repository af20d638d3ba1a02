//! The rigid motions common to both states, in normalised coordinates, with gradients on so(3) x R^3.
//!
//! Forward is state 0 to state 1: `y = R x + t`; backward is the exact inverse. Rotations are stepped from
//! the left, `R <- exp(w) R`, so every gradient is a torque about the image of the origin and a force. Part 0
//! never moves.

use nalgebra::{Point3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::neural::adam::Moments;
use geometry::{Pose, SceneBox, exp_so3};

/// Direction of a motion between the states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Way {
    /// From state 0 to state 1.
    Forward,
    /// From state 1 to state 0.
    Backward,
}

impl Way {
    /// The direction from a state to the other one.
    pub(crate) fn from_state(state: usize) -> Self {
        if state == 0 { Self::Forward } else { Self::Backward }
    }

    /// The other way.
    pub(crate) fn reverse(self) -> Self {
        if self == Self::Forward { Self::Backward } else { Self::Forward }
    }
}

/// Rigid motions of all parts in normalised coordinates (about the center of the scene cube).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Motions {
    /// `state1_from_state0` in normalised coordinates, one a part; the first is the identity.
    pub parts: Vec<Pose>,
    moments: Moments<f64>,
}

/// Gradient by the motions: torque and force for each part.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MotionGradient {
    /// Gradient by the left rotation step and by the translation.
    pub parts: Vec<[Vector3<f64>; 2]>,
}

impl Motions {
    /// Motions from world transforms `state1_from_state0`.
    pub(crate) fn from_world(world: &[Pose], scene: &SceneBox) -> Self {
        let mut parts: Vec<Pose> = world.iter().map(|m| scene.normalised_motion(m)).collect();
        // The checks require it to 1e-9; from here on it is exact.
        parts[0] = Pose::identity();
        let moments = Moments::new(6 * parts.len());
        Self { parts, moments }
    }

    /// World transforms `state1_from_state0`, meters.
    pub(crate) fn world(&self, scene: &SceneBox) -> Vec<Pose> {
        self.parts.iter().map(|m| scene.world_motion(m)).collect()
    }

    /// Moves a normalised point with a part.
    pub(crate) fn apply(&self, part: usize, way: Way, point: &Point3<f64>) -> Point3<f64> {
        match way {
            Way::Forward => self.parts[part] * point,
            Way::Backward => self.parts[part].inverse_transform_point(point),
        }
    }

    /// Rotates a direction with a part.
    pub(crate) fn turn(&self, part: usize, way: Way, direction: &Vector3<f64>) -> Vector3<f64> {
        match way {
            Way::Forward => self.parts[part].rotation * direction,
            Way::Backward => self.parts[part].rotation.inverse_transform_vector(direction),
        }
    }

    /// One Adam step (rate in radians and normalised units); part 0 stays.
    pub(crate) fn step(&mut self, gradient: &MotionGradient, rate: f64) {
        let flat: Vec<f64> =
            gradient.parts.iter().flat_map(|[w, t]| [w.x, w.y, w.z, t.x, t.y, t.z]).collect();
        let change = self.moments.steps(&flat, rate);
        for (part, d) in self.parts.iter_mut().zip(change.chunks_exact(6)).skip(1) {
            // Renormalized, because thousands of products drift away from unit length.
            let rotation = exp_so3(&Vector3::new(d[0], d[1], d[2])) * part.rotation;
            part.rotation = UnitQuaternion::new_normalize(rotation.into_inner());
            part.translation.vector += Vector3::new(d[3], d[4], d[5]);
        }
    }
}

impl MotionGradient {
    /// A zero gradient.
    pub(crate) fn zero(parts: usize) -> Self {
        Self { parts: vec![[Vector3::zeros(); 2]; parts] }
    }

    /// Adds a gradient `by_image` by the image of `point` under a part's motion.
    pub(crate) fn add(
        &mut self,
        motions: &Motions,
        part: usize,
        way: Way,
        point: &Point3<f64>,
        by_image: &Vector3<f64>,
    ) {
        if part == 0 {
            return;
        }
        let motion = &motions.parts[part];
        // y = R x + t: dy = w x (R x) + dt.   x = R^T (y - t): dx = -R^T (w x (y - t) + dt).
        // docs/method.md (12.12).
        let (lever, force) = match way {
            Way::Forward => (motion.rotation * point.coords, *by_image),
            Way::Backward => (point.coords - motion.translation.vector, -(motion.rotation * by_image)),
        };
        self.parts[part][0] += lever.cross(&force);
        self.parts[part][1] += force;
    }

    /// Adds another gradient.
    pub(crate) fn merge(&mut self, other: &Self) {
        for (a, b) in self.parts.iter_mut().zip(&other.parts) {
            a[0] += b[0];
            a[1] += b[1];
        }
    }

    /// The gradient times a factor.
    pub(crate) fn scaled(mut self, factor: f64) -> Self {
        self.parts.iter_mut().flatten().for_each(|v| *v *= factor);
        self
    }
}

#[cfg(test)]
impl Motions {
    /// The motions with one coordinate (of the step that [`Motions::step`] makes) of one part changed.
    pub fn nudged(&self, part: usize, coordinate: usize, amount: f64) -> Self {
        let mut all = self.clone();
        let mut d = [0.0; 6];
        d[coordinate] = amount;
        let m = &mut all.parts[part];
        m.rotation = exp_so3(&Vector3::new(d[0], d[1], d[2])) * m.rotation;
        m.translation.vector += Vector3::new(d[3], d[4], d[5]);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_of_an_image_is_exact_both_ways() {
        let scene = SceneBox::around_box(&Point3::new(0.0, 0.1, 0.2), &Point3::new(0.5, 0.4, 0.3));
        let world = Pose::new(Vector3::new(0.1, -0.2, 0.05), Vector3::new(0.4, 0.3, -0.8));
        let motions = Motions::from_world(&[Pose::identity(), world], &scene);
        let back = motions.world(&scene)[1];
        assert!((back.translation.vector - world.translation.vector).norm() < 1e-12);
        let x = Point3::new(0.2, 0.3, 0.25);
        assert!(
            (scene.normalise(&(world * x)) - motions.apply(1, Way::Forward, &scene.normalise(&x))).norm()
                < 1e-12
        );

        let p = Point3::new(0.3, -0.5, 0.7);
        let by_image = Vector3::new(0.2, 0.9, -0.4);
        for way in [Way::Forward, Way::Backward] {
            let mut g = MotionGradient::zero(2);
            g.add(&motions, 1, way, &p, &by_image);
            for k in 0..6 {
                let value = |d: f64| by_image.dot(&motions.nudged(1, k, d).apply(1, way, &p).coords);
                let numeric = (value(1e-5) - value(-1e-5)) / 2e-5;
                assert!((numeric - g.parts[1][k / 3][k % 3]).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn the_static_part_never_moves() {
        let scene = SceneBox::around_box(&Point3::origin(), &Point3::new(1.0, 1.0, 1.0));
        let mut motions = Motions::from_world(&[Pose::identity(); 2], &scene);
        let one = Vector3::new(1.0, 1.0, 1.0);
        motions.step(&MotionGradient { parts: vec![[one, one]; 2] }, 0.01);
        assert_eq!(motions.parts[0], Pose::identity());
        assert!((motions.parts[1].translation.vector + 0.01 * one).norm() < 1e-9);
    }
}
