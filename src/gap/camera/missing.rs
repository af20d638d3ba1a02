//! Geometry that the object has and the twin lacks.
//!
//! Signature: readings before the twin's surface, or where it has none, that stand at the same place of one part in many
//! frames and states, while hardly any stand behind it: a part in a wrong place gives both.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Point3;
use rand_core::Rng;

use super::{
    assess::{CameraFinding, FrameOptions},
    fit::Work,
    parameter::Stage,
    residual::{BORDER, Conflict, PixelSample, Sample, compare},
    trial::INTERVAL,
    twin::{Hypothesis, SeenTwin},
};
use crate::{
    gap::verdict::{Finding, ParameterEstimate},
    geometry::Pose,
    run::stage_rng,
};

/// Index in reports, behind the catalogue.
const INDEX: usize = 101;
/// Readings this far off, or this many errors of the twin, or standard deviations of the camera, are missing geometry.
const OFF_M: f64 = 0.012;
const ACCURACIES: f64 = 8.0;
const SIGMAS: f64 = 4.0;
/// Side of a voxel over the object's radius, and its bounds, metres.
const VOXEL_SHARE: f64 = 0.06;
const VOXEL_M: [f64; 2] = [0.012, 0.05];
/// Least area of a piece, square metres, and as a share of the square of the object's radius.
const AREA_M2: f64 = 0.0012;
const AREA_SHARE: f64 = 0.008;
/// Readings behind the twin for each before it, at most.
const OTHER_SIDE: f64 = 0.5;
/// Share of the frames, and of the runs, that must see a voxel.
const FRAMES: f64 = 0.1;
const RUNS: f64 = 0.6;
/// Share of readings beyond each side of the box.
const OUTER: f64 = 0.01;
/// Draws of the frames for the intervals.
const DRAWS: usize = 120;
/// Most pieces.
const MOST: usize = 4;

type Voxel = [i32; 3];

/// A piece of geometry that the twin lacks.
#[derive(Clone, Debug)]
pub struct Missing {
    /// Part that it moves with.
    pub part: usize,
    /// Box in the part's frame, metres.
    pub bounds: [[f64; 3]; 2],
    /// Area, as the frame sees it that sees most, square metres.
    pub area_m2: f64,
    /// 95 % interval of the sides of the box.
    pub bounds_interval: [[(f64, f64); 3]; 2],
    /// 95 % interval of the area.
    pub area_interval: (f64, f64),
    /// Frames that see it.
    pub frames: usize,
    /// Points of it, part frame.
    pub points: Vec<Point3<f64>>,
    voxels: BTreeSet<Voxel>,
    voxel_m: f64,
}

impl Missing {
    /// Whether a world point is part of it, the parts standing at given poses.
    #[must_use]
    pub fn covers(&self, world_from_parts: &[Pose], point: &Point3<f64>) -> bool {
        let [x, y, z] = voxel(&world_from_parts[self.part].inverse_transform_point(point), self.voxel_m);
        (-1..=1).any(|i| (-1..=1).any(|j| (-1..=1).any(|k| self.voxels.contains(&[x + i, y + j, z + k]))))
    }

    /// As a finding.
    #[must_use]
    pub fn finding(&self, twin: &SeenTwin) -> CameraFinding {
        let told =
            |name: &str, value: f64, unit: &str, interval| ParameterEstimate { name: name.into(), value, unit: unit.into(), interval };
        let mut parameters = vec![told("area", self.area_m2, "m^2", self.area_interval)];
        for (s, name) in ["lower", "upper"].iter().enumerate() {
            for (k, axis) in ["x", "y", "z"].iter().enumerate() {
                parameters.push(told(&format!("{name}_{axis}"), self.bounds[s][k], "m", self.bounds_interval[s][k]));
            }
        }
        let finding = Finding {
            index: INDEX,
            effect: "missing_geometry".into(),
            parameters,
            weight: 1.0,
            alternatives: Vec::new(),
            experiment: "film the place from nearby and from all sides".into(),
        };
        CameraFinding { joint: twin.parts[self.part].joint, finding, in_urdf: "not expressible" }
    }
}

fn voxel(p: &Point3<f64>, side_m: f64) -> Voxel {
    [0, 1, 2].map(|k| (p[k] / side_m).floor() as i32)
}

/// A reading before the twin.
struct Reading {
    run: usize,
    frame: usize,
    point: Point3<f64>,
    area_m2: f64,
    /// Length that a pixel has there, metres.
    pixel_m: f64,
    /// Standard deviation of the reading, metres.
    sigma_m: f64,
}

/// Finds pieces, largest first.
#[must_use]
pub fn missing_geometry(work: &Work, hypothesis: &Hypothesis, options: &FrameOptions) -> Vec<Missing> {
    let gate_m = gate(work, hypothesis, options);
    let samples = compare(work.twin, work.runs, &work.pixels, hypothesis, gate_m);
    let stage = Stage::new(work.twin, work.runs, hypothesis);
    let used = |s: &&PixelSample| !work.is_held_out(s.frame);
    let mut readings: Vec<Reading> = Vec::new();
    let mut behind = 0.0;
    for s in samples.iter().filter(used) {
        match &s.sample {
            Sample::Conflict { kind: Conflict::Nearer, point, .. } => {
                let pixel_m = s.area_m2.sqrt() / work.pixels.stride_of(s.run, s.frame).max(1) as f64;
                let run = &work.runs[s.run];
                let sigma_m = run.frames[s.frame].sigma_m(s.pixel, &run.noise);
                readings.push(Reading { run: s.run, frame: s.frame, point: *point, area_m2: s.area_m2, pixel_m, sigma_m });
            }
            Sample::Conflict { .. } => behind += s.area_m2,
            Sample::Match { .. } => {}
        }
    }
    let before: f64 = readings.iter().map(|r| r.area_m2).sum();
    if behind > OTHER_SIDE * before {
        return Vec::new();
    }
    let radius_m = work.twin.radius_m();
    let least_m2 = AREA_M2.max(AREA_SHARE * radius_m * radius_m);
    let voxel_m = (VOXEL_SHARE * radius_m).clamp(VOXEL_M[0], VOXEL_M[1]);
    let mut found = Vec::new();
    while found.len() < MOST {
        let pieces = (0..work.twin.parts.len()).filter_map(|p| piece(work, &stage, &readings, p, voxel_m));
        let Some(best) = pieces.max_by(|a, b| a.area_m2.total_cmp(&b.area_m2).then(b.part.cmp(&a.part))) else { break };
        if best.area_m2 < least_m2 {
            break;
        }
        readings.retain(|r| !best.covers(&stage.parts[r.run], &r.point));
        found.push(best);
    }
    found
}

/// Distance from which a reading does not belong to the surface.
fn gate(work: &Work, hypothesis: &Hypothesis, options: &FrameOptions) -> f64 {
    let samples = compare(work.twin, work.runs, &work.pixels, hypothesis, super::fit::GATE_M);
    let mut sigmas: Vec<f64> =
        samples.iter().filter_map(|s| if let Sample::Match { sigma_m, .. } = s.sample { Some(sigma_m) } else { None }).collect();
    sigmas.sort_unstable_by(f64::total_cmp);
    let high = sigmas.get(sigmas.len() * 9 / 10).copied().unwrap_or_default();
    OFF_M.max(ACCURACIES * options.accuracy_m).max(SIGMAS * high)
}

/// The largest connected piece of readings that stand still in a part's frame.
fn piece(work: &Work, stage: &Stage, readings: &[Reading], part: usize, voxel_m: f64) -> Option<Missing> {
    let mut seen: BTreeMap<Voxel, BTreeSet<(usize, usize)>> = BTreeMap::new();
    let place = |r: &Reading| stage.parts[r.run][part].inverse_transform_point(&r.point);
    for r in readings {
        seen.entry(voxel(&place(r), voxel_m)).or_default().insert((r.run, r.frame));
    }
    let frames: usize = work.runs.iter().map(|r| r.frames.len()).sum();
    let enough = |views: &BTreeSet<(usize, usize)>| {
        let runs: BTreeSet<usize> = views.iter().map(|v| v.0).collect();
        views.len() as f64 >= (FRAMES * frames as f64).max(2.0).min(frames as f64) && runs.len() as f64 >= RUNS * work.runs.len() as f64
    };
    let mut open: BTreeSet<Voxel> = seen.iter().filter(|(_, v)| enough(v)).map(|(k, _)| *k).collect();
    let mut best: BTreeSet<Voxel> = BTreeSet::new();
    while let Some(first) = open.pop_first() {
        let (mut group, mut next) = (BTreeSet::from([first]), vec![first]);
        while let Some([x, y, z]) = next.pop() {
            for n in 0..27 {
                let near = [x + n % 3 - 1, y + n / 3 % 3 - 1, z + n / 9 - 1];
                if open.remove(&near) {
                    group.insert(near);
                    next.push(near);
                }
            }
        }
        if group.len() > best.len() {
            best = group;
        }
    }
    let own: Vec<&Reading> = readings.iter().filter(|r| best.contains(&voxel(&place(r), voxel_m))).collect();
    let mut by_frame: BTreeMap<(usize, usize), f64> = BTreeMap::new();
    for r in &own {
        *by_frame.entry((r.run, r.frame)).or_default() += r.area_m2;
    }
    let points: Vec<Point3<f64>> = own.iter().map(|r| place(r)).collect();
    let area_m2 = by_frame.values().copied().fold(0.0, f64::max);
    let mut views: BTreeMap<(usize, usize), Vec<Point3<f64>>> = BTreeMap::new();
    for (r, p) in own.iter().zip(&points) {
        views.entry((r.run, r.frame)).or_default().push(*p);
    }
    let count = own.len().max(1) as f64;
    let border_m = (BORDER as f64 + 0.5) * own.iter().map(|r| r.pixel_m).sum::<f64>() / count;
    let noise_m = INTERVAL * own.iter().map(|r| r.sigma_m).sum::<f64>() / count;
    let (bounds, bounds_interval) = sides(&views.into_values().collect::<Vec<_>>(), border_m, noise_m)?;
    let area_interval = resampled(&by_frame.values().map(|a| vec![*a]).collect::<Vec<_>>(), |all| all.iter().copied().fold(0.0, f64::max));
    let area_interval = (area_interval.0, ((area_m2.sqrt() + 2.0 * border_m).powi(2)).max(area_interval.1));
    let frames = by_frame.len();
    Some(Missing { part, bounds, bounds_interval, area_m2, area_interval, frames, points, voxels: best, voxel_m })
}

/// The box of points by frames, and intervals of its sides: frames drawn anew, the noise of the readings, and outwards
/// the border of the twin's silhouette, within which pixels are not compared.
fn sides(views: &[Vec<Point3<f64>>], border_m: f64, noise_m: f64) -> Option<([[f64; 3]; 2], [[(f64, f64); 3]; 2])> {
    if views.iter().all(Vec::is_empty) {
        return None;
    }
    let (mut bounds, mut intervals) = ([[0.0; 3]; 2], [[(0.0, 0.0); 3]; 2]);
    for k in 0..3 {
        let along: Vec<Vec<f64>> = views.iter().map(|v| v.iter().map(|p| p[k]).collect()).collect();
        for (s, share) in [OUTER, 1.0 - OUTER].into_iter().enumerate() {
            bounds[s][k] = quantile(&along.concat(), share);
            let (low, high) = resampled(&along, |all| quantile(all, share));
            let (below, above) = if s == 0 { (border_m, 0.0) } else { (0.0, border_m) };
            intervals[s][k] = (low - noise_m - below, high + noise_m + above);
        }
    }
    Some((bounds, intervals))
}

/// The value below which a share of others lies.
fn quantile(all: &[f64], share: f64) -> f64 {
    let mut sorted = all.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}

/// 95 % interval of a statistic over groups that are drawn anew.
fn resampled(groups: &[Vec<f64>], statistic: impl Fn(&[f64]) -> f64) -> (f64, f64) {
    let rng = &mut stage_rng(0, "gap/missing", groups.len() as u64);
    let mut values: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let drawn: Vec<f64> = (0..groups.len()).flat_map(|_| groups[rng.next_u64() as usize % groups.len()].iter().copied()).collect();
            statistic(&drawn)
        })
        .collect();
    values.sort_unstable_by(f64::total_cmp);
    let cut = DRAWS / 40;
    (values[cut], values[DRAWS - 1 - cut])
}
