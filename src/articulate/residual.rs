//! Motions proposed by geometry: patches of surface that were left behind in one state and turn up in the other.
//!
//! Where a surface of one state lies in space that the other state saw empty, and no known motion takes it onto a surface,
//! it moved by an unknown one. Most parts slide along a normal or an edge of their face or turn about one of its edges:
//! these motions are tried in steps and the best are refined. Plain surfaces, which give no matches, are found so.

use nalgebra::{Matrix3, Point3, Rotation3, SymmetricEigen, Unit, Vector3};
use rayon::prelude::*;

use super::{
    labeling::{Evidence, FREE},
    refine::refine,
};
use crate::geometry::{Pose, Screw};

/// A sample is explained by a motion of a lower cost.
const EXPLAINED: f32 = 0.5;
/// Patches tried per state.
const PATCHES: usize = 8;
/// A patch must have this share of a state's samples: less could not outweigh the cost of a part.
const LEAST_SHARE: f64 = 0.004;
/// Points of a patch that a trial looks at.
const TRIAL_POINTS: usize = 80;
/// Trials refined per patch.
const REFINED: usize = 4;
/// Rounds of refinement of a trial.
const ROUNDS: usize = 12;
/// Share of a patch that a motion must take onto moved surface of the other state.
const LANDED: f64 = 0.6;
/// Largest rotation that is tried, radians.
const LARGEST_TURN: f64 = 2.9;

/// Samples of each state that moved, by no motion of `motions` (the first is the static part's).
pub(crate) fn unexplained(evidence: &Evidence<'_>, motions: &[Pose]) -> [Vec<bool>; 2] {
    [0, 1].map(|s| {
        let costs = evidence.costs(s, motions, None);
        let free = evidence.free[1 - s].is_some();
        let left = |row: &[f32]| (!free || row[0] >= FREE) && row.iter().all(|c| *c >= EXPLAINED);
        costs.chunks_exact(motions.len()).map(left).collect()
    })
}

/// Motions from state 0 to state 1 that take unexplained patches onto unexplained surface, best first.
pub(crate) fn propose_from_residual(evidence: &Evidence<'_>, motions: &[Pose], extent_m: f64) -> Vec<Pose> {
    let moved = unexplained(evidence, motions);
    let mut found: Vec<(f64, Pose)> = Vec::new();
    for state in [0, 1] {
        for patch in patches(evidence, state, &moved[state]) {
            found.extend(motions_of(evidence, state, &patch, &moved, extent_m));
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept: Vec<Pose> = Vec::new();
    let apart = |a: &Pose, b: &Pose| {
        // Where the surface is: motions that differ nowhere by more than the reach are one.
        let differ = |p: &Point3<f64>| (a * p - b * p).norm() > evidence.reach_m;
        evidence.samples[0].points.iter().step_by(97).any(differ)
    };
    for (_, motion) in found {
        if kept.iter().all(|k| apart(k, &motion)) {
            kept.push(motion);
        }
    }
    kept
}

/// A flat patch of moved surface.
struct Patch {
    samples: Vec<usize>,
    center: Point3<f64>,
    /// Two edges and the normal, unit.
    axes: [Vector3<f64>; 3],
    /// Half sides along the edges, metres.
    half_m: [f64; 2],
}

/// The largest moved patches of a state.
fn patches(evidence: &Evidence<'_>, state: usize, moved: &[bool]) -> Vec<Patch> {
    let samples = evidence.samples[state];
    let mut of: Vec<(u32, usize)> = (0..moved.len()).filter(|&i| moved[i]).map(|i| (evidence.patch(state, i), i)).collect();
    of.sort_unstable();
    let least = (LEAST_SHARE * moved.len() as f64).max(12.0) as usize;
    let mut groups: Vec<Vec<usize>> =
        of.chunk_by(|a, b| a.0 == b.0).filter(|g| g.len() >= least).map(|g| g.iter().map(|x| x.1).collect()).collect();
    groups.sort_by(|a, b| b.len().cmp(&a.len()).then(a[0].cmp(&b[0])));
    groups.truncate(PATCHES);
    groups.into_iter().filter_map(|g| patch(samples, g)).collect()
}

fn patch(samples: &super::SurfaceSamples, group: Vec<usize>) -> Option<Patch> {
    let n = group.len() as f64;
    let center = Point3::from(group.iter().map(|&i| samples.points[i].coords).sum::<Vector3<f64>>() / n);
    let normal = group.iter().map(|&i| samples.normals[i]).sum::<Vector3<f64>>().try_normalize(1e-9)?;
    let across = Matrix3::identity() - normal * normal.transpose();
    let spread: Matrix3<f64> = group.iter().map(|&i| across * (samples.points[i] - center)).map(|v| v * v.transpose()).sum();
    let eigen = SymmetricEigen::new(spread);
    let long = across * eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let long = square(samples, &group, &center, &normal, long.try_normalize(1e-9)?);
    let short = normal.cross(&long);
    let half_m = [long, short].map(|axis| {
        let mut along: Vec<f64> = group.iter().map(|&i| axis.dot(&(samples.points[i] - center)).abs()).collect();
        along.sort_by(f64::total_cmp);
        along[along.len() * 49 / 50]
    });
    Some(Patch { samples: group, center, axes: [long, short, normal], half_m })
}

/// The direction in the plane along which the box around the patch is smallest: principal directions of a square are any.
fn square(
    samples: &super::SurfaceSamples,
    group: &[usize],
    center: &Point3<f64>,
    normal: &Vector3<f64>,
    start: Vector3<f64>,
) -> Vector3<f64> {
    const STEPS: usize = 30;
    let turned = |k: usize| {
        let angle = std::f64::consts::FRAC_PI_2 * k as f64 / STEPS as f64;
        Rotation3::from_axis_angle(&Unit::new_unchecked(*normal), angle) * start
    };
    let area = |axis: &Vector3<f64>| {
        let side = |d: &Vector3<f64>| {
            let along = group.iter().map(|&i| d.dot(&(samples.points[i] - center)));
            let [lo, hi] = along.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], x| [lo.min(x), hi.max(x)]);
            hi - lo
        };
        side(axis) * side(&normal.cross(axis))
    };
    (0..STEPS).map(turned).min_by(|a, b| area(a).total_cmp(&area(b))).unwrap_or(start)
}

/// Motions that a patch could have made, to the other state.
fn trials(patch: &Patch, step_m: f64, extent_m: f64) -> Vec<Pose> {
    let steps = (extent_m / step_m) as i64;
    let slides = patch.axes.iter().flat_map(|axis| {
        let axis = *axis;
        (-steps..=steps)
            .filter(|k| *k != 0)
            .map(move |k| Pose::from_parts((axis * (k as f64 * step_m)).into(), nalgebra::UnitQuaternion::identity()))
    });
    let [a, b, n] = patch.axes;
    let [ha, hb] = patch.half_m;
    let lines =
        [(b, a * ha), (b, -a * ha), (a, b * hb), (a, -b * hb), (n, Vector3::zeros()), (n, a * ha), (n, -a * ha), (n, b * hb), (n, -b * hb)];
    let turn_step = step_m / (2.0 * ha.max(hb)).max(step_m);
    let turns = (LARGEST_TURN / turn_step) as i64;
    let turned = lines.into_iter().flat_map(move |(direction, offset)| {
        let screw = Screw { direction: Unit::new_normalize(direction), point: patch.center + offset, angle_rad: 0.0, advance_m: 0.0 };
        (-turns..=turns).filter(|k| *k != 0).map(move |k| screw.motion_by(k as f64 * turn_step, 0.0))
    });
    slides.chain(turned).collect()
}

/// The best motions of a patch from state 0 to state 1, refined, each with the number of samples it takes to a partner.
fn motions_of(evidence: &Evidence<'_>, state: usize, patch: &Patch, moved: &[Vec<bool>; 2], extent_m: f64) -> Vec<(f64, Pose)> {
    let every = patch.samples.len().div_ceil(TRIAL_POINTS);
    let some: Vec<usize> = patch.samples.iter().copied().step_by(every).collect();
    let trials = trials(patch, 0.7 * evidence.reach_m, extent_m);
    let mut scored: Vec<(f64, usize)> =
        trials.par_iter().enumerate().map(|(i, t)| (landed(evidence, state, &some, t, &moved[1 - state]), i)).collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    // Moved samples alone take part in the refinement.
    let labels = [0, 1].map(|s| moved[s].iter().map(|m| u8::from(*m)).collect::<Vec<u8>>());
    let mut tried: Vec<&Pose> = Vec::new();
    let mut found = Vec::new();
    for &(score, i) in scored.iter().take_while(|s| s.0 > 0.5 * LANDED) {
        let near = |t: &&Pose| {
            some.iter().all(|&j| {
                (*t * evidence.samples[state].points[j] - trials[i] * evidence.samples[state].points[j]).norm() < 2.0 * evidence.reach_m
            })
        };
        if tried.len() >= REFINED || score <= 0.0 {
            break;
        }
        if tried.iter().any(near) {
            continue;
        }
        tried.push(&trials[i]);
        let mut motion = if state == 0 { trials[i] } else { trials[i].inverse() };
        for _ in 0..ROUNDS {
            motion = refine(evidence, [&labels[0], &labels[1]], &[], &motion, 1);
        }
        let there = if state == 0 { motion } else { motion.inverse() };
        let share = landed(evidence, state, &patch.samples, &there, &moved[1 - state]);
        if share > LANDED {
            found.push((share * patch.samples.len() as f64, motion));
        }
    }
    found
}

/// Share of samples that a motion takes onto moved surface of the other state, each the less the farther it lands.
fn landed(evidence: &Evidence<'_>, state: usize, samples: &[usize], other_from_this: &Pose, moved: &[bool]) -> f64 {
    let (these, others) = (evidence.samples[state], evidence.samples[1 - state]);
    let one = |&i: &usize| {
        let (point, normal) = (other_from_this * these.points[i], other_from_this * these.normals[i]);
        let partner = evidence.indices[1 - state].nearest(&point, &normal).filter(|&j| moved[j]);
        partner.map_or(0.0, |j| 1.0 - 0.5 * (point - others.points[j]).norm_squared() / evidence.reach_m.powi(2))
    };
    samples.iter().map(one).sum::<f64>() / samples.len().max(1) as f64
}
