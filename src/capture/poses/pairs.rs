//! Pairs of frames that see the same surface: sums for the normal equations, and how well the frames agree.

use nalgebra::{Matrix6, Vector3, Vector6};
use rayon::prelude::*;

use super::{
    PoseNoise,
    surfels::{Residual, Surfels},
};
use crate::geometry::Pose;

/// Pieces of surface compared in a round, all pairs together, and least of a pair.
const COMPARED: usize = 400_000;
const LEAST_OF_PAIR: usize = 60;
/// Blocks of pieces, a side; every third one is held out.
const BLOCK: usize = 4;
const HELD_OUT: usize = 3;
/// Cut of Tukey's biweight, in robust standard deviations.
const CUT: f64 = 4.685;
/// A pair of frames says no more than so many independent readings: errors of depth run together over an image.
const INDEPENDENT: f64 = 200.0;
/// Of this many residuals one goes into the median.
const MEDIAN_EVERY: usize = 4;

/// The frames of a state as they are compared.
pub(super) struct Comparison {
    surfels: Vec<Surfels>,
    /// Of each frame: pieces that are fitted, and pieces that are held out.
    sets: [Vec<Vec<u32>>; 2],
    /// Ordered pairs of frames.
    pairs: Vec<[usize; 2]>,
    noise: PoseNoise,
}

/// Which pieces are compared.
#[derive(Clone, Copy)]
pub(super) enum Pieces {
    /// Those that poses are fitted to.
    Fitted,
    /// The others.
    HeldOut,
}

/// Normal equations of one pair: of the frame that is compared (first) and the one that it is compared with.
#[derive(Clone, Copy)]
pub(super) struct PairSums {
    pub frames: [usize; 2],
    pub information: [Matrix6<f64>; 3],
    pub gradient: [Vector6<f64>; 2],
}

/// What a pose change does to one pair's held-out pieces.
pub(super) struct PairChange {
    pub frame: usize,
    /// Pieces compared, and the sum by which their bounded cost falls.
    pub count: usize,
    pub gain: f64,
    /// Distances before and after, metres, of some of them.
    pub distances_m: [Vec<f64>; 2],
}

impl Comparison {
    pub fn new(surfels: Vec<Surfels>, noise: PoseNoise) -> Self {
        let held_out = |s: &Surfels, cell: u32| s.block(cell, BLOCK).iter().sum::<usize>().is_multiple_of(HELD_OUT);
        let set = |held: bool| {
            surfels.iter().map(|s| s.filled().iter().copied().filter(|&c| held_out(s, c) == held).collect()).collect::<Vec<Vec<u32>>>()
        };
        let count = surfels.len();
        let pairs = (0..count).flat_map(|i| (0..count).filter(move |j| *j != i).map(move |j| [i, j])).collect();
        Self { sets: [set(false), set(true)], surfels, pairs, noise }
    }

    /// Robust standard deviation of the residuals in expected ones, at least 1.
    pub fn scale(&self, world_from_camera: &[Pose]) -> f64 {
        let ratio = |[i, j]: [usize; 2]| {
            let mut ratios = Vec::new();
            let mut kept = 0usize;
            self.compare([i, j], world_from_camera, Pieces::Fitted, |r, _| {
                if kept.is_multiple_of(MEDIAN_EVERY) {
                    ratios.push(r.distance_m.abs() / r.sigma_m);
                }
                kept += 1;
            });
            ratios
        };
        let ratios: Vec<Vec<f64>> = self.pairs.par_iter().map(|p| ratio(*p)).collect();
        (1.4826 * median(ratios.concat()).unwrap_or(0.0)).max(1.0)
    }

    /// Normal equations of all pairs, in their order, about poses. `scale`: see [`Self::scale`].
    pub fn sums(&self, world_from_camera: &[Pose], scale: f64) -> Vec<PairSums> {
        self.pairs.par_iter().filter_map(|p| self.pair_sums(*p, world_from_camera, scale)).collect()
    }

    fn pair_sums(&self, frames: [usize; 2], world_from_camera: &[Pose], scale: f64) -> Option<PairSums> {
        let mut upper = [[0.0; 12]; 12];
        let mut gradient = [0.0; 12];
        let mut weights = 0.0;
        self.compare(frames, world_from_camera, Pieces::Fitted, |r, _| {
            let z = r.distance_m / (r.sigma_m * scale * CUT);
            if z.abs() >= 1.0 {
                return;
            }
            let share = (1.0 - z * z).powi(2);
            weights += share;
            let weight = share / (r.sigma_m * scale).powi(2);
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
            return None;
        }
        let cap = (INDEPENDENT / weights).min(1.0);
        let block = |r: usize, c: usize| Matrix6::from_fn(|i, k| cap * upper[(r + i).min(c + k)][(r + i).max(c + k)]);
        Some(PairSums {
            frames,
            information: [block(0, 0), block(0, 6), block(6, 6)],
            gradient: [0, 6].map(|k| Vector6::from_fn(|i, _| cap * gradient[k + i])),
        })
    }

    /// How the held-out pieces of every pair like `after` better than `before`; `scale` is that after.
    pub fn changes(&self, before: &[Pose], after: &[Pose], scale: f64) -> Vec<PairChange> {
        self.pairs.par_iter().map(|p| self.pair_change(*p, before, after, scale)).collect()
    }

    fn pair_change(&self, frames: [usize; 2], before: &[Pose], after: &[Pose], scale: f64) -> PairChange {
        let mut change = PairChange { frame: frames[0], count: 0, gain: 0.0, distances_m: [Vec::new(), Vec::new()] };
        let mut told: Vec<(u32, f64, f64)> = Vec::new();
        self.compare(frames, before, Pieces::HeldOut, |r, cell| told.push((cell, r.distance_m, r.sigma_m)));
        let mut told = told.into_iter().peekable();
        self.compare(frames, after, Pieces::HeldOut, |r, cell| {
            // Both are in the order of the cells.
            while told.peek().is_some_and(|t| t.0 < cell) {
                told.next();
            }
            let Some((_, before_m, sigma_m)) = told.next_if(|t| t.0 == cell) else { return };
            change.gain += bounded(before_m / (sigma_m * scale)) - bounded(r.distance_m / (r.sigma_m * scale));
            if change.count.is_multiple_of(MEDIAN_EVERY) {
                change.distances_m[0].push(before_m.abs());
                change.distances_m[1].push(r.distance_m.abs());
            }
            change.count += 1;
        });
        change
    }

    /// Tells every residual of a pair and its cell, in a fixed order.
    fn compare(&self, [i, j]: [usize; 2], world_from_camera: &[Pose], pieces: Pieces, mut tell: impl FnMut(&Residual, u32)) {
        let cells = &self.sets[pieces as usize][i];
        let most = (COMPARED / self.pairs.len().max(1)).max(LEAST_OF_PAIR);
        let stride = cells.len().div_ceil(most).max(1);
        let other_from_this = world_from_camera[j].inverse() * world_from_camera[i];
        let gate = |depth_m: f64| 3.0 * self.noise.displacement_m(depth_m);
        // Every pair begins elsewhere, so that together they use all.
        for &cell in cells.iter().skip((7 * i + 3 * j) % stride).step_by(stride) {
            if let Some(r) = self.surfels[i].residual(cell, &self.surfels[j], &other_from_this, gate) {
                tell(&r, cell);
            }
        }
    }
}

/// Derivatives of the distance by small motions (translation, rotation) of both cameras in their own frames.
fn row(r: &Residual) -> [f64; 12] {
    let own = r.point.coords.cross(&r.normal);
    let other = r.other_point.coords.cross(&r.other_normal);
    let mut row = [0.0; 12];
    let put = |row: &mut [f64; 12], at: usize, v: &Vector3<f64>, sign: f64| (0..3).for_each(|k| row[at + k] = sign * v[k]);
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

/// Middle value; `None` of none.
pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
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
        let frames = [Point3::new(0.7, 0.5, 0.4), Point3::new(0.6, 0.6, 0.45)].map(|eye| view_of(&shape, k, looking_at_origin(eye)));
        let surfels = frames.each_ref().map(|f| Surfels::of(f, &NoiseConfig::default()));
        let poses = frames.each_ref().map(|f| f.world_from_camera);
        let distance = |cell: u32, poses: &[Pose; 2]| {
            let r = surfels[0].residual(cell, &surfels[1], &(poses[1].inverse() * poses[0]), |_| 0.02)?;
            Some((r.distance_m, row(&r)))
        };
        let step = 1e-6;
        let mut checked = 0;
        for &cell in surfels[0].filled() {
            let Some((at, row)) = distance(cell, &poses) else { continue };
            for (p, derivative) in row.iter().enumerate() {
                let twist = SVector::<f64, 6>::from_fn(|i, _| if i == p % 6 { step } else { 0.0 });
                let mut moved = poses;
                moved[p / 6] *= Pose::new(twist.fixed_rows::<3>(0).into(), twist.fixed_rows::<3>(3).into());
                // A step into another piece is no derivative.
                let Some((there, _)) = distance(cell, &moved) else { continue };
                if (there - at).abs() < 3.0 * step {
                    assert!(((there - at) / step - derivative).abs() < 1e-3, "{p}: {} {derivative}", (there - at) / step);
                    checked += 1;
                }
            }
        }
        assert!(checked > 300, "{checked}");
    }
}
