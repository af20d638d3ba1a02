//! Divides a motion shared by two parts. Parts with nearly the same motion, such as two drawers pulled
//! equally far, lie within reach of one motion between theirs. The surface is divided where the motion
//! changes. See docs/method.md 6.6.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Matrix6, Point3, SymmetricEigen, Vector3, Vector6};
use tracing::debug;

use crate::{
    pair::point_to_plane::{
        MovedCorrespondence, SAMPLES_PER_READING, correspondences, refined_motion, small_motion,
    },
    parts::{
        elimination::{SLIGHT, Step, best_motions},
        evidence_curve::{EvidencePoint, evidence_point},
        labeling::labels_and_costs,
        matched_pair::MatchedPair,
        score::{LEAST_SCORE, scores_and_shares, surface_evidence, unexplained_evidence, weighed_as},
        settle::settle_once,
        step_field::{Design, Reading, StepField, step_derivatives},
    },
    samples::spacing::cell_of,
};
use geometry::Pose;

/// Residuals beyond this share of the reach lose their weight (Geman-McClure).
/// tuned: shared/bags
const WIDE: f64 = 0.2;
/// Fewest correspondences on either side of a cut.
const LEAST_SIDE: usize = 60;
/// Cuts along each principal axis.
const CUTS: usize = 15;
/// Rounds in which the motions of both sides settle, at first without other parts.
const ROUNDS: usize = 3;
/// Least score of each half, as a share of the score of the single motion: errors grow with the surface.
/// tuned: shared/bags
const LEAST_ALONE: f64 = 0.025;
/// Standard deviation of a side's step from the shared motion, as a share of the reach.
/// chosen: two of them are the reach, and both motions lie within it
const STEP: f64 = 0.5;
/// Side of the surface blocks within which errors are correlated, in radii.
/// derived: a sixth of the side of a square plate of radius `side / sqrt 6`; see docs/method.md (8.10)
const BLOCK_RADII: f64 = 0.408;

/// Least-squares sums for a small motion.
#[derive(Clone, Copy)]
struct Sums {
    matrix: Matrix6<f64>,
    right: Vector6<f64>,
    squares: f64,
}

impl Sums {
    fn zero() -> Self {
        Self { matrix: Matrix6::zeros(), right: Vector6::zeros(), squares: 0.0 }
    }

    fn with_reading(mut self, r: &Reading) -> Self {
        self.matrix += r.row * r.row.transpose() * r.weight;
        // Negative: the step cancels the residuals.
        self.right -= r.row * (r.residual_m * r.weight);
        self.squares += r.residual_m * r.residual_m * r.weight;
        self
    }

    fn less(&self, other: &Self) -> Self {
        Self {
            matrix: self.matrix - other.matrix,
            right: self.right - other.right,
            squares: self.squares - other.squares,
        }
    }

    /// Sum of squares after the best step, and that step.
    fn best_step(&self, prior: f64) -> Option<(f64, Vector6<f64>)> {
        let step = (self.matrix + Matrix6::identity() * prior).cholesky()?.solve(&self.right);
        Some((self.squares - self.right.dot(&step), step))
    }
}

/// The correspondences of a motion, linearized for a small change of it.
struct Follower {
    readings: Vec<Reading>,
    /// Center after the motion; `radius_m` is the root mean square distance of the surface from it.
    center: Point3<f64>,
    radius_m: f64,
    /// Directions of cuts, unit vectors in state 0: principal axes of the points and of the normals.
    axes: Vec<Vector3<f64>>,
    /// Prior information on the step of either side.
    prior: f64,
}

impl Follower {
    /// The cut with the lowest sum of squares, if it lowers the sum by more than errors along the surface
    /// could.
    fn best_cut(mut self, motion: &Pose) -> Option<Cut> {
        let mut best: Option<(f64, Cut)> = None;
        for axis in &self.axes {
            let along = |r: &Reading| axis.dot(&r.place.coords);
            self.readings.sort_by(|a, b| along(a).total_cmp(&along(b)));
            // Running sums give both sides of every cut: a cut costs two small systems, not a pass.
            let mut whole = Sums::zero();
            let mut sums = Vec::with_capacity(self.readings.len());
            for r in &self.readings {
                whole = whole.with_reading(r);
                sums.push(whole);
            }
            let one = whole.best_step(self.prior)?.0;
            let firsts = (1..=CUTS).map(|c| sums.len() * c / (CUTS + 1));
            for first in firsts.filter(|f| (*f).min(sums.len() - f) >= LEAST_SIDE) {
                let sides = [sums[first - 1], whole.less(&sums[first - 1])].map(|s| s.best_step(self.prior));
                let [Some(a), Some(b)] = sides else { continue };
                // The decrease of docs/method.md (6.11).
                let fall = one - a.0 - b.0;
                if fall > best.as_ref().map_or(0.0, |b| b.0) {
                    let steps = [a.1, b.1];
                    let motions = steps.map(|twist| {
                        let turn = twist.fixed_rows::<3>(0) / self.radius_m;
                        small_motion(&self.center, &turn, &twist.fixed_rows::<3>(3).into_owned()) * motion
                    });
                    let at_m = 0.5 * (along(&self.readings[first - 1]) + along(&self.readings[first]));
                    best = Some((fall, Cut { axis: *axis, at_m, steps, motions }));
                }
            }
        }
        let cut = best?.1;
        let field =
            StepField { readings: &self.readings, prior: self.prior, dispersion: self.dispersion(&cut) };
        let second = |r: &Reading| f64::from(u8::from(cut.axis.dot(&r.place.coords) > cut.at_m));
        // Penalty for choosing among this many equally likely cuts.
        let cuts = (CUTS * self.axes.len()) as f64;
        let divided =
            field.log_evidence(&|r| step_derivatives(r, &[1.0 - second(r), second(r)]))? - cuts.ln();
        let one = field.log_evidence(&|r| step_derivatives(r, &[1.0]))?;
        let by_sensor =
            self.sensor_errors(motion).iter().filter_map(|m| field.log_evidence(m)).fold(one, f64::max);
        (divided > by_sensor).then_some(cut)
    }

    /// Design matrices of the errors a depth sensor may make on one part: it bends the surface (its step
    /// changes linearly along one direction or all), and displaces it along its normals, uniformly or
    /// depending on place and facing. See docs/method.md 6.6.
    fn sensor_errors(&self, motion: &Pose) -> Vec<Box<Design<'_>>> {
        let n = self.readings.len() as f64;
        let middle = self.readings.iter().map(|r| r.place.coords).sum::<Vector3<f64>>() / n;
        let radius_m = self.radius_m;
        let along = move |r: &Reading| (r.place.coords - middle) / radius_m;
        let back = motion.rotation.inverse();
        let bends = self.axes.iter().map(move |axis| -> Box<Design<'_>> {
            Box::new(move |r| step_derivatives(r, &[1.0, axis.dot(&along(r))]))
        });
        let further: [Box<Design<'_>>; 3] = [
            Box::new(move |r| step_derivatives(r, &[1.0, along(r).x, along(r).y, along(r).z])),
            Box::new(|r| [step_derivatives(r, &[1.0]), vec![1.0]].concat()),
            Box::new(move |r| {
                let facing = back * r.row.fixed_rows::<3>(3).into_owned();
                [&step_derivatives(r, &[1.0])[..], &[1.0], along(r).as_slice(), facing.as_slice()].concat()
            }),
        ];
        bends.chain(further).collect()
    }

    /// How strongly the residuals after a cut are correlated: the mean square of the weighted block sums over
    /// that of independent readings, at least 1. See docs/method.md 6.6.
    fn dispersion(&self, cut: &Cut) -> f64 {
        let block_m = BLOCK_RADII * self.radius_m;
        let mut blocks: BTreeMap<(bool, [i64; 3]), (f64, f64)> = BTreeMap::new();
        for r in &self.readings {
            let second = cut.axis.dot(&r.place.coords) > cut.at_m;
            let left_m = r.residual_m + r.row.dot(&cut.steps[usize::from(second)]);
            let (sum, weight) = blocks.entry((second, cell_of(&r.place, block_m))).or_default();
            *sum += r.weight * left_m;
            *weight += r.weight;
        }
        let squares: f64 = blocks.values().map(|(sum, weight)| sum * sum / weight).sum();
        (squares / blocks.len().max(1) as f64).max(1.0)
    }
}

/// Where a motion changes: a plane through the surface of state 0, and the motion on either side.
struct Cut {
    axis: Vector3<f64>,
    at_m: f64,
    /// Step of the motion on either side: rotation vector in radii, shift.
    steps: [Vector6<f64>; 2],
    motions: [Pose; 2],
}

/// Adds sets with divided motions as long as two motions explain clearly more than one. They start from the
/// best set, and replace sets of as many motions that leave more surface unexplained.
pub(crate) fn add_divided_sets(pair: &MatchedPair<'_>, steps: &mut Vec<Step>) {
    let mut motions = best_motions(steps);
    while let Some(divided) = divided_motions(pair, &motions) {
        let (scores, shares) = scores_and_shares(pair, &divided);
        let point =
            EvidencePoint { unexplained: unexplained_evidence(pair, &divided), ..evidence_point(&scores) };
        // If another set of as many motions leaves less unexplained, division adds nothing.
        if steps.iter().any(|s| s.point.parts == point.parts && s.point.unexplained < point.unexplained) {
            break;
        }
        debug!(
            parts = point.parts,
            evidence_cells = point.evidence,
            weakest_cells = point.weakest,
            unexplained = point.unexplained,
            "motion divided"
        );
        motions.clone_from(&divided);
        steps.retain(|s| s.point.parts != point.parts);
        steps.push(Step { motions: divided, point, shares, divided: true });
    }
    steps.sort_by_key(|s| std::cmp::Reverse(s.point.parts));
}

/// The motions, with the one that is best divided replaced by two; `None` if no two explain clearly more than
/// one with each explaining something alone.
fn divided_motions(pair: &MatchedPair<'_>, motions: &[Pose]) -> Option<Vec<Pose>> {
    let found = labels_and_costs(&pair.surfaces, motions);
    let (labels, _) = &*found;
    let (scores, _) = weighed_as(pair, motions, labels);
    // Depth errors along a surface give two motions nearly as much evidence together, but not to either
    // alone.
    let slight = SLIGHT * LEAST_SCORE;
    let mut best = (slight, None);
    // Each half must later stand by itself: with less than twice the least evidence, a cut is not worth it.
    for (k, motion) in motions.iter().enumerate().skip(1).filter(|(k, _)| scores[*k] >= 2.0 * LEAST_SCORE) {
        let Some(cut) = follower_of(pair, labels, motion, k as u8).and_then(|f| f.best_cut(motion)) else {
            continue;
        };
        let mut set = motions.to_vec();
        let [first, second] = settled_sides(pair, labels, k as u8, motion, cut);
        set[k] = first;
        set.insert(k + 1, second);
        // A cut is a plane; the border of the parts need not be: labels and motions then settle freely.
        (0..ROUNDS).for_each(|_| settle_once(pair, &mut set));
        let found = labels_and_costs(&pair.surfaces, &set);
        let (after, _) = &*found;
        let gain = evidence_gain(pair, k, [motions, &set], [labels, after]);
        let alone = slight.max(LEAST_ALONE * scores[k]);
        if gain > best.0 && weighed_as(pair, &set, after).0[k..=k + 1].iter().all(|score| *score >= alone) {
            best = (gain, Some(set));
        }
    }
    best.1
}

/// Evidence gained by two motions (`k` and `k + 1` of the second set) over one (`k` of the first): a sixth of
/// the cells of its surface, each weighted by the decrease of its cost. Both sets come with their labels.
fn evidence_gain(
    pair: &MatchedPair<'_>,
    k: usize,
    [motions, set]: [&[Pose]; 2],
    [labels, after]: [&[Vec<u8>; 2]; 2],
) -> f64 {
    let mut sum = 0.0;
    let mut count = 0;
    for s in 0..2 {
        count += labels[s].len();
        let costs = [motions, set].map(|all| pair.surfaces.shape_costs(s, all, None));
        for (i, (before, after)) in
            labels[s].iter().zip(&after[s]).map(|(b, a)| (usize::from(*b), usize::from(*a))).enumerate()
        {
            if before == k && (k..=k + 1).contains(&after) {
                let [was, is] = [costs[0][i * motions.len() + before], costs[1][i * set.len() + after]];
                sum += f64::from(was.min(1.0) - is.min(1.0));
            }
        }
    }
    surface_evidence(pair, sum / count.max(1) as f64)
}

/// The correspondences of a motion; `None` if there are too few to cut.
fn follower_of(pair: &MatchedPair<'_>, labels: &[Vec<u8>; 2], motion: &Pose, label: u8) -> Option<Follower> {
    let planes = correspondences(&pair.surfaces, [&labels[0], &labels[1]], motion, label);
    if planes.len() < 2 * LEAST_SIDE {
        return None;
    }
    let n = planes.len() as f64;
    let middle = Point3::from(planes.iter().map(|p| p.source.coords).sum::<Vector3<f64>>() / n);
    let spread: Matrix3<f64> =
        planes.iter().map(|p| p.source - middle).map(|v| v * v.transpose()).sum::<Matrix3<f64>>() / n;
    // In radii, a turn and a shift move the surface alike, so one prior serves both.
    let radius_m = spread.trace().sqrt().max(1e-9);
    let center = motion * middle;
    let sigma_m = pair.surfaces.scales.plane_m;
    let wide_m = WIDE * pair.surfaces.reach_m;
    let mut faces = Matrix3::zeros();
    let mut readings = Vec::with_capacity(planes.len());
    for p in &planes {
        let MovedCorrespondence { point, normal, residual_m } = p.under(motion);
        let own = motion.inverse_transform_vector(&normal);
        faces += own * own.transpose();
        let turn = (point - center).cross(&normal) / radius_m;
        let z = residual_m / wide_m;
        let weight = (sigma_m * (1.0 + z * z)).powi(-2) / SAMPLES_PER_READING;
        readings.push(Reading {
            place: p.source,
            row: Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z),
            residual_m,
            weight,
        });
    }
    // Parts lie beside each other along the principal directions of the surface or of its face normals; these
    // differ where the surface is as broad as long.
    let eigen = [spread, faces].map(SymmetricEigen::new);
    let columns = eigen.iter().flat_map(|e| e.eigenvectors.column_iter());
    let axes: Vec<Vector3<f64>> = columns.map(|c| c.into_owned()).collect();
    Some(Follower { readings, center, radius_m, axes, prior: (STEP * pair.surfaces.reach_m).powi(-2) })
}

/// The motions on both sides of a cut after settling.
fn settled_sides(
    pair: &MatchedPair<'_>,
    labels: &[Vec<u8>; 2],
    label: u8,
    motion: &Pose,
    cut: Cut,
) -> [Pose; 2] {
    let back = motion.inverse();
    let sides = [0, 1].map(|s| {
        let mut sides = Vec::with_capacity(labels[s].len());
        for (p, l) in pair.surfaces.samples[s].points.iter().zip(&labels[s]) {
            // The cut is given in state 0.
            let first = if s == 0 { *p } else { back * p };
            let side = 1 + u8::from(cut.axis.dot(&first.coords) > cut.at_m);
            sides.push(if *l == label { side } else { 0 });
        }
        sides
    });
    let mut motions = cut.motions;
    for _ in 0..ROUNDS {
        for (k, m) in motions.iter_mut().enumerate() {
            *m = refined_motion(&pair.surfaces, [&sides[0], &sides[1]], &[], m, 1 + k as u8);
        }
    }
    motions
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        pair::surface_pair::{FreeSpace, SurfacePair},
        parts::registrar::FIRST_REACH,
        samples::{
            spacing::reach_m,
            synthetic::{Scene, camera_ring},
        },
    };

    /// How far the drawers of a chest were pulled, by one motion divided where that is called for.
    fn pulled_m(true_m: [f64; 2]) -> Vec<f64> {
        const EXTENT_M: f64 = 0.5;
        let scene = Scene::two_drawers(true_m);
        let cameras = camera_ring(10);
        let surfaces = [0, 1].map(|s| scene.surface(s, &cameras, 0.008).0);
        let [first, second] = &surfaces;
        let is_free = [0, 1].map(|s| {
            let scene = &scene;
            let cameras = &cameras;
            move |p: &Point3<f64>| scene.is_free(s, cameras, p)
        });
        let free: [Option<FreeSpace<'_>>; 2] = [Some(&is_free[0]), Some(&is_free[1])];
        let mut surfaces =
            SurfacePair::new([first, second], free, reach_m([first, second], FIRST_REACH * EXTENT_M));
        // As of measured depth: one motion explains both drawers, a little off.
        surfaces.scales.plane_m = 0.001;
        let pair = MatchedPair::new(&[], EXTENT_M, surfaces);
        let shared = [Pose::identity(), Pose::translation(0.0, -0.5 * (true_m[0] + true_m[1]), 0.0)];
        let mut found: Vec<f64> = divided_motions(&pair, &shared).unwrap_or(shared.to_vec())[1..]
            .iter()
            .map(|m| -m.translation.y)
            .collect();
        found.sort_by(f64::total_cmp);
        found
    }

    #[test]
    fn a_motion_between_those_of_two_drawers_is_divided() {
        let found = pulled_m([0.1, 0.104]);
        assert!(
            found.len() == 2 && (found[0] - 0.1).abs() < 5e-4 && (found[1] - 0.104).abs() < 5e-4,
            "{found:?}"
        );
    }

    #[test]
    fn a_motion_that_two_drawers_share_is_not() {
        assert_eq!(pulled_m([0.1, 0.1]), [0.1]);
    }
}
