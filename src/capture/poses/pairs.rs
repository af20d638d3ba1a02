//! Pairs of frames with surface in common: normal equations, and the agreement of the frames.

use std::collections::BTreeMap;

use nalgebra::{IsometryMatrix3, Matrix6, Vector6};
use rayon::prelude::*;

use super::{
    pose_noise::PoseNoise,
    reading_weights::ReadingWeights,
    residual_scale::{MEDIAN_EVERY, Ratios, robust_scale},
    sensor_errors::SensorErrors,
    sensor_sums::{BySensor, Row, SensorSums, add_rows, by_sensor},
    surfels::{FACINGS, Residual, Surfels},
};
use common::stop::{Stop, Stopped};
use geometry::Pose;
use numeric::statistics::{SIGMAS_PER_MAD, median};

/// Surfels compared per round over all pairs, and the least number per pair.
const COMPARED: usize = 200_000;
const LEAST_OF_PAIR: usize = 60;
/// With many frames, one in this many surfels is compared in early rounds.
/// measured: shared/bags/laptop: files of the same bytes; other parts were not tried
const COARSE: usize = 4;
/// Side of the blocks of surfels; every third block is held out.
const BLOCK: usize = 4;
const HELD_OUT: usize = 3;
/// Cutoff of Tukey's biweight, in robust standard deviations.
/// derived: 95 % efficiency for normal errors
const CUT: f64 = 4.685;
/// Most independent readings of a frame: depth errors are correlated across the image.
/// chosen: at most this many independent regions of depth
const INDEPENDENT: f64 = 200.0;
/// Fewest held-out surfels for a comparison.
const LEAST_SURFELS: usize = 200;

/// Surfels of frames, and the poses of their cameras.
#[derive(Clone, Copy)]
pub(crate) struct Views<'a> {
    pub surfels: &'a [Surfels],
    pub world_from_camera: &'a [Pose],
}

/// The surfels and landmarks to compare between frames.
pub(crate) struct Comparison {
    /// Per frame and facing: fitted surfels, and held-out ones.
    sets: [Vec<[Vec<u32>; FACINGS]>; 2],
    /// Ordered pairs of frames.
    pairs: Vec<[usize; 2]>,
    /// Matching landmarks by frame pair.
    matches: Matches,
    noise: PoseNoise,
    /// Surfels compared per round over all pairs.
    compared: usize,
    /// One in this many is enough in early rounds.
    coarse: usize,
    /// Checked before every frame.
    stop: Stop,
}

/// For each ordered pair of frames, the index pairs of matching landmarks.
pub(crate) type Matches = BTreeMap<[usize; 2], Vec<[u32; 2]>>;

/// Which surfels are compared.
#[derive(Clone, Copy)]
pub(crate) enum Subset {
    /// Those used in the fit.
    Fitted,
    /// Those held out to judge it.
    HeldOut,
}

/// How a round is fitted.
#[derive(Clone, Copy)]
pub(crate) struct Fit {
    /// Share of the expected displacement by pose errors that counts as noise, so that no surfel is rejected
    /// too early.
    pub loose: f64,
    /// Whether a part of the surfels suffices, as later rounds use all of them.
    pub is_rough: bool,
}

impl Fit {
    /// A final round.
    pub const CLOSE: Self = Self { loose: 0.0, is_rough: false };

    /// A round with this share; zero gives [`Self::CLOSE`].
    pub fn loose(share: f64) -> Self {
        Self { loose: share, is_rough: share > 0.0 }
    }
}

/// Normal equations of all pairs.
pub(crate) struct Sums {
    /// Per pair, in order of the pairs.
    pub pairs: Vec<PairSums>,
    /// For the sensor's errors, where requested.
    pub sensor: Option<SensorSums>,
    /// Robust standard deviation of the normalized residuals, at least 1.
    pub scale: f64,
}

/// Normal equations of one pair: first the compared frame, then its partner.
#[derive(Clone, Copy)]
pub(crate) struct PairSums {
    pub frames: [usize; 2],
    pub information: [Matrix6<f64>; 3],
    pub gradient: [Vector6<f64>; 2],
}

/// Sums over the pairs of one frame.
struct FrameSums {
    pairs: Vec<PairSums>,
    ratios: Vec<Ratios>,
    sensor: Option<SensorSums>,
}

struct Rows {
    surfels: Vec<Row>,
    landmarks: Vec<Row>,
    /// Sum of the surfels' weights, and number of surfels tried.
    agreeing: f64,
    tried: usize,
    ratios: Ratios,
}

/// Improvement of the held-out surfels by a change of poses.
pub(crate) struct Gain {
    /// Mean gain of the frames, in standard errors.
    pub sigmas: f64,
    /// Robust standard deviation of the distances before and after, meters.
    pub residual_m: [f64; 2],
}

/// Change of the held-out residuals of one state.
pub(crate) struct Changes {
    frames: usize,
    pairs: Vec<PairChange>,
}

impl Changes {
    /// Mean gain of one frame's surfels; `None` without any.
    fn frame_gain(&self, frame: usize) -> Option<f64> {
        let mut gain = 0.0;
        let mut count = 0;
        for pair in self.pairs.iter().filter(|c| c.frame == frame) {
            gain += pair.gain;
            count += pair.count;
        }
        (count > 0).then(|| gain / count as f64)
    }
}

/// Change of the residuals of one pair.
struct PairChange {
    frame: usize,
    /// Number of compared surfels, and the reduction of their robust cost.
    count: usize,
    gain: f64,
    /// Sampled distances before and after, meters.
    distances_m: [Vec<f64>; 2],
}

impl Comparison {
    /// A comparison over ordered pairs, grouped by their first frame.
    pub fn new<'a>(
        surfels: impl Iterator<Item = &'a Surfels> + Clone,
        pairs: Vec<[usize; 2]>,
        matches: Matches,
        noise: PoseNoise,
        stop: &Stop,
    ) -> Self {
        let sets =
            [false, true].map(|held_out| surfels.clone().map(|s| surfel_subset(s, held_out)).collect());
        Self { sets, pairs, matches, noise, compared: COMPARED, coarse: 1, stop: stop.clone() }
    }

    /// Compares fewer surfels in early rounds; with many frames this is accurate enough.
    pub fn coarse_while_loose(self) -> Self {
        Self { coarse: COARSE, ..self }
    }

    /// Compares about `surfels` surfels per round, over all pairs.
    pub fn with_surfels(self, surfels: usize) -> Self {
        Self { compared: surfels, ..self }
    }

    /// Robust standard deviation of the normalized residuals, at least 1.
    pub fn residual_scale(&self, views: Views<'_>) -> Result<f64, Stopped> {
        let ratios = self.pairs.par_iter().map(|pair| {
            self.stop.check()?;
            let mut ratios = Ratios::default();
            self.visit_residuals(*pair, views, Subset::Fitted, |r, _| ratios.add(r));
            Ok(ratios)
        });
        Ok(robust_scale(ratios.collect::<Result<_, Stopped>>()?))
    }

    /// Normal equations for the poses and, if given, the sensor's errors; `scale` is the residual scale of
    /// the previous round.
    pub fn normal_equations(
        &self,
        views: Views<'_>,
        sensor: Option<&SensorErrors>,
        scale: f64,
        fit: Fit,
    ) -> Result<Sums, Stopped> {
        // By first frame, as each task holds one copy of the large sensor sums.
        let frames: Vec<&[[usize; 2]]> = self.pairs.chunk_by(|a, b| a[0] == b[0]).collect();
        let all: Vec<FrameSums> = frames
            .par_iter()
            .map(|pairs| self.frame_sums(pairs, views, sensor, scale, fit))
            .collect::<Result<_, Stopped>>()?;
        let mut pairs = Vec::new();
        let mut ratios = Vec::new();
        let mut sensor_sums = None;
        // In fixed order, since floating-point sums depend on it.
        for frame in all {
            pairs.extend(frame.pairs);
            ratios.extend(frame.ratios);
            sensor_sums = match (sensor_sums, frame.sensor) {
                (Some(sum), Some(next)) => Some(SensorSums::added_to(sum, next)),
                (sum, next) => sum.or(next),
            };
        }
        Ok(Sums { pairs, sensor: sensor_sums.map(SensorSums::completed), scale: robust_scale(ratios) })
    }

    /// Normal equations of the pairs with one first frame.
    fn frame_sums(
        &self,
        pairs: &[[usize; 2]],
        views: Views<'_>,
        sensor: Option<&SensorErrors>,
        scale: f64,
        fit: Fit,
    ) -> Result<FrameSums, Stopped> {
        self.stop.check()?;
        let rows: Vec<Rows> =
            pairs.iter().map(|&pair| self.rows_of_pair(pair, views, sensor, scale, fit)).collect();
        let agreeing = rows.iter().map(|r| r.agreeing / r.tried.max(1) as f64).sum();
        let matches = pairs.iter().filter_map(|pair| self.matches.get(pair)).flatten();
        let weights = ReadingWeights::of_frame(agreeing, matches.map(|m| m[0]));
        let mut sums = FrameSums {
            pairs: Vec::new(),
            ratios: Vec::new(),
            sensor: sensor
                .map(|errors| SensorSums::of_no_residuals(views.world_from_camera.len(), errors.count())),
        };
        for (&pair, mut rows) in pairs.iter().zip(rows) {
            sums.ratios.push(rows.ratios);
            let of_surfels = weights.of_surfels * (INDEPENDENT / rows.agreeing).min(1.0);
            rows.surfels.iter_mut().for_each(|row| row.weight *= of_surfels);
            rows.landmarks.iter_mut().for_each(|row| row.weight *= weights.of_landmarks);
            rows.surfels.append(&mut rows.landmarks);
            if rows.surfels.is_empty() {
                continue;
            }
            sums.pairs.push(pair_sums(pair, &rows.surfels));
            if let Some(sensor) = &mut sums.sensor {
                add_rows(sensor, pair, &rows.surfels);
            }
        }
        Ok(sums)
    }

    fn rows_of_pair(
        &self,
        pair: [usize; 2],
        views: Views<'_>,
        sensor: Option<&SensorErrors>,
        scale: f64,
        fit: Fit,
    ) -> Rows {
        let most = if fit.is_rough { self.most_surfels() / self.coarse } else { self.most_surfels() };
        let mut surfels = Vec::with_capacity(most);
        let mut landmarks = Vec::new();
        let mut agreeing = 0.0;
        let mut ratios = Ratios::default();
        let tried = self.compare_surfels(pair, views, Subset::Fitted, most, |r, _| {
            ratios.add(r);
            if let Some((share, row)) = weighted_row(r, sensor, scale, fit.loose) {
                agreeing += share;
                surfels.push(row);
            }
        });
        self.compare_landmarks(pair, views, Subset::Fitted, |r, _| {
            ratios.add(r);
            landmarks.extend(weighted_row(r, sensor, scale, fit.loose).map(|(_, row)| row));
        });
        Rows { surfels, landmarks, agreeing, tried, ratios }
    }

    /// Change of the held-out residuals from `before` to `after`.
    pub fn changes_between(&self, before: Views<'_>, after: Views<'_>) -> Result<Changes, Stopped> {
        // One scale for both; otherwise worse poses would get a larger scale.
        let scale = self.residual_scale(after)?;
        let pairs = self.pairs.par_iter().map(|p| {
            self.stop.check()?;
            Ok(self.pair_change(*p, before, after, scale))
        });
        Ok(Changes { frames: before.surfels.len(), pairs: pairs.collect::<Result<_, Stopped>>()? })
    }

    fn pair_change(&self, frames: [usize; 2], before: Views<'_>, after: Views<'_>, scale: f64) -> PairChange {
        let mut change =
            PairChange { frame: frames[0], count: 0, gain: 0.0, distances_m: [Vec::new(), Vec::new()] };
        let mut first: Vec<(usize, f64, f64)> = Vec::new();
        self.visit_residuals(frames, before, Subset::HeldOut, |r, place| {
            first.push((place, r.distance_m, r.sigma_m))
        });
        let mut first = first.into_iter().peekable();
        self.visit_residuals(frames, after, Subset::HeldOut, |r, place| {
            // Both are in the same order.
            while first.peek().is_some_and(|t| t.0 < place) {
                first.next();
            }
            // Only surfels compared both before and after; otherwise poses would gain by losing some.
            let Some((_, before_m, sigma_m)) = first.next_if(|t| t.0 == place) else { return };
            change.gain +=
                bounded_cost(before_m / (sigma_m * scale)) - bounded_cost(r.distance_m / (r.sigma_m * scale));
            if change.count.is_multiple_of(MEDIAN_EVERY) {
                change.distances_m[0].push(before_m.abs());
                change.distances_m[1].push(r.distance_m.abs());
            }
            change.count += 1;
        });
        change
    }

    /// Visits the residuals of a pair, with their positions in a fixed order.
    fn visit_residuals(
        &self,
        pair: [usize; 2],
        views: Views<'_>,
        subset: Subset,
        mut visit: impl FnMut(&Residual, usize),
    ) {
        let surfels = self.sets[subset as usize][pair[0]].iter().map(Vec::len).sum::<usize>();
        self.compare_surfels(pair, views, subset, self.most_surfels(), &mut visit);
        self.compare_landmarks(pair, views, subset, |r, place| visit(r, surfels + place));
    }

    /// Most surfels compared per pair.
    fn most_surfels(&self) -> usize {
        (self.compared / self.pairs.len().max(1)).max(LEAST_OF_PAIR)
    }

    /// Visits at most `most` surfels, about equally many of every facing (normal-space sampling: Rusinkiewicz
    /// and Levoy 2001), since large surfaces are redundant. Returns the number of surfels tried.
    fn compare_surfels(
        &self,
        [i, j]: [usize; 2],
        Views { surfels, world_from_camera }: Views<'_>,
        subset: Subset,
        most: usize,
        mut visit: impl FnMut(&Residual, usize),
    ) -> usize {
        let most = (most / FACINGS).max(1);
        // For many points a matrix is faster than a quaternion.
        let other_from_this: IsometryMatrix3<f64> =
            nalgebra::convert(world_from_camera[j].inverse() * world_from_camera[i]);
        let mut before = 0;
        let mut tried = 0;
        for cells in &self.sets[subset as usize][i] {
            let stride = cells.len().div_ceil(most).max(1);
            // Every pair starts at another offset, so that together they use all surfels.
            for (at, &cell) in cells.iter().enumerate().skip((7 * i + 3 * j) % stride).step_by(stride) {
                tried += 1;
                if let Some(r) = surfels[i].surfel_residual(cell, &surfels[j], &other_from_this, &self.noise)
                {
                    visit(&r, before + at);
                }
            }
            before += cells.len();
        }
        tried
    }

    /// Visits the landmarks, with two residuals each.
    fn compare_landmarks(
        &self,
        [i, j]: [usize; 2],
        Views { surfels, world_from_camera }: Views<'_>,
        subset: Subset,
        mut visit: impl FnMut(&Residual, usize),
    ) {
        let other_from_this = world_from_camera[j].inverse() * world_from_camera[i];
        let matches = self.matches.get(&[i, j]).map_or(&[][..], Vec::as_slice);
        for (at, &landmarks) in matches.iter().enumerate() {
            if at.is_multiple_of(HELD_OUT) != matches!(subset, Subset::HeldOut) {
                continue;
            }
            let across = surfels[i].landmark_residuals(landmarks, &surfels[j], &other_from_this, &self.noise);
            for (k, r) in across.iter().enumerate() {
                if let Some(r) = r {
                    visit(r, 2 * at + k);
                }
            }
        }
    }
}

impl Gain {
    /// The gain over several states; `None` for too few held-out surfels. See docs/method.md (2.16).
    pub fn of_changes(states: &[Changes]) -> Option<Self> {
        let pairs = || states.iter().flat_map(|s| &s.pairs);
        if pairs().map(|c| c.count).sum::<usize>() < LEAST_SURFELS {
            return None;
        }
        let mut residual_m = [0.0; 2];
        for (k, residual_m) in residual_m.iter_mut().enumerate() {
            let distances = pairs().flat_map(|c| c.distances_m[k].iter().copied());
            *residual_m = SIGMAS_PER_MAD * median(distances.collect())?;
        }
        // Each frame is one observation, since its surfels share its pose.
        let gains: Vec<f64> =
            states.iter().flat_map(|s| (0..s.frames).filter_map(|frame| s.frame_gain(frame))).collect();
        let count = gains.len() as f64;
        let mean = gains.iter().sum::<f64>() / count;
        let variance = gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        Some(Self { sigmas: mean / (variance / count).sqrt().max(1e-12), residual_m })
    }
}

/// The held-out surfels of a frame, or the others, by facing.
fn surfel_subset(surfels: &Surfels, held_out: bool) -> [Vec<u32>; FACINGS] {
    surfels.cells_by_facing().each_ref().map(|cells| {
        let blocks = cells.iter().map(|cell| surfels.block_of_cell(*cell, BLOCK).iter().sum::<usize>());
        let wanted = cells.iter().zip(blocks).filter(|(_, b)| b.is_multiple_of(HELD_OUT) == held_out);
        wanted.map(|(cell, _)| *cell).collect()
    })
}

/// A row of the normal equations with its weight; `None` if the residual is an outlier.
#[inline]
fn weighted_row(r: &Residual, sensor: Option<&SensorErrors>, scale: f64, loose: f64) -> Option<(f64, Row)> {
    let variance_m2 = (r.sigma_m * scale).powi(2) + (loose * r.displacement_m).powi(2);
    // Tukey's biweight: outliers have no weight.
    let share = (1.0 - r.distance_m.powi(2) / (variance_m2 * CUT * CUT)).max(0.0).powi(2);
    let sensor = sensor.map_or_else(BySensor::default, |errors| by_sensor(r, errors));
    let weight = share / variance_m2;
    (share > 0.0).then(|| (share, Row { poses: by_poses(r), sensor, distance_m: r.distance_m, weight }))
}

/// Derivatives of the distance by small motions (translation, rotation) of both cameras, each in its own
/// frame.
pub(crate) fn by_poses(r: &Residual) -> [f64; 12] {
    // A motion of the first camera moves the point of docs/method.md (2.13). A motion of the other moves the
    // plane, as if the point moved the opposite way.
    let own = r.point.coords.cross(&r.normal);
    let other = r.other_point.coords.cross(&r.other_normal);
    let mut row = [0.0; 12];
    for k in 0..3 {
        row[k] = r.normal[k];
        row[3 + k] = own[k];
        row[6 + k] = -r.other_normal[k];
        row[9 + k] = -other[k];
    }
    row
}

/// Normal equations of the poses of a pair.
fn pair_sums(frames: [usize; 2], rows: &[Row]) -> PairSums {
    // Upper half of a symmetric matrix; `block` mirrors it.
    let mut upper = [[0.0; 12]; 12];
    let mut gradient = [0.0; 12];
    for row in rows {
        for (k, line) in upper.iter_mut().enumerate() {
            let scaled = row.weight * row.poses[k];
            gradient[k] += scaled * row.distance_m;
            for (sum, x) in line.iter_mut().zip(&row.poses).skip(k) {
                *sum += scaled * x;
            }
        }
    }
    let block = |r: usize, c: usize| Matrix6::from_fn(|i, k| upper[(r + i).min(c + k)][(r + i).max(c + k)]);
    PairSums {
        frames,
        information: [block(0, 0), block(0, 6), block(6, 6)],
        gradient: [0, 6].map(|k| Vector6::from_fn(|i, _| gradient[k + i])),
    }
}

/// Tukey's cost of a normalized residual, from 0 to 1.
fn bounded_cost(z: f64) -> f64 {
    let u = 1.0 - (z / CUT).powi(2).min(1.0);
    1.0 - u * u * u
}

#[cfg(test)]
mod tests {
    use nalgebra::{DVector, Point3, SVector, Vector3};

    use super::*;
    use crate::NoiseConfig;
    use crate::analytic::{cuboid, looking_at_origin, view_of};
    use geometry::Intrinsics;

    #[test]
    fn derivatives_are_those_of_the_distance() {
        let k = Intrinsics { width: 160, height: 120, fx: 170.0, fy: 165.0, cx: 81.0, cy: 58.0 };
        let shape = cuboid(Vector3::new(0.2, 0.15, 0.1));
        let frames = [Point3::new(0.7, 0.5, 0.4), Point3::new(0.6, 0.6, 0.45)]
            .map(|eye| view_of(&shape, k, looking_at_origin(eye)));
        let surfels = frames.each_ref().map(|f| Surfels::of_frame(f, &NoiseConfig::default(), |_| true));
        let poses = frames.each_ref().map(|f| f.world_from_camera);
        let distance = |cell: u32, poses: &[Pose; 2]| {
            let r = surfels[0].surfel_residual(
                cell,
                &surfels[1],
                &nalgebra::convert(poses[1].inverse() * poses[0]),
                &PoseNoise::EXPECTED,
            )?;
            Some((r.distance_m, by_poses(&r)))
        };
        // Those by the sensor's errors, in directions that are drawn; readings are single precision.
        let mut rng = numeric::random::stage_rng(3, "warp", 0);
        let mut drawn = || rand_core::Rng::next_u64(&mut rng) as f64 / u64::MAX as f64 - 0.5;
        let mut checked = 0;
        for size in [1e-3, -1e-3] {
            let mut errors = SensorErrors::without_errors(&k);
            errors.add_step(&DVector::from_fn(errors.count(), |_, _| size * drawn()));
            let warped = Surfels::all_corrected(&surfels, &errors);
            let between: IsometryMatrix3<f64> = nalgebra::convert(poses[1].inverse() * poses[0]);
            for &cell in surfels[0].cells_by_facing().iter().flatten() {
                let of = |s: &[Surfels]| s[0].surfel_residual(cell, &s[1], &between, &PoseNoise::EXPECTED);
                let (Some(at), Some(there)) = (of(&surfels), of(&warped)) else { continue };
                let values = errors.values();
                let expected: f64 = by_sensor(&at, &errors).iter().map(|(k, d)| d * values[k]).sum();
                let change = there.distance_m - at.distance_m;
                assert!((change - expected).abs() < 0.03 * size.abs(), "{change} {expected}");
                checked += 1;
            }
        }
        assert!(checked > 100, "{checked}");
        let step = 1e-6;
        let mut checked = 0;
        for &cell in surfels[0].cells_by_facing().iter().flatten() {
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

    #[test]
    fn derivatives_of_landmarks_are_those_of_the_distance() {
        let k = Intrinsics { width: 160, height: 120, fx: 170.0, fy: 165.0, cx: 81.0, cy: 58.0 };
        let shape = cuboid(Vector3::new(0.2, 0.15, 0.1));
        let frames = [Point3::new(0.7, 0.5, 0.4), Point3::new(0.6, 0.6, 0.45)]
            .map(|eye| view_of(&shape, k, looking_at_origin(eye)));
        let noise = NoiseConfig::default();
        let mut surfels = frames.each_ref().map(|f| Surfels::of_frame(f, &noise, |_| true));
        let poses = frames.each_ref().map(|f| f.world_from_camera);
        // What a pixel of the first frame shows, the second shows where it projects to, a little beside.
        let seen: Vec<[[f64; 2]; 2]> = (0..300)
            .filter_map(|i| {
                let u = 50 + i % 20 * 3;
                let v = 40 + i / 20 * 3;
                let there = frames[1].in_camera(&frames[0].world_point(v * k.width + u)?);
                let (x, y) = k.project(&there)?;
                Some([[u as f64 + 0.3, v as f64 - 0.2], [x, y]])
            })
            .collect();
        let numbers = [0, 1].map(|s| {
            let pixels = seen.iter().map(|p| p[s]);
            surfels[s].set_landmarks(&frames[s], &noise, pixels)
        });
        let between = |p: &[Pose; 2]| p[1].inverse() * p[0];
        let at = |s: &[Surfels], p: &[Pose; 2], m: [u32; 2]| {
            s[0].landmark_residuals(m, &s[1], &between(p), &PoseNoise::EXPECTED)
        };
        let mut rng = numeric::random::stage_rng(3, "warp", 0);
        let mut drawn = || rand_core::Rng::next_u64(&mut rng) as f64 / u64::MAX as f64 - 0.5;
        let mut errors = SensorErrors::without_errors(&k);
        errors.add_step(&DVector::from_fn(errors.count(), |_, _| 1e-4 * drawn()));
        let spoilt = Surfels::all_corrected(&surfels, &errors);
        let values = errors.values();
        let mut checked = 0;
        let step = 1e-6;
        for m in numbers[0].iter().zip(&numbers[1]).filter_map(|(a, b)| Some([(*a)?, (*b)?])) {
            for (r, changed) in at(&surfels, &poses, m).into_iter().zip(at(&spoilt, &poses, m)) {
                let (Some(r), Some(changed)) = (r, changed) else { continue };
                let expected: f64 = by_sensor(&r, &errors).iter().map(|(k, d)| d * values[k]).sum();
                let change = changed.distance_m - r.distance_m;
                assert!((change - expected).abs() < 3e-6, "{change} {expected}");
                checked += 1;
            }
            for p in 0..12 {
                let twist = SVector::<f64, 6>::from_fn(|i, _| if i == p % 6 { step } else { 0.0 });
                let mut moved = poses;
                moved[p / 6] *= Pose::new(twist.fixed_rows::<3>(0).into(), twist.fixed_rows::<3>(3).into());
                for (r, there) in at(&surfels, &poses, m).into_iter().zip(at(&surfels, &moved, m)) {
                    let (Some(r), Some(there)) = (r, there) else { continue };
                    let slope = (there.distance_m - r.distance_m) / step;
                    // The ray of the other's landmark stays: a turn of that camera moves the point alone.
                    assert!((slope - by_poses(&r)[p]).abs() < 1e-3, "{p}: {slope} {}", by_poses(&r)[p]);
                }
            }
        }
        assert!(checked > 200, "{checked}");
    }
}
