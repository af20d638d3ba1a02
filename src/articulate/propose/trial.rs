//! Possible motions of a patch of surface to the other state, alone or following the motion of the body it is
//! on: slid along its normal and edges, turned about its edges, and turned into the plane of each patch there
//! (where the axis is parallel to both planes, one shift is unknown). See docs/method.md 6.5.

use nalgebra::{Point3, Rotation3, Unit, UnitQuaternion, Vector3};
use rayon::prelude::*;

use crate::{
    pair::{
        point_to_plane::refined_motion, reprojection::EXPLAINED, surface_pair::SurfacePair,
        unexplained::Unexplained,
    },
    propose::{agreement::mean_rough, patch::Patch, search::Search},
    samples::hinge::{HINGE, PARALLEL, axis_of_turn},
};
use geometry::{Pose, Screw};

/// Number of points of a patch in a trial.
const TRIAL_POINTS: usize = 60;
/// Number of points of a body's surface when looking for patches near it; fewer when looking for an axis near
/// it.
const SURFACE_POINTS: usize = 600;
const EVERY: usize = 4;
/// Number of trials of each kind, per patch, whose worth for all unexplained surface is measured.
const DISTINCT: usize = 16;
/// Number of trials refined per patch.
const REFINED: usize = 4;
/// Rounds of refinement of a trial.
const ROUNDS: usize = 5;
/// Least agreement of a patch with its motion: share on unexplained surface of the other state less share in
/// empty space. tuned: shared/bags
const AGREEMENT: f64 = 0.35;
/// The same for a patch on a moving part, which is tried in more places.
/// tuned: shared/bags
const FIRM_AGREEMENT: f64 = 0.6;
/// Distance between two trials, as a share of the reach.
/// chosen: below the reach: some trial comes near enough for partners to be found
const STEP: f64 = 0.7;
/// Samples may be of a patch's part within this many times half its diagonal, plus the reach.
/// chosen: patches miss their rims
const ABOUT: f64 = 1.2;

/// The part a patch may be attached to, in one state.
struct CarryingPart {
    /// Its motion to the other state.
    carried: Pose,
    /// Points that its motion takes onto a surface there and that are not at rest; `None` for the static
    /// part.
    surface: Option<Vec<Point3<f64>>>,
}

impl CarryingPart {
    fn new(search: &Search<'_, '_>, state: usize, motion: &Pose) -> Self {
        let carried = if state == 0 { *motion } else { motion.inverse() };
        let still = search.bodies[0];
        let surface = (*motion != still).then(|| {
            let costs = search.pair.shape_costs(state, &[still, *motion], None);
            let points = costs.chunks_exact(2).zip(&search.pair.samples[state].points);
            let moved = points.filter(|(row, _)| row[0] >= EXPLAINED && row[1] < EXPLAINED);
            let all: Vec<Point3<f64>> = moved.map(|(_, p)| *p).collect();
            all.iter().copied().step_by(all.len().div_ceil(SURFACE_POINTS).max(1)).collect()
        });
        Self { carried, surface }
    }

    /// Whether it is near a patch; the static part is near every patch.
    fn touches(&self, points: &[Point3<f64>], patch: &Patch, near_m: f64) -> bool {
        let Some(surface) = &self.surface else { return true };
        some_of(patch).iter().any(|&i| surface.iter().any(|p| (p - points[i]).norm() < near_m))
    }

    /// Keeps, of the trials, slides and turns about an axis near its surface; each is then followed by its
    /// own motion.
    fn followed_by(&self, mut trials: Vec<Pose>, near_m: f64) -> Vec<Pose> {
        if let Some(surface) = &self.surface {
            let there: Vec<Point3<f64>> = surface.iter().step_by(EVERY).map(|p| self.carried * p).collect();
            trials.retain(|t| {
                axis_of_turn(t).is_none_or(|axis| {
                    there.iter().any(|p| (p - axis.point).cross(&axis.direction).norm() < near_m)
                })
            });
        }
        trials.into_iter().map(|t| t * self.carried).collect()
    }

    /// Least agreement a patch must have with a motion.
    fn least_agreement(&self) -> f64 {
        if self.surface.is_some() { FIRM_AGREEMENT } else { AGREEMENT }
    }
}

/// Motions, from state 0 to state 1, of the unexplained patches of each state that may be attached to a body.
pub(crate) fn motions_on(search: &Search<'_, '_>, motion: &Pose, patches: &[Vec<Patch>; 2]) -> Vec<Pose> {
    let near_m = HINGE * search.extent_m;
    let mut all = Vec::new();
    for state in [0, 1] {
        let body = CarryingPart::new(search, state, motion);
        let points = &search.pair.samples[state].points;
        for patch in &patches[state] {
            let left = patch.samples.iter().filter(|&&i| search.left.open[state][i]).count();
            if 2 * left > patch.samples.len() && body.touches(points, patch, near_m) {
                all.extend(motions_of(search, state, patch, &body, &patches[1 - state]));
            }
        }
    }
    all
}

/// Some samples of a patch.
fn some_of(patch: &Patch) -> Vec<usize> {
    patch.samples.iter().copied().step_by(patch.samples.len().div_ceil(TRIAL_POINTS)).collect()
}

/// The best motions of a patch attached to a body, refined.
fn motions_of(
    search: &Search<'_, '_>,
    state: usize,
    patch: &Patch,
    body: &CarryingPart,
    onto: &[Patch],
) -> Vec<Pose> {
    let pair = search.pair;
    let left = &search.left;
    let step_m = STEP * pair.reach_m;
    let some = some_of(patch);
    let carried = patch.under(&body.carried);
    let [slides, turns] = own_trials(&carried, step_m, search.extent_m);
    let planes = onto.iter().flat_map(|p| plane_trials(&carried, p, step_m)).collect();
    // Each kind keeps its own best trials: turns are tried by the hundred and would crowd out slides.
    let kinds = [slides, turns, planes].map(|trials| body.followed_by(trials, HINGE * search.extent_m));
    let mut best: Vec<(f64, Pose)> =
        kinds.iter().flat_map(|t| distinct_trials(search, state, &some, t)).collect();
    best.sort_by(|a, b| b.0.total_cmp(&a.0));
    let labels = near_labels(pair, state, patch, left);
    let mut refined = Vec::new();
    for &(_, start) in best.iter().take(REFINED) {
        let mut motion = start;
        // Refined with the patch's own surroundings alone: surface of other parts would attract the trial.
        for _ in 0..ROUNDS {
            motion = refined_motion(pair, [&labels[0], &labels[1]], &[], &motion, 1);
        }
        let there = if state == 0 { motion } else { motion.inverse() };
        if mean_rough(pair, left, state, &patch.samples, &there) > body.least_agreement() {
            refined.push(motion);
        }
    }
    refined
}

/// Possible motions of a patch itself to the other state: slides and turns.
fn own_trials(patch: &Patch, step_m: f64, extent_m: f64) -> [Vec<Pose>; 2] {
    let steps = (extent_m / step_m) as i64;
    let slides = patch.axes.iter().flat_map(|axis| {
        let axis = *axis;
        (-steps..=steps)
            .filter(|k| *k != 0)
            .map(move |k| Pose::from_parts((axis * (k as f64 * step_m)).into(), UnitQuaternion::identity()))
    });
    let [a, b, n] = patch.axes;
    let [ha, hb] = patch.half_m;
    // A hinge is along an edge of the panel, or perpendicular to it through its center or an edge.
    let lines = [
        (b, a * ha),
        (b, -a * ha),
        (a, b * hb),
        (a, -b * hb),
        (n, Vector3::zeros()),
        (n, a * ha),
        (n, -a * ha),
        (n, b * hb),
        (n, -b * hb),
    ];
    // Turned by this angle, the far side moves by one step of a slide.
    let turn_step = step_m / (2.0 * ha.max(hb)).max(step_m);
    // Half a turn takes a patch to its own plane, end for end: `end_for_end.rs` decides about it.
    let turns = ((std::f64::consts::PI - 2.0 * PARALLEL) / turn_step) as i64;
    let turned = lines.into_iter().flat_map(move |(direction, offset)| {
        let screw = Screw {
            direction: Unit::new_normalize(direction),
            point: patch.center + offset,
            angle_rad: 0.0,
            advance_m: 0.0,
        };
        (-turns..=turns).filter(|k| *k != 0).map(move |k| screw.motion_by(k as f64 * turn_step, 0.0))
    });
    [slides.collect(), turned.collect()]
}

/// Motions of a patch into the plane of another about a line parallel to both planes; one shift perpendicular
/// to this line is unknown and tried in steps.
fn plane_trials(patch: &Patch, onto: &Patch, step_m: f64) -> Vec<Pose> {
    let n0 = patch.axes[2];
    let n1 = onto.axes[2];
    let angle = n0.angle(&n1);
    // Parallel planes fix the shift along the normal and leave the rest open; opposite ones leave the axis
    // open, so both edges are tried.
    let directions = if angle < PARALLEL {
        let there = onto.center - patch.center;
        return vec![Pose::from_parts((n0 * n0.dot(&there)).into(), UnitQuaternion::identity())];
    } else if angle > std::f64::consts::PI - PARALLEL {
        vec![patch.axes[0], patch.axes[1]]
    } else {
        vec![n0.cross(&n1).normalize()]
    };
    let mut all = Vec::new();
    for u in directions {
        let rotation = Rotation3::from_axis_angle(&Unit::new_normalize(u), angle);
        let center = rotation * patch.center;
        let v = n1.cross(&u);
        let to_plane = n1 * n1.dot(&(onto.center - center));
        // From where the patches begin to overlap to where they no longer do.
        let range_m = onto.half_extent_m(&v) + patch.half_extent_m(&(rotation.inverse() * v));
        let steps = (range_m / step_m) as i64;
        let middle = v.dot(&(onto.center - center));
        all.extend((-steps..=steps).map(|k| {
            let shift = to_plane + v * (middle + k as f64 * step_m);
            Pose::from_parts(shift.into(), UnitQuaternion::from_rotation_matrix(&rotation))
        }));
    }
    all
}

/// The best trials of a patch that differ from each other, from state 0 to state 1, each with its worth for
/// all unexplained surface.
fn distinct_trials(
    search: &Search<'_, '_>,
    state: usize,
    some: &[usize],
    trials: &[Pose],
) -> Vec<(f64, Pose)> {
    let pair = search.pair;
    let mut scored: Vec<(f64, usize)> = trials
        .par_iter()
        .enumerate()
        .map(|(i, t)| (mean_rough(pair, &search.left, state, some, t), i))
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let points = &pair.samples[state].points;
    let mut best: Vec<Pose> = Vec::new();
    for &(_, i) in scored.iter().take_while(|s| s.0 > 0.5 * AGREEMENT) {
        if best.len() >= DISTINCT {
            break;
        }
        // Trials near the best one agree nearly as well, and refinement would give the same motion.
        let is_known = best
            .iter()
            .any(|b| some.iter().all(|&j| (b * points[j] - trials[i] * points[j]).norm() < pair.reach_m));
        if !is_known {
            best.push(trials[i]);
        }
    }
    best.into_par_iter()
        .map(|t| if state == 0 { t } else { t.inverse() })
        .map(|m| (search.rough_worth(&m), m))
        .collect()
}

/// Label 1 for the unexplained samples around a patch, and for all unexplained samples of the other state:
/// they may be of its part.
fn near_labels(pair: &SurfacePair<'_>, state: usize, patch: &Patch, left: &Unexplained) -> [Vec<u8>; 2] {
    let radius_m = ABOUT * patch.half_m[0].hypot(patch.half_m[1]) + pair.reach_m;
    [0, 1].map(|s| {
        let samples = pair.samples[s].points.iter().zip(&left.open[s]);
        samples
            .map(|(p, open)| u8::from(*open && (s != state || (p - patch.center).norm() < radius_m)))
            .collect()
    })
}
