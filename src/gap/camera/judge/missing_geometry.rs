//! Geometry of the object missing in the twin. See docs/method.md 15.9.
//!
//! Signature: readings in front of the twin's surface, or beside it, at the same place of one part in many
//! frames and states, and hardly any behind it. A misplaced part gives both.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Point3;

use crate::camera::{
    fit::{
        components::VarianceComponents,
        problem::FrameProblem,
        residual::compared_pixels,
        sample::{Conflict, Sample},
    },
    judge::missing_box::{box_sides, largest_area},
    model::{
        hypothesis::Hypothesis,
        missing::{Missing, Voxel, voxel_of},
        posed::PosedTwin,
    },
    record::pixels::BORDER,
};
use numeric::statistics::HALF_WIDTH_95;

/// A reading farther off the surface than this many standard deviations (reading and unnamed errors) is
/// outside it.
///
/// chosen: one of 16 000 readings of a normal distribution
const SIGMAS: f64 = 4.0;
/// Side of a voxel as a share of the object's size: two spacings of a frame's samples.
///
/// derived: 2 sqrt(pi / 2500), for 2500 samples of `Pixels` on a disc
const VOXEL: f64 = 0.071;
/// Least area of a region, in faces of a voxel: wider than one voxel.
///
/// tuned: made objects (tests/gap_frames.rs)
const LEAST_FACES: f64 = 2.25;
/// Most readings behind the twin for each reading in front of it.
///
/// chosen: midway between none, for missing geometry, and as many, for a misplaced part
const OTHER_SIDE: f64 = 0.5;
/// Least share of the frames with readings in a voxel.
///
/// tuned: made objects (tests/gap_frames.rs)
const FRAMES: f64 = 0.1;
/// Most regions reported.
const MOST: usize = 4;

/// A run and one of its frames.
type View = (usize, usize);

/// A reading in front of the twin.
struct Reading {
    run: usize,
    frame: usize,
    point: Point3<f64>,
    area_m2: f64,
    /// Width of a pixel at the reading, meters.
    pixel_m: f64,
    /// Standard deviation of the reading, meters.
    sigma_m: f64,
}

/// Finds regions of missing geometry, largest first.
pub fn missing_geometry(problem: &FrameProblem, hypothesis: &Hypothesis) -> Vec<Missing> {
    let posed = PosedTwin::new(problem.twin, problem.runs, hypothesis);
    let (mut readings, behind_m2) = readings_before(problem, hypothesis);
    let before_m2: f64 = readings.iter().map(|r| r.area_m2).sum();
    if behind_m2 > OTHER_SIDE * before_m2 {
        return Vec::new();
    }
    let voxel_m = (VOXEL * problem.scales.radius_m).max(SIGMAS * problem.scales.reading_m);
    let least_m2 = LEAST_FACES * voxel_m * voxel_m;
    let mut found = Vec::new();
    while found.len() < MOST {
        let regions = (0..problem.twin.parts.len())
            .filter_map(|p| largest_region(problem, &posed, &readings, p, voxel_m));
        let largest = regions.max_by(|a, b| a.area_m2.total_cmp(&b.area_m2).then(b.part.cmp(&a.part)));
        let Some(best) = largest.filter(|m| m.area_m2 >= least_m2) else { break };
        // Each reading belongs to one region only.
        readings.retain(|r| !best.covers(&posed.parts[r.run], &r.point));
        found.push(best);
    }
    found
}

/// Readings in front of the twin's surface, and the area of those behind it.
fn readings_before(problem: &FrameProblem, hypothesis: &Hypothesis) -> (Vec<Reading>, f64) {
    let gate_m = gate_m(problem, hypothesis);
    let samples = compared_pixels(problem.twin, problem.runs, &problem.pixels, hypothesis, gate_m);
    let mut readings: Vec<Reading> = Vec::new();
    let mut behind_m2 = 0.0;
    for s in samples.iter().filter(|s| !problem.is_held_out(s.frame)) {
        match &s.sample {
            Sample::Conflict { kind: Conflict::Nearer, point, .. } => {
                let run = &problem.runs[s.run];
                readings.push(Reading {
                    run: s.run,
                    frame: s.frame,
                    point: *point,
                    area_m2: s.area_m2,
                    pixel_m: s.area_m2.sqrt() / problem.pixels.stride_of(s.run, s.frame).max(1) as f64,
                    sigma_m: run.frames[s.frame].sigma_m(s.pixel, &run.noise),
                });
            }
            Sample::Conflict { .. } => behind_m2 += s.area_m2,
            Sample::Match { .. } => {}
        }
    }
    (readings, behind_m2)
}

/// Least distance of a reading off the surface, meters: the camera's errors, the unnamed errors and the
/// twin's own errors together.
fn gate_m(problem: &FrameProblem, hypothesis: &Hypothesis) -> f64 {
    let samples = compared_pixels(problem.twin, problem.runs, &problem.pixels, hypothesis, problem.gate_m());
    let mut sigmas: Vec<f64> = samples
        .iter()
        .filter_map(|s| if let Sample::Match { sigma_m, .. } = s.sample { Some(sigma_m) } else { None })
        .collect();
    sigmas.sort_unstable_by(f64::total_cmp);
    let high = sigmas.get(sigmas.len() * 9 / 10).copied().unwrap_or_default();
    let unnamed_m = VarianceComponents::middle_of_grid(&problem.scales).total_m();
    // docs/method.md (15.10).
    SIGMAS * high.hypot(unnamed_m).hypot(problem.twin.own.surface_m)
}

/// The largest connected region of readings fixed in a part's frame.
fn largest_region(
    problem: &FrameProblem,
    posed: &PosedTwin,
    readings: &[Reading],
    part: usize,
    voxel_m: f64,
) -> Option<Missing> {
    let place = |r: &Reading| posed.parts[r.run][part].inverse_transform_point(&r.point);
    let mut seen: BTreeMap<Voxel, BTreeSet<View>> = BTreeMap::new();
    for r in readings {
        seen.entry(voxel_of(&place(r), voxel_m)).or_default().insert((r.run, r.frame));
    }
    let voxels =
        largest_group(seen.iter().filter(|(_, v)| is_confirmed(problem, v)).map(|(k, _)| *k).collect());
    let own: Vec<&Reading> =
        readings.iter().filter(|r| voxels.contains(&voxel_of(&place(r), voxel_m))).collect();
    let mut views: BTreeMap<View, (f64, Vec<Point3<f64>>)> = BTreeMap::new();
    for r in &own {
        let view = views.entry((r.run, r.frame)).or_default();
        view.0 += r.area_m2;
        view.1.push(place(r));
    }
    let mean = |of: fn(&Reading) -> f64| own.iter().map(|r| of(r)).sum::<f64>() / own.len().max(1) as f64;
    // Pixels this near the outline are not compared: the region may extend that much farther.
    let border_m = (BORDER as f64 + 0.5) * mean(|r| r.pixel_m);
    let (areas, clouds): (Vec<f64>, Vec<_>) = views.into_values().unzip();
    let (bounds, bounds_interval) = box_sides(&clouds, border_m, HALF_WIDTH_95 * mean(|r| r.sigma_m))?;
    let (area_m2, area_interval) = largest_area(&areas, border_m);
    Some(Missing { part, bounds, bounds_interval, area_m2, area_interval, voxels, voxel_m })
}

/// Whether enough frames of most runs see a voxel: then no other joint position explains it.
fn is_confirmed(problem: &FrameProblem, views: &BTreeSet<View>) -> bool {
    let frames: usize = problem.runs.iter().map(|r| r.frames.len()).sum();
    let runs: BTreeSet<usize> = views.iter().map(|v| v.0).collect();
    views.len() as f64 >= (FRAMES * frames as f64).max(2.0).min(frames as f64)
        && 2 * runs.len() > problem.runs.len()
}

/// The largest group of voxels connected by faces, edges or corners.
fn largest_group(mut open: BTreeSet<Voxel>) -> BTreeSet<Voxel> {
    let mut best: BTreeSet<Voxel> = BTreeSet::new();
    while let Some(first) = open.pop_first() {
        let mut group = BTreeSet::from([first]);
        let mut next = vec![first];
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
    best
}
