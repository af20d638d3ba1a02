//! Pairs of frames that see the same surface: sums for the normal equations, and how well the frames agree.

use nalgebra::{Matrix6, Vector3, Vector6};
use rayon::prelude::*;

use super::{
    pose_noise::PoseNoise,
    surfels::{FACINGS, Residual, Surfels},
};
use crate::{
    geometry::Pose,
    statistics::{SIGMAS_PER_MAD, median},
};

/// Surfels compared in a round, all pairs together, and least of a pair.
const COMPARED: usize = 200_000;
const LEAST_OF_PAIR: usize = 60;
/// Blocks of surfels, a side; every third one is held out.
const BLOCK: usize = 4;
const HELD_OUT: usize = 3;
/// Cut of Tukey's biweight, in robust standard deviations.
const CUT: f64 = 4.685;
/// A pair of frames counts as no more than so many independent readings: errors of depth run together over an
/// image.
const INDEPENDENT: f64 = 200.0;
/// Fewest held-out surfels for a comparison.
const LEAST_SURFELS: usize = 200;
/// Of this many residuals one goes into the median.
const MEDIAN_EVERY: usize = 4;

/// Frames as they are compared.
pub(super) struct Comparison<'a> {
    surfels: Vec<&'a Surfels>,
    /// Of each frame and way to face: surfels that are fitted, and surfels that are held out.
    sets: [Vec<[Vec<u32>; FACINGS]>; 2],
    /// Ordered pairs of frames.
    pairs: Vec<[usize; 2]>,
    noise: PoseNoise,
}

/// Which surfels are compared.
#[derive(Clone, Copy)]
pub(super) enum Subset {
    /// Those that poses are fitted to.
    Fitted,
    /// The others.
    HeldOut,
}

/// Normal equations of all pairs.
pub(super) struct Sums {
    /// Of each, in their order.
    pub pairs: Vec<PairSums>,
    /// Robust standard deviation of the residuals in expected ones, at least 1.
    pub scale: f64,
}

/// Normal equations of one pair: of the frame that is compared (first) and the one that it is compared with.
#[derive(Clone, Copy)]
pub(super) struct PairSums {
    pub frames: [usize; 2],
    pub information: [Matrix6<f64>; 3],
    pub gradient: [Vector6<f64>; 2],
}

/// What a change of poses does to held-out surfels.
pub(super) struct Gain {
    /// Mean of the frames' gains in its standard errors.
    pub sigmas: f64,
    /// Robust standard deviation of the distances before and after, meters.
    pub residual_m: [f64; 2],
}

/// The same of one pair.
struct PairChange {
    frame: usize,
    /// Surfels compared, and the sum by which their bounded cost falls.
    count: usize,
    gain: f64,
    /// Distances before and after, meters, of some of them.
    distances_m: [Vec<f64>; 2],
}

impl<'a> Comparison<'a> {
    /// Of ordered pairs of frames.
    pub fn new(surfels: Vec<&'a Surfels>, pairs: Vec<[usize; 2]>, noise: PoseNoise) -> Self {
        let sets = [false, true].map(|held_out| surfels.iter().map(|s| subset(s, held_out)).collect());
        Self { sets, surfels, pairs, noise }
    }

    /// Robust standard deviation of the residuals in expected ones, at least 1.
    pub fn scale(&self, world_from_camera: &[Pose]) -> f64 {
        let of_pair = |pair: &[usize; 2]| {
            let mut ratios = Ratios::default();
            self.compare(*pair, world_from_camera, Subset::Fitted, |r, _| ratios.add(r));
            ratios
        };
        robust_scale(self.pairs.par_iter().map(of_pair).collect())
    }

    /// Normal equations about poses; `scale` is that before. While poses are far off, a share `loose` of the
    /// displacement that is expected of them counts as noise, so that no surfel is left out too early.
    pub fn sums(&self, world_from_camera: &[Pose], scale: f64, loose: f64) -> Sums {
        let all: Vec<(Option<PairSums>, Ratios)> =
            self.pairs.par_iter().map(|p| self.pair_sums(*p, world_from_camera, scale, loose)).collect();
        let (pairs, ratios): (Vec<_>, Vec<_>) = all.into_iter().unzip();
        Sums { pairs: pairs.into_iter().flatten().collect(), scale: robust_scale(ratios) }
    }

    fn pair_sums(
        &self,
        frames: [usize; 2],
        world_from_camera: &[Pose],
        scale: f64,
        loose: f64,
    ) -> (Option<PairSums>, Ratios) {
        let mut upper = [[0.0; 12]; 12];
        let mut gradient = [0.0; 12];
        let mut weights = 0.0;
        let mut ratios = Ratios::default();
        self.compare(frames, world_from_camera, Subset::Fitted, |r, _| {
            ratios.add(r);
            let sigma_m = (r.sigma_m * scale).hypot(loose * r.displacement_m);
            // Tukey's biweight: surfels of other surfaces have no say at all.
            let z = r.distance_m / (sigma_m * CUT);
            if z.abs() >= 1.0 {
                return;
            }
            let share = (1.0 - z * z).powi(2);
            weights += share;
            let weight = share / sigma_m.powi(2);
            let row = row(r);
            for (k, line) in upper.iter_mut().enumerate() {
                let scaled = weight * row[k];
                gradient[k] += scaled * r.distance_m;
                for (sum, x) in line.iter_mut().zip(&row).skip(k) {
                    *sum += scaled * x;
                }
            }
        });
        if weights <= 0.0 {
            return (None, ratios);
        }
        // Pixels by the thousand would otherwise outweigh what is expected of the poses.
        let cap = (INDEPENDENT / weights).min(1.0);
        let block =
            |r: usize, c: usize| Matrix6::from_fn(|i, k| cap * upper[(r + i).min(c + k)][(r + i).max(c + k)]);
        let sums = PairSums {
            frames,
            information: [block(0, 0), block(0, 6), block(6, 6)],
            gradient: [0, 6].map(|k| Vector6::from_fn(|i, _| cap * gradient[k + i])),
        };
        (Some(sums), ratios)
    }

    /// How much better the held-out surfels agree `after` than `before`; `None` where they are too few.
    /// See docs/method.md (2.15).
    pub fn gain(&self, before: &[Pose], after: &[Pose]) -> Option<Gain> {
        let scale = self.scale(after);
        let changes: Vec<PairChange> =
            self.pairs.par_iter().map(|p| self.pair_change(*p, before, after, scale)).collect();
        if changes.iter().map(|c| c.count).sum::<usize>() < LEAST_SURFELS {
            return None;
        }
        let robust_m = |k: usize| {
            median(changes.iter().flat_map(|c| c.distances_m[k].iter().copied()).collect())
                .map(|m| SIGMAS_PER_MAD * m)
        };
        // Every frame is one observation: its surfels share its pose.
        let of_frame = |frame: usize| {
            let own = changes.iter().filter(|c| c.frame == frame);
            let (gain, count) = own.fold((0.0, 0), |(gain, count), c| (gain + c.gain, count + c.count));
            (count > 0).then(|| gain / count as f64)
        };
        let gains: Vec<f64> = (0..before.len()).filter_map(of_frame).collect();
        let count = gains.len() as f64;
        let mean = gains.iter().sum::<f64>() / count;
        let variance = gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        Some(Gain {
            sigmas: mean / (variance / count).sqrt().max(1e-12),
            residual_m: [robust_m(0)?, robust_m(1)?],
        })
    }

    fn pair_change(&self, frames: [usize; 2], before: &[Pose], after: &[Pose], scale: f64) -> PairChange {
        let mut change =
            PairChange { frame: frames[0], count: 0, gain: 0.0, distances_m: [Vec::new(), Vec::new()] };
        let mut first: Vec<(usize, f64, f64)> = Vec::new();
        self.compare(frames, before, Subset::HeldOut, |r, place| {
            first.push((place, r.distance_m, r.sigma_m))
        });
        let mut first = first.into_iter().peekable();
        self.compare(frames, after, Subset::HeldOut, |r, place| {
            // Both are in one order.
            while first.peek().is_some_and(|t| t.0 < place) {
                first.next();
            }
            let Some((_, before_m, sigma_m)) = first.next_if(|t| t.0 == place) else { return };
            change.gain +=
                bounded(before_m / (sigma_m * scale)) - bounded(r.distance_m / (r.sigma_m * scale));
            if change.count.is_multiple_of(MEDIAN_EVERY) {
                change.distances_m[0].push(before_m.abs());
                change.distances_m[1].push(r.distance_m.abs());
            }
            change.count += 1;
        });
        change
    }

    /// Visits residuals of a pair and the places of their surfels in a fixed order: about as many for every
    /// way that surfels face (normal-space sampling: Rusinkiewicz and Levoy 2001), since the larger surfaces
    /// show the same again and again.
    fn compare(
        &self,
        [i, j]: [usize; 2],
        world_from_camera: &[Pose],
        subset: Subset,
        mut visit: impl FnMut(&Residual, usize),
    ) {
        let most = (COMPARED / self.pairs.len().max(1)).max(LEAST_OF_PAIR) / FACINGS;
        let other_from_this = world_from_camera[j].inverse() * world_from_camera[i];
        let mut before = 0;
        for cells in &self.sets[subset as usize][i] {
            let stride = cells.len().div_ceil(most).max(1);
            // Every pair begins elsewhere, so that together they use all.
            for (at, &cell) in cells.iter().enumerate().skip((7 * i + 3 * j) % stride).step_by(stride) {
                if let Some(r) =
                    self.surfels[i].residual(cell, self.surfels[j], &other_from_this, &self.noise)
                {
                    visit(&r, before + at);
                }
            }
            before += cells.len();
        }
    }
}

/// Some of a pair's distances in standard deviations.
#[derive(Default)]
struct Ratios {
    seen: usize,
    kept: Vec<f64>,
}

impl Ratios {
    fn add(&mut self, r: &Residual) {
        if self.seen.is_multiple_of(MEDIAN_EVERY) {
            self.kept.push(r.distance_m.abs() / r.sigma_m);
        }
        self.seen += 1;
    }
}

/// See [`Sums::scale`].
fn robust_scale(ratios: Vec<Ratios>) -> f64 {
    (SIGMAS_PER_MAD * median(ratios.into_iter().flat_map(|r| r.kept).collect()).unwrap_or(0.0)).max(1.0)
}

/// The surfels of a frame that are held out, or those that are not, by the way that they face.
fn subset(surfels: &Surfels, held_out: bool) -> [Vec<u32>; FACINGS] {
    let is_held_out = |cell: u32| surfels.block(cell, BLOCK).iter().sum::<usize>().is_multiple_of(HELD_OUT);
    let of_facing = |f: &Vec<u32>| f.iter().copied().filter(|&c| is_held_out(c) == held_out).collect();
    surfels.facing().each_ref().map(of_facing)
}

/// Derivatives of the distance by small motions (translation, rotation) of both cameras in their own frames.
fn row(r: &Residual) -> [f64; 12] {
    let own = r.point.coords.cross(&r.normal);
    let other = r.other_point.coords.cross(&r.other_normal);
    let mut row = [0.0; 12];
    let put = |row: &mut [f64; 12], at: usize, v: &Vector3<f64>, sign: f64| {
        (0..3).for_each(|k| row[at + k] = sign * v[k])
    };
    put(&mut row, 0, &r.normal, 1.0);
    put(&mut row, 3, &own, 1.0);
    put(&mut row, 6, &r.other_normal, -1.0);
    put(&mut row, 9, &other, -1.0);
    row
}

/// Tukey's cost of a residual in robust standard deviations, from 0 to 1.
fn bounded(z: f64) -> f64 {
    let u = 1.0 - (z / CUT).powi(2).min(1.0);
    1.0 - u * u * u
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, SVector};

    use super::*;
    use crate::{
        capture::NoiseConfig,
        geometry::Intrinsics,
        surface::shapes::{cuboid, looking_at_origin, view_of},
    };

    #[test]
    fn derivatives_are_those_of_the_distance() {
        let k = Intrinsics { width: 160, height: 120, fx: 170.0, fy: 165.0, cx: 81.0, cy: 58.0 };
        let shape = cuboid(Vector3::new(0.2, 0.15, 0.1));
        let frames = [Point3::new(0.7, 0.5, 0.4), Point3::new(0.6, 0.6, 0.45)]
            .map(|eye| view_of(&shape, k, looking_at_origin(eye)));
        let surfels = frames.each_ref().map(|f| Surfels::of(f, &NoiseConfig::default(), |_| true));
        let poses = frames.each_ref().map(|f| f.world_from_camera);
        let distance = |cell: u32, poses: &[Pose; 2]| {
            let r = surfels[0].residual(
                cell,
                &surfels[1],
                &(poses[1].inverse() * poses[0]),
                &PoseNoise::EXPECTED,
            )?;
            Some((r.distance_m, row(&r)))
        };
        let step = 1e-6;
        let mut checked = 0;
        for &cell in surfels[0].facing().iter().flatten() {
            let Some((at, row)) = distance(cell, &poses) else { continue };
            for (p, derivative) in row.iter().enumerate() {
                let twist = SVector::<f64, 6>::from_fn(|i, _| if i == p % 6 { step } else { 0.0 });
                let mut moved = poses;
                moved[p / 6] *= Pose::new(twist.fixed_rows::<3>(0).into(), twist.fixed_rows::<3>(3).into());
                // A step into another surfel is no derivative.
                let Some((there, _)) = distance(cell, &moved) else { continue };
                if (there - at).abs() < 3.0 * step {
                    assert!(
                        ((there - at) / step - derivative).abs() < 1e-3,
                        "{p}: {} {derivative}",
                        (there - at) / step
                    );
                    checked += 1;
                }
            }
        }
        assert!(checked > 300, "{checked}");
    }
}
