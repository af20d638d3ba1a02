//! Motion between two cameras from matching landmarks: RANSAC (Fischler and Bolles 1981) over triples, fitted
//! by least squares (Kabsch 1976).

use nalgebra::{Point3, Vector3};
use rand_core::Rng;

use crate::poses::surfels::Surfels;
use geometry::{Pose, rigid_fit};
use numeric::random::index_below;

/// Most triples tried.
/// derived: if 30 % of the matches are right, so is one triple in 37, and 300 triples miss it once in 3000
/// times
const TRIALS: usize = 300;
/// Trials end once the probability of having missed a triple of inliers is below this.
/// derived: once in 3000 times, as for [`TRIALS`]
const MISSED: f64 = 3e-4;
/// Largest distance of a match that follows a motion, standard deviations.
/// chosen: 0.3 % of a normal distribution
const GATE: f64 = 3.0;
/// A match within this many gates is no evidence for another motion.
/// chosen: a motion fitted to noisy matches has errors like those of a match
const NEAR: f64 = 2.0;
/// Fewest matches that must follow a motion.
/// derived: three determine a motion; nine more within gates of a hundredth of the image are no chance
const LEAST_FOLLOWERS: usize = 12;
/// Standard deviation of the smooth depth error of a sensor, share of the depth.
/// derived: as in the refinement of poses (docs/method.md 2.11)
const SMOOTH: f64 = 0.004;
/// Most rounds of refitting a motion to the matches that follow it.
const ROUNDS: usize = 4;

/// A landmark seen by two cameras, each in its map.
#[derive(Clone, Copy, Debug)]
pub(super) struct LandmarkPair {
    /// Its position and viewing ray from the first camera, in the first map, meters.
    from: Point3<f64>,
    from_ray: Vector3<f64>,
    /// Its position and viewing ray from the second camera, in the second map, meters.
    to: Point3<f64>,
    to_ray: Vector3<f64>,
    /// Standard deviations along both rays, meters ...
    along_m: [f64; 2],
    /// ... and across them, meters.
    across_m: f64,
}

impl LandmarkPair {
    /// The pair from the landmarks of two cameras in two maps, by landmark index.
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

    /// Squared normalized distances across and along the second ray after a motion. See
    /// docs/method.md (2.26).
    fn squared_distances(&self, motion: &Pose) -> [f64; 2] {
        let off = motion * self.from - self.to;
        let along = off.dot(&self.to_ray);
        let cosine = (motion.rotation * self.from_ray).dot(&self.to_ray);
        // Depth errors of the first camera move the point across the second ray if the views differ.
        let across_m = self.across_m.hypot(self.along_m[0] * (1.0 - cosine * cosine).max(0.0).sqrt());
        let along_m = self.along_m[1].hypot(self.along_m[0] * cosine);
        [(off - self.to_ray * along).norm_squared() / across_m.powi(2), (along / along_m).powi(2)]
    }

    /// Whether the pair agrees with a motion between the maps.
    pub fn follows(&self, motion: &Pose) -> bool {
        // The gate for two directions would be slightly wider; that of one is used for both.
        self.squared_distances(motion).iter().all(|square| *square <= GATE * GATE)
    }

    /// Whether the pair may agree with a motion that is slightly inaccurate.
    pub fn is_near(&self, motion: &Pose) -> bool {
        self.squared_distances(motion).iter().all(|square| *square <= (NEAR * GATE).powi(2))
    }

    /// Its grid cell in the first map.
    pub fn cell_of_space(&self, side_m: f64) -> [i64; 3] {
        [0, 1, 2].map(|k| (self.from[k] / side_m).floor() as i64)
    }

    /// Weight in a fit: the inverse variance, 1/square meter.
    fn weight(&self) -> f64 {
        1.0 / (self.across_m.powi(2) + self.along_m[0].powi(2) + self.along_m[1].powi(2))
    }
}

/// The motion that the most landmarks follow, with their number; `None` if too few follow any.
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

/// The motion of a triple, if it preserves the distances between the points.
fn motion_of(triple: &[LandmarkPair; 3]) -> Option<Pose> {
    let [a, b, c] = triple;
    (keeps_length(a, b) && keeps_length(b, c) && keeps_length(c, a)).then_some(())?;
    rigid_fit(triple.iter().map(|p| (p.from, p.to, 1.0)))
}

/// Whether two landmarks have the same distance in both maps.
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
