//! The motion between two cameras by similar landmarks: RANSAC (Fischler and Bolles 1981) over triples, each
//! fitted by least squares (Kabsch 1976).

use nalgebra::{Point3, Vector3};
use rand_core::Rng;

use crate::poses::surfels::Surfels;
use geometry::{Pose, rigid_fit};
use numeric::random::index_below;

/// Triples tried at most.
/// derived: with 30 % of right matches one triple in 37 is right; 300 miss it once in 3000 times
const TRIALS: usize = 300;
/// Trials end where one more triple of followers alone is this unlikely to have been missed.
/// derived: once in 3000 times, as [`TRIALS`]
const MISSED: f64 = 3e-4;
/// A match within so many standard deviations follows a motion.
/// chosen: 0.3 % of a normal distribution
const GATE: f64 = 3.0;
/// A match within so many gates says nothing of another motion.
/// chosen: a motion by noisy matches errs by as much as one of them
const NEAR: f64 = 2.0;
/// Fewest followers of a motion.
/// derived: three fix a motion; nine more at random, each in a gate of a hundredth of the image, do not
/// happen
const LEAST_FOLLOWERS: usize = 12;
/// Smooth error of a depth sensor as a share of the depth, one standard deviation.
/// derived: as in the refinement of poses (docs/method.md 2.11)
const SMOOTH: f64 = 0.004;
/// Rounds for a motion to settle on its followers.
const ROUNDS: usize = 4;

/// A landmark seen by two cameras, each in a map.
#[derive(Clone, Copy, Debug)]
pub(super) struct LandmarkPair {
    /// Where the first saw it, in the first map, meters, and its ray.
    from: Point3<f64>,
    from_ray: Vector3<f64>,
    /// The same of the second, in the second map.
    to: Point3<f64>,
    to_ray: Vector3<f64>,
    /// Standard deviations along the rays, meters.
    along_m: [f64; 2],
    /// ... and across both, meters.
    across_m: f64,
}

impl LandmarkPair {
    /// Landmarks of two cameras in two maps, by their numbers.
    pub fn new(cameras: [&Pose; 2], frames: [&Surfels; 2], numbers: [u32; 2]) -> Self {
        let [(from, [depth0, place0]), (to, [depth1, place1])] =
            [0, 1].map(|k| frames[k].landmark_point(numbers[k]));
        Self {
            from: cameras[0] * from,
            from_ray: cameras[0].rotation * from.coords.normalize(),
            to: cameras[1] * to,
            to_ray: cameras[1].rotation * to.coords.normalize(),
            along_m: [depth0.hypot(SMOOTH * from.z), depth1.hypot(SMOOTH * to.z)],
            across_m: place0.hypot(place1),
        }
    }

    /// Squared distance in standard deviations across the second ray, and along it, after a motion.
    /// See docs/method.md (2.26).
    fn squared_distances(&self, motion: &Pose) -> [f64; 2] {
        let off = motion * self.from - self.to;
        let along = off.dot(&self.to_ray);
        let cosine = (motion.rotation * self.from_ray).dot(&self.to_ray);
        // Depth of the first camera moves the point across the second's ray, where it looks from aside.
        let across_m = self.across_m.hypot(self.along_m[0] * (1.0 - cosine * cosine).max(0.0).sqrt());
        let along_m = self.along_m[1].hypot(self.along_m[0] * cosine);
        [(off - self.to_ray * along).norm_squared() / across_m.powi(2), (along / along_m).powi(2)]
    }

    /// Whether it lies where a motion between the maps takes it.
    pub fn follows(&self, motion: &Pose) -> bool {
        // Two directions across have the same chance beyond a somewhat wider gate; one is taken for both.
        self.squared_distances(motion).iter().all(|square| *square <= GATE * GATE)
    }

    /// Whether it may follow a somewhat inexact motion.
    pub fn is_near(&self, motion: &Pose) -> bool {
        self.squared_distances(motion).iter().all(|square| *square <= (NEAR * GATE).powi(2))
    }

    /// Its cell of space, in the first map.
    pub fn cell_of_space(&self, side_m: f64) -> [i64; 3] {
        [0, 1, 2].map(|k| (self.from[k] / side_m).floor() as i64)
    }

    /// Information of the pair about a place, 1/square meter.
    fn weight(&self) -> f64 {
        1.0 / (self.across_m.powi(2) + self.along_m[0].powi(2) + self.along_m[1].powi(2))
    }
}

/// The motion followed by the most landmarks, and their number; `None` where too few do.
pub(super) fn landmark_motion(pairs: &[LandmarkPair], rng: &mut impl Rng) -> Option<(Pose, usize)> {
    if pairs.len() < LEAST_FOLLOWERS {
        return None;
    }
    let mut best: Option<(usize, Pose)> = None;
    let mut tried = 0;
    let mut needed = TRIALS;
    while tried < needed {
        tried += 1;
        let triple = [(); 3].map(|()| pairs[index_below(rng, pairs.len())]);
        let Some(motion) = motion_of(&triple) else { continue };
        let followers = pairs.iter().filter(|p| p.follows(&motion)).count();
        if best.is_none_or(|(most, _)| followers > most) {
            best = Some((followers, motion));
            let right = (followers as f64 / pairs.len() as f64).powi(3);
            let enough = if right < 1.0 { MISSED.ln() / (1.0 - right).ln() } else { 0.0 };
            needed = TRIALS.min(enough.ceil().max(1.0) as usize);
        }
    }
    let (_, mut motion) = best?;
    for _ in 0..ROUNDS {
        let following = pairs.iter().filter(|p| p.follows(&motion));
        motion = rigid_fit(following.map(|p| (p.from, p.to, p.weight())))?;
    }
    let followers = pairs.iter().filter(|p| p.follows(&motion)).count();
    (followers >= LEAST_FOLLOWERS).then_some((motion, followers))
}

/// The motion of a triple, if it keeps the lengths between its points.
fn motion_of(triple: &[LandmarkPair; 3]) -> Option<Pose> {
    let [a, b, c] = triple;
    (keeps_length(a, b) && keeps_length(b, c) && keeps_length(c, a)).then_some(())?;
    rigid_fit(triple.iter().map(|p| (p.from, p.to, 1.0)))
}

/// Whether the points of two landmarks are as far from each other in both frames.
fn keeps_length(a: &LandmarkPair, b: &LandmarkPair) -> bool {
    let lengths = [(a.from - b.from).norm(), (a.to - b.to).norm()];
    let sigma_m = (1.0 / a.weight() + 1.0 / b.weight()).sqrt();
    lengths[0] > sigma_m && (lengths[0] - lengths[1]).abs() <= GATE * sigma_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::{stage_rng, unit_uniform};

    /// Pairs of which every `wrong`-th shows nothing in common.
    fn pairs(motion: &Pose, count: usize, wrong: usize) -> Vec<LandmarkPair> {
        let mut rng = stage_rng(5, "landmarks", 0);
        let mut point = || {
            Point3::new(
                unit_uniform(&mut rng) - 0.5,
                unit_uniform(&mut rng) - 0.5,
                1.0 + unit_uniform(&mut rng),
            )
        };
        let pair = |i: usize| {
            let from = point();
            let elsewhere = point();
            let noise = (point() - Point3::new(0.0, 0.0, 1.5)) * 0.002;
            let to = if i % wrong == 0 { motion * from + noise } else { elsewhere };
            let rays = [from, to].map(|p| p.coords.normalize());
            LandmarkPair {
                from,
                from_ray: rays[0],
                to,
                to_ray: rays[1],
                along_m: [0.003; 2],
                across_m: 0.002,
            }
        };
        (0..count).map(pair).collect()
    }

    #[test]
    fn a_motion_is_found_among_wrong_matches_and_none_where_there_is_none() {
        let motion = Pose::new(Vector3::new(0.2, -0.1, 0.05), Vector3::new(0.1, 0.4, -0.2));
        let (found, followers) =
            landmark_motion(&pairs(&motion, 120, 2), &mut stage_rng(0, "motion", 0)).unwrap();
        assert!((55..=65).contains(&followers), "{followers}");
        let off = motion.inverse() * found;
        assert!(off.translation.vector.norm() < 0.003 && off.rotation.angle() < 0.003, "{off}");
        let none = pairs(&motion, 120, usize::MAX);
        assert!(landmark_motion(&none[1..], &mut stage_rng(0, "motion", 0)).is_none());
        assert!(landmark_motion(&none[..8], &mut stage_rng(0, "motion", 0)).is_none());
    }
}
