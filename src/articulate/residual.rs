//! Motions proposed by geometry: patches of surface that were left behind in one state and turn up in the other.
//!
//! Where a surface of one state lies in space that the other state saw empty, and no known motion takes it onto a surface,
//! it moved by an unknown one. Patches of such surface are tried on those of the other state: slid along their normal and
//! edges, turned about their edges, and turned into the plane of each patch there, which leaves one shift unknown where the
//! axis lies in both planes' directions. The best are refined and taken one after the other, each with the surface that it
//! explains. Plain surfaces, which give no matches, are found so.

use nalgebra::{Point3, Rotation3, Unit, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::{
    labeling::{EDGE, Evidence, FREE},
    part_count::CONTRADICTED,
    patch::{Band, Patch, faces, patches},
    refine::refine,
    slip::{Slip, slips},
};
use crate::geometry::{Pose, Screw};

/// A sample is explained by a motion of a lower cost.
pub(super) const EXPLAINED: f32 = 0.5;
/// Patches tried per state.
const PATCHES: usize = 12;
/// What a motion explains must have this share of all samples: less could not outweigh the cost of a part.
pub(super) const LEAST_SHARE: f64 = 0.004;
/// A patch that is tried must have this share of a state's samples: what slid within its plane leaves but a strip, and explains more.
const LEAST_PATCH: f64 = 0.001;
/// Points of a patch that a trial looks at.
const TRIAL_POINTS: usize = 60;
/// Trials of each kind of which the worth for all unexplained surface is measured, per patch.
const DISTINCT: usize = 16;
/// Trials refined per patch.
const REFINED: usize = 4;
/// Finest step of a motion that is polished, as a share of the reach.
const FINEST: f64 = 0.03;
/// Tolerance of a landing against the scale of planes while motions are polished.
const SOFT: f64 = 1.5;
/// A slide that explains this share of what a small turn explains is as good.
const AS_MUCH: f64 = 0.95;
/// Rounds of refinement of a trial.
const ROUNDS: usize = 5;
/// Agreement of a patch with its motion: share on unexplained surface of the other state less share in empty space.
const AGREEMENT: f64 = 0.35;
/// Largest rotation that is tried, radians.
const LARGEST_TURN: f64 = 2.9;
/// What lies between two strips of one plane is surface if it has this share of the samples of its area.
const FILLED: f64 = 0.5;
/// Planes at a smaller angle are parallel, radians.
pub(super) const PARALLEL: f64 = 0.1;

/// Angle between two colors that counts as one standard deviation, radians, and length of a color that has no hue.
const HUE_SIGMA: f64 = 0.12;
const DARK: f64 = 0.08;
/// Distance of an axis from both surfaces that it joins at which half of what speaks for a hinge is lost, as a share of the
/// object's longest side.
pub(super) const HINGE: f64 = 0.05;
/// Worth of a turn about an axis in thin air against that about a hinge: links in a chain may turn so.
const DETACHED: f64 = 0.1;

/// Samples of each state that no motion explains, and those of them that moved (the first motion is the static part's).
struct Unexplained {
    /// Samples that no motion takes onto a surface.
    open: [Vec<bool>; 2],
    /// Those of them whose place was seen empty in the other state.
    moved: [Vec<bool>; 2],
}

impl Unexplained {
    /// What `motions` leave.
    fn of(evidence: &Evidence<'_>, motions: &[Pose]) -> Self {
        let both = [0, 1].map(|s| {
            let costs = evidence.shape_costs(s, motions, None);
            let free = evidence.free[1 - s].is_some();
            let open: Vec<bool> = costs.chunks_exact(motions.len()).map(|row| row.iter().all(|c| *c >= EXPLAINED)).collect();
            let left = |(row, open): (&[f32], &bool)| *open && (!free || row[0] >= FREE);
            let moved = costs.chunks_exact(motions.len()).zip(&open).map(left).collect();
            (open, moved)
        });
        let [(open0, moved0), (open1, moved1)] = both;
        Self { open: [open0, open1], moved: [moved0, moved1] }
    }

    /// Whether a landing of a sample on one of the other state calls for a motion: both are open, and one of the two is where
    /// the other state saw nothing. Surface that doors hid in turn may look alike by chance.
    fn calls_for(&self, state: usize, sample: usize, partner: usize) -> bool {
        self.open[1 - state][partner] && (self.moved[state][sample] || self.moved[1 - state][partner])
    }

    /// Patches of those `faces` of a state that hold samples which moved.
    fn patches(&self, evidence: &Evidence<'_>, state: usize, faces: &[Vec<usize>]) -> Vec<Patch> {
        let least = (LEAST_PATCH * self.open[state].len() as f64).max(12.0) as usize;
        patches(evidence, state, faces, &self.moved[state], least, PATCHES)
    }

    /// Opens what lies between two strips of one plane, one left in state 0 and one reached in state 1: where a plain panel slides
    /// within its plane, what it covers in both states seems to stand still.
    fn join_slid(&mut self, evidence: &Evidence<'_>) {
        let strips = [0, 1].map(|s| self.patches(evidence, s, &faces(evidence, s, &self.moved[s])));
        for left in &strips[0] {
            for reached in &strips[1] {
                let Some(between) = Band::between(left, reached, 0.5 * evidence.reach_m) else { continue };
                let inside = evidence.samples.map(|of| {
                    let holds = |i: &usize| between.holds(&of.points[*i], &of.normals[*i]);
                    (0..of.points.len()).filter(holds).collect::<Vec<usize>>()
                });
                let full = |s: usize| inside[s].len() as f64 > FILLED * between.area_m2() / evidence.spacing_m[s].powi(2);
                if full(0) && full(1) {
                    for s in 0..2 {
                        for &i in &inside[s] {
                            (self.open[s][i], self.moved[s][i]) = (true, true);
                        }
                    }
                }
            }
        }
    }
}

/// Samples of each state that moved, by no motion of `motions`.
pub(crate) fn unexplained(evidence: &Evidence<'_>, motions: &[Pose]) -> [Vec<bool>; 2] {
    Unexplained::of(evidence, motions).moved
}

/// Motions from state 0 to state 1 that take unexplained patches onto unexplained surface, best first, each judged by the
/// surface that the ones before leave.
pub(crate) fn propose_from_residual(evidence: &Evidence<'_>, motions: &[Pose], extent_m: f64) -> Vec<Pose> {
    let mut search = Search::new(evidence, motions, extent_m);
    let least = LEAST_SHARE * search.left.open.iter().map(Vec::len).sum::<usize>() as f64;
    let found = [0, 1].map(|s| search.left.patches(evidence, s, &search.faces[s]));
    let mut candidates: Vec<Pose> = Vec::new();
    for state in [0, 1] {
        for patch in &found[state] {
            candidates.extend(motions_of(&search, state, patch, &found[1 - state]));
        }
    }
    let mut kept: Vec<Pose> = Vec::new();
    while !candidates.is_empty() {
        let worths: Vec<(f64, f64)> = candidates.par_iter().map(|m| search.worth(m)).collect();
        let enough = worths.iter().enumerate().filter(|(_, w)| w.1 >= least);
        let Some((best, _)) = enough.max_by(|a, b| a.1.0.total_cmp(&b.1.0).then(b.0.cmp(&a.0))) else { break };
        let motion = search.polished(&candidates.swap_remove(best));
        search.explain(&motion);
        kept.push(motion);
    }
    kept
}

/// What the search for motions knows.
struct Search<'a, 'b> {
    evidence: &'a Evidence<'b>,
    extent_m: f64,
    left: Unexplained,
    /// Unexplained samples of each state by plane.
    faces: [Vec<Vec<usize>>; 2],
    /// Motions known so far.
    bodies: Vec<Pose>,
}

impl<'a, 'b> Search<'a, 'b> {
    fn new(evidence: &'a Evidence<'b>, motions: &[Pose], extent_m: f64) -> Self {
        let mut left = Unexplained::of(evidence, motions);
        left.join_slid(evidence);
        let faces = [0, 1].map(|s| faces(evidence, s, &left.open[s]));
        Self { evidence, extent_m, left, faces, bodies: motions.to_vec() }
    }
}

impl Search<'_, '_> {
    /// What a motion explains, weighed by what speaks for a hinge, and unweighed, in samples.
    fn worth(&self, motion: &Pose) -> (f64, f64) {
        let gains = gain(self.evidence, motion, &self.left, &self.faces);
        let total: f64 = gains.iter().flatten().sum();
        (total * attachment(self.evidence, motion, &self.bodies, &gains[0], &self.left.open[0], self.extent_m), total)
    }

    /// The same by some of the samples and for a motion that is a step off.
    fn rough_worth(&self, motion: &Pose) -> f64 {
        self.worth_by(motion, 7, |s, i, t| landing(self.evidence, s, i, t, &self.left.open[1 - s]))
    }

    /// The same by some of the samples, where a landing beyond an edge is none.
    fn sharp_worth(&self, motion: &Pose) -> f64 {
        self.worth_by(motion, 5, |s, i, t| self.sharp_landing(s, i, t))
    }

    /// What a motion explains by every so many samples of each face and what each landing says.
    fn worth_by(&self, motion: &Pose, every: usize, landing: impl Fn(usize, usize, &Pose) -> f64) -> f64 {
        let mut total = 0.0;
        let mut gains = vec![0.0; self.left.open[0].len()];
        for s in 0..2 {
            let other_from_this = if s == 0 { *motion } else { motion.inverse() };
            for face in &self.faces[s] {
                let values: Vec<(usize, f64)> = face.iter().step_by(every).map(|&i| (i, landing(s, i, &other_from_this))).collect();
                let sum: f64 = values.iter().map(|v| v.1).sum();
                total += sum.max(0.0);
                if s == 0 && sum > 0.0 {
                    values.iter().for_each(|(i, v)| gains[*i] = *v);
                }
            }
        }
        total * attachment(self.evidence, motion, &self.bodies, &gains, &self.left.open[0], self.extent_m)
    }

    /// The motion near by that explains most, a slide rather than a small turn where it explains as much.
    fn polished(&self, motion: &Pose) -> Pose {
        let Some(slips) = self.slips(motion) else { return *motion };
        let (worth, best) = self.climbed(motion, slips, |pose| self.slips(pose));
        if best.rotation.angle() > PARALLEL {
            return best;
        }
        let center = self.center(&best);
        let slide = Pose::from_parts((best * center - center).into(), UnitQuaternion::identity());
        let (slide_worth, slide) = self.climbed(&slide, [0, 1, 2].map(|k| Slip::along(Vector3::ith(k, 1.0))), |_| None);
        if slide_worth >= AS_MUCH * worth { slide } else { best }
    }

    /// The motion that explains most of those that steps along slips lead to, with its worth. What a point-to-plane fit leaves free
    /// (slips of the surface in itself: Gelfand and Guibas 2004) shows at edges alone: steps are halved where none helps.
    fn climbed(&self, motion: &Pose, mut slips: [Slip; 3], anew: impl Fn(&Pose) -> Option<[Slip; 3]>) -> (f64, Pose) {
        let (mut best, mut step_m) = (*motion, 2.0 * self.evidence.reach_m);
        let mut worth = self.sharp_worth(&best);
        while step_m > FINEST * self.evidence.reach_m {
            let moves: Vec<Pose> = slips.iter().flat_map(|slip| [step_m, -step_m].map(|m| slip.by(m) * best)).collect();
            let tried: Vec<(f64, Pose)> = moves.into_par_iter().map(|p| (self.sharp_worth(&p), p)).collect();
            let (next, pose) = tried.into_iter().fold((f64::NEG_INFINITY, best), |a, b| if b.0 > a.0 { b } else { a });
            if next > worth {
                (worth, best) = (next, pose);
            } else {
                step_m *= 0.5;
                slips = anew(&best).unwrap_or(slips);
            }
        }
        (worth, best)
    }

    /// Middle of the surface of state 0 that a motion explains.
    fn center(&self, motion: &Pose) -> Point3<f64> {
        let explained = self.explained(motion);
        let points = &self.evidence.samples[0].points;
        Point3::from(explained.iter().map(|&i| points[i].coords).sum::<Vector3<f64>>() / explained.len().max(1) as f64)
    }

    /// Samples of state 0 that a motion explains.
    fn explained(&self, motion: &Pose) -> Vec<usize> {
        let [gains, _] = gain(self.evidence, motion, &self.left, &self.faces);
        (0..gains.len()).filter(|&i| gains[i] > 0.0).collect()
    }

    /// Slips of what a motion explains, where it lands.
    fn slips(&self, motion: &Pose) -> Option<[Slip; 3]> {
        let samples = self.evidence.samples[0];
        let landed = |i: usize| (motion * samples.points[i], motion * samples.normals[i]);
        slips(&self.explained(motion).into_iter().map(landed).collect::<Vec<_>>())
    }

    /// What one landing says while a motion is polished: up to 1 on unexplained surface within its edges, -[`CONTRADICTED`] in
    /// empty space.
    fn sharp_landing(&self, state: usize, sample: usize, other_from_this: &Pose) -> f64 {
        let evidence = self.evidence;
        let (these, others) = (evidence.samples[state], evidence.samples[1 - state]);
        let (point, normal) = (other_from_this * these.points[sample], other_from_this * these.normals[sample]);
        let partner = evidence.indices[1 - state].nearest(&point, &normal).and_then(|j| {
            let (off_m, aside) = evidence.offset(1 - state, j, &point);
            let z = off_m / (SOFT * evidence.scales.plane_m);
            let likeness = if self.left.calls_for(state, sample, j) { same_hue(these.colors[sample], others.colors[j]) } else { 0.0 };
            (aside < EDGE).then_some(6.0 / (6.0 + z * z) * likeness)
        });
        match partner {
            Some(v) if v > 0.5 => v,
            _ if evidence.free[1 - state].is_some_and(|f| f(&point)) => -CONTRADICTED,
            v => v.unwrap_or(0.0),
        }
    }

    /// Takes what a motion explains out of what is left.
    fn explain(&mut self, motion: &Pose) {
        let explained = gain(self.evidence, motion, &self.left, &self.faces);
        for s in 0..2 {
            for (i, _) in explained[s].iter().enumerate().filter(|(_, g)| **g > 0.0) {
                self.left.open[s][i] = false;
                self.left.moved[s][i] = false;
            }
        }
        self.bodies.push(*motion);
    }
}

/// How well a turn about its axis could be that of a hinge, from [`DETACHED`] to 1: its axis, relative to one of the `bodies`,
/// runs close by both the surface that moves (of positive `gains`) and surface that other motions explain. Slides could be any.
fn attachment(evidence: &Evidence<'_>, motion: &Pose, bodies: &[Pose], gains: &[f64], open: &[bool], extent_m: f64) -> f64 {
    const EVERY: usize = 13;
    let points = &evidence.samples[0].points;
    let of = |body: &Pose| {
        let relative = body.inverse() * motion;
        let Some(screw) = Screw::of(&relative).filter(|s| s.angle_rad.abs() > PARALLEL) else { return 1.0 };
        let along = |p: &Point3<f64>| screw.direction.dot(&(p - screw.point));
        let distance = |p: &Point3<f64>| ((p - screw.point) - screw.direction.into_inner() * along(p)).norm();
        let (mut part_m, mut span) = (f64::INFINITY, [f64::INFINITY, f64::NEG_INFINITY]);
        for p in points.iter().zip(gains).filter(|(_, g)| **g > 0.0).map(|(p, _)| p) {
            part_m = part_m.min(distance(p));
            span = [span[0].min(along(p)), span[1].max(along(p))];
        }
        let beside = |p: &&Point3<f64>| (span[0]..=span[1]).contains(&along(p));
        let others = points.iter().zip(open).filter(|(_, o)| !**o).map(|(p, _)| p).step_by(EVERY);
        let other_m = others.filter(beside).map(distance).fold(f64::INFINITY, f64::min);
        let off = (part_m + other_m) / (HINGE * extent_m);
        DETACHED + (1.0 - DETACHED) / (1.0 + off * off)
    };
    bodies.iter().map(of).fold(0.0, f64::max)
}

/// What landing says for a motion: 1 to 0.5 on unexplained surface of the other state, the less the farther; -1 in empty
/// space; 0 where nothing was seen or another motion explains what is there.
fn landing(evidence: &Evidence<'_>, state: usize, sample: usize, other_from_this: &Pose, open: &[bool]) -> f64 {
    let (these, others) = (evidence.samples[state], evidence.samples[1 - state]);
    let (point, normal) = (other_from_this * these.points[sample], other_from_this * these.normals[sample]);
    match evidence.indices[1 - state].nearest(&point, &normal) {
        Some(j) if open[j] => {
            let near = 1.0 - 0.5 * (point - others.points[j]).norm_squared() / evidence.reach_m.powi(2);
            near * same_hue(these.colors[sample], others.colors[j])
        }
        Some(_) => 0.0,
        None => evidence.free[1 - state].map_or(0.0, |is_free| if is_free(&point) { -1.0 } else { 0.0 }),
    }
}

/// How well two colors could be one surface in different light, which scales all channels alike: 1 to 0 by the angle between
/// them.
fn same_hue(a: [f32; 3], b: [f32; 3]) -> f64 {
    let [a, b] = [a, b].map(|c| Vector3::from(c).cast::<f64>());
    if a.norm().min(b.norm()) < DARK { 1.0 } else { (-0.5 * (a.angle(&b) / HUE_SIGMA).powi(2)).exp() }
}

/// Mean landing of samples.
fn landed(evidence: &Evidence<'_>, state: usize, samples: &[usize], other_from_this: &Pose, open: &[bool]) -> f64 {
    samples.iter().map(|&i| landing(evidence, state, i, other_from_this, open)).sum::<f64>() / samples.len().max(1) as f64
}

/// What a motion explains of the unexplained samples, patch by patch: a patch of which it takes more into empty space than
/// onto surface counts nothing.
fn gain(evidence: &Evidence<'_>, motion: &Pose, left: &Unexplained, faces: &[Vec<Vec<usize>>; 2]) -> [Vec<f64>; 2] {
    [0, 1].map(|s| {
        let other_from_this = if s == 0 { *motion } else { motion.inverse() };
        let mut gains = vec![0.0; left.open[s].len()];
        for face in &faces[s] {
            let of: Vec<(usize, f64)> = face
                .iter()
                .filter(|&&i| left.open[s][i])
                .map(|&i| {
                    let (cost, partner) = evidence.shape_landing(s, i, &other_from_this);
                    let hue = |j: usize| same_hue(evidence.samples[s].colors[i], evidence.samples[1 - s].colors[j]);
                    (i, agreement(cost, partner.filter(|&j| left.calls_for(s, i, j)).map_or(0.0, hue)))
                })
                .collect();
            if of.iter().map(|v| v.1).sum::<f64>() > 0.0 {
                of.iter().for_each(|(i, v)| gains[*i] = *v);
            }
        }
        gains
    })
}

/// What the cost of a landing says for a motion: 1 on a perfect partner of likeness 1, -1 in empty space, 0 where nothing was
/// seen or something else stands.
fn agreement(cost: f32, likeness: f64) -> f64 {
    if cost >= FREE { -1.0 } else { likeness * (1.0 - 2.0 * f64::from(cost)).max(0.0) }
}

/// Motions that a patch could have made by itself, to the other state: slides and turns.
fn own_trials(patch: &Patch, step_m: f64, extent_m: f64) -> [Vec<Pose>; 2] {
    let steps = (extent_m / step_m) as i64;
    let slides = patch.axes.iter().flat_map(|axis| {
        let axis = *axis;
        (-steps..=steps).filter(|k| *k != 0).map(move |k| Pose::from_parts((axis * (k as f64 * step_m)).into(), UnitQuaternion::identity()))
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
    [slides.collect(), turned.collect()]
}

/// Motions that take a patch into the plane of another about a line parallel to both planes: one shift across that line is
/// unknown and tried in steps.
fn plane_trials(patch: &Patch, onto: &Patch, step_m: f64) -> Vec<Pose> {
    let (n0, n1) = (patch.axes[2], onto.axes[2]);
    let angle = n0.angle(&n1);
    let directions = if angle < PARALLEL {
        let there = onto.center - patch.center;
        return vec![Pose::from_parts((n0 * n0.dot(&there)).into(), UnitQuaternion::identity())];
    } else if angle > std::f64::consts::PI - PARALLEL {
        vec![patch.axes[0], patch.axes[1]]
    } else {
        vec![n0.cross(&n1).normalize()]
    };
    let side = |p: &Patch, v: &Vector3<f64>| p.axes[0].dot(v).abs() * p.half_m[0] + p.axes[1].dot(v).abs() * p.half_m[1];
    let mut all = Vec::new();
    for u in directions {
        let rotation = Rotation3::from_axis_angle(&Unit::new_normalize(u), angle);
        let (center, v) = (rotation * patch.center, n1.cross(&u));
        let to_plane = n1 * n1.dot(&(onto.center - center));
        let range_m = side(onto, &v) + side(patch, &(rotation.inverse() * v));
        let steps = (range_m / step_m) as i64;
        let middle = v.dot(&(onto.center - center));
        all.extend((-steps..=steps).map(|k| {
            let shift = to_plane + v * (middle + k as f64 * step_m);
            Pose::from_parts(shift.into(), UnitQuaternion::from_rotation_matrix(&rotation))
        }));
    }
    all
}

/// The best motions of a patch from state 0 to state 1, refined.
fn motions_of(search: &Search<'_, '_>, state: usize, patch: &Patch, onto: &[Patch]) -> Vec<Pose> {
    let (evidence, left) = (search.evidence, &search.left);
    let step_m = 0.7 * evidence.reach_m;
    let every = patch.samples.len().div_ceil(TRIAL_POINTS);
    let some: Vec<usize> = patch.samples.iter().copied().step_by(every).collect();
    let [slides, turns] = own_trials(patch, step_m, search.extent_m);
    let planes = onto.iter().flat_map(|p| plane_trials(patch, p, step_m)).collect();
    let mut best: Vec<(f64, Pose)> = [slides, turns, planes].iter().flat_map(|t| distinct_trials(search, state, &some, t)).collect();
    best.sort_by(|a, b| b.0.total_cmp(&a.0));
    let labels = near_labels(evidence, state, patch, left);
    let refined = |&(_, start): &(f64, Pose)| {
        let mut motion = start;
        for _ in 0..ROUNDS {
            motion = refine(evidence, [&labels[0], &labels[1]], &[], &motion, 1);
        }
        let there = if state == 0 { motion } else { motion.inverse() };
        (landed(evidence, state, &patch.samples, &there, &left.open[1 - state]) > AGREEMENT).then_some(motion)
    };
    best.iter().take(REFINED).filter_map(refined).collect()
}

/// The trials that agree best with a patch and differ from each other, from state 0 to state 1, each with its worth for all
/// unexplained surface.
fn distinct_trials(search: &Search<'_, '_>, state: usize, some: &[usize], trials: &[Pose]) -> Vec<(f64, Pose)> {
    let (evidence, open) = (search.evidence, &search.left.open[1 - state]);
    let mut scored: Vec<(f64, usize)> = trials.par_iter().enumerate().map(|(i, t)| (landed(evidence, state, some, t, open), i)).collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let points = &evidence.samples[state].points;
    let near = |a: &Pose, b: &Pose| some.iter().all(|&j| (a * points[j] - b * points[j]).norm() < evidence.reach_m);
    let mut best: Vec<Pose> = Vec::new();
    for &(_, i) in scored.iter().take_while(|s| s.0 > 0.5 * AGREEMENT) {
        if best.len() >= DISTINCT {
            break;
        }
        if best.iter().all(|b| !near(b, &trials[i])) {
            best.push(trials[i]);
        }
    }
    let forward = |t: Pose| if state == 0 { t } else { t.inverse() };
    best.into_par_iter().map(forward).map(|m| (search.rough_worth(&m), m)).collect()
}

/// Label 1 for the unexplained samples that may be the part of a patch: those about it, and all of the other state.
fn near_labels(evidence: &Evidence<'_>, state: usize, patch: &Patch, left: &Unexplained) -> [Vec<u8>; 2] {
    let radius_m = 1.2 * patch.half_m[0].hypot(patch.half_m[1]) + evidence.reach_m;
    [0, 1].map(|s| {
        let near = |p: &Point3<f64>| s != state || (p - patch.center).norm() < radius_m;
        evidence.samples[s].points.iter().zip(&left.open[s]).map(|(p, open)| u8::from(*open && near(p))).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::articulate::SurfaceSamples;

    #[test]
    fn a_plain_panel_slides_by_what_it_uncovers() {
        const SPACING_M: f64 = 0.01;
        let rectangle = |y: std::ops::Range<i64>, z: std::ops::Range<i64>| {
            y.flat_map(move |j| z.clone().map(move |k| Point3::new(0.0, SPACING_M * j as f64, SPACING_M * k as f64)))
        };
        let state = |shift: i64| {
            let points: Vec<Point3<f64>> = rectangle(-50..70, -20..-5).chain(rectangle(shift..shift + 40, 0..30)).collect();
            SurfaceSamples { normals: vec![Vector3::x(); points.len()], colors: vec![[0.5; 3]; points.len()], points }
        };
        let surfaces = [state(0), state(-15)];
        let seen_empty = |from_m: f64| {
            move |p: &Point3<f64>| p.x > 0.03 || (p.z > -0.005 && p.x > -0.03 && !(from_m - 0.005..from_m + 0.395).contains(&p.y))
        };
        let free = [seen_empty(0.0), seen_empty(-0.15)];
        let evidence = Evidence::new([&surfaces[0], &surfaces[1]], [Some(&free[0]), Some(&free[1])], 0.03);
        let found = propose_from_residual(&evidence, &[Pose::identity()], 1.2);
        let off_m = |p: Point3<f64>| (found[0] * p - p - Vector3::new(0.0, -0.15, 0.0)).norm();
        let panel = || rectangle(0..40, 0..30);
        let mean_m = panel().map(off_m).sum::<f64>() / panel().count() as f64;
        assert!(mean_m < 2.0 * SPACING_M, "{mean_m}");
    }
}
