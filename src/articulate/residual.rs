//! Motions proposed by geometry: patches of surface that were left behind in one state and turn up in the other.
//!
//! Where a surface of one state lies in space that the other state saw empty, and no known motion takes it onto a surface,
//! it moved by an unknown one. Patches of such surface are tried on those of the other state (`trial.rs`). The best motions are
//! polished and taken one after the other, each with the surface that it explains, and what may hang on it is tried. Plain surfaces,
//! which give no matches, are found so.

use nalgebra::{Point3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::{
    labeling::{EDGE, Evidence, FREE},
    part_count::CONTRADICTED,
    patch::{Band, Patch, faces, patches},
    slip::{Slip, slips},
    trial::motions_on,
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
/// Finest step of a motion that is polished, as a share of the reach.
const FINEST: f64 = 0.03;
/// Tolerance of a landing against the scale of planes while motions are polished.
const SOFT: f64 = 1.5;
/// A slide that explains this share of what a small turn explains is as good.
const AS_MUCH: f64 = 0.95;
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
pub(super) struct Unexplained {
    /// Samples that no motion takes onto a surface.
    pub open: [Vec<bool>; 2],
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
    let mut candidates: Vec<Pose> = motions.iter().flat_map(|body| motions_on(&search, body, &found)).collect();
    let mut kept: Vec<Pose> = Vec::new();
    while !candidates.is_empty() {
        let worths: Vec<(f64, f64)> = candidates.par_iter().map(|m| search.worth(m)).collect();
        let enough = worths.iter().enumerate().filter(|(_, w)| w.1 >= least);
        let Some((best, _)) = enough.max_by(|a, b| a.1.0.total_cmp(&b.1.0).then(b.0.cmp(&a.0))) else { break };
        let motion = search.polished(&candidates.swap_remove(best));
        search.explain(&motion);
        candidates.extend(motions_on(&search, &motion, &found));
        kept.push(motion);
    }
    kept
}

/// What the search for motions knows.
pub(super) struct Search<'a, 'b> {
    pub evidence: &'a Evidence<'b>,
    pub extent_m: f64,
    pub left: Unexplained,
    /// Unexplained samples of each state by plane.
    faces: [Vec<Vec<usize>>; 2],
    /// Motions known so far, that of the static part first.
    pub bodies: Vec<Pose>,
}

impl<'a, 'b> Search<'a, 'b> {
    pub fn new(evidence: &'a Evidence<'b>, motions: &[Pose], extent_m: f64) -> Self {
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
    pub fn rough_worth(&self, motion: &Pose) -> f64 {
        self.weighed(motion, self.total_by(motion, 7, |s, i, t| landing(self.evidence, s, i, t, &self.left.open[1 - s])))
    }

    /// The same by some of the samples, where a landing beyond an edge is none.
    fn sharp_worth(&self, motion: &Pose) -> f64 {
        self.weighed(motion, self.sharp_total(motion))
    }

    /// The same unweighed, with the share of every sample of state 0.
    pub fn sharp_total(&self, motion: &Pose) -> (f64, Vec<f64>) {
        self.total_by(motion, 5, |s, i, t| self.sharp_landing(s, i, t))
    }

    /// What a motion explains, with the share of every sample of state 0, weighed by what speaks for a hinge.
    fn weighed(&self, motion: &Pose, (total, gains): (f64, Vec<f64>)) -> f64 {
        total * attachment(self.evidence, motion, &self.bodies, &gains, &self.left.open[0], self.extent_m)
    }

    /// What a motion explains by every so many samples of each face and what each landing says, with the share of every sample of
    /// state 0.
    fn total_by(&self, motion: &Pose, every: usize, landing: impl Fn(usize, usize, &Pose) -> f64) -> (f64, Vec<f64>) {
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
        (total, gains)
    }

    /// The motion near by that explains most, a slide rather than a small turn where it explains as much; that of a round part after
    /// any turn.
    fn polished(&self, motion: &Pose) -> Pose {
        let sharp_worth = |m: &Pose| self.sharp_worth(m);
        let Some(slips) = self.slips(motion) else { return *motion };
        let (worth, best) = self.climbed(motion, slips, sharp_worth, |pose| self.slips(pose));
        if best.rotation.angle() > PARALLEL {
            return self.swivelled(&best).unwrap_or(best);
        }
        let center = self.center(&best);
        let slide = Pose::from_parts((best * center - center).into(), UnitQuaternion::identity());
        let along = [0, 1, 2].map(|k| Slip::along(Vector3::ith(k, 1.0)));
        let (slide_worth, slide) = self.climbed(&slide, along, sharp_worth, |_| None);
        let best = if slide_worth >= AS_MUCH * worth { slide } else { best };
        self.swivelled(&best).unwrap_or(best)
    }

    /// The motion that explains most of those that steps along slips lead to, with its worth. What a point-to-plane fit leaves free
    /// (slips of the surface in itself: Gelfand and Guibas 2004) shows at edges alone: steps are halved where none helps.
    pub fn climbed(
        &self,
        motion: &Pose,
        mut slips: [Slip; 3],
        worth_of: impl Fn(&Pose) -> f64 + Sync,
        anew: impl Fn(&Pose) -> Option<[Slip; 3]>,
    ) -> (f64, Pose) {
        let (mut best, mut step_m) = (*motion, 2.0 * self.evidence.reach_m);
        let mut worth = worth_of(&best);
        while step_m > FINEST * self.evidence.reach_m {
            let moves: Vec<Pose> = slips.iter().flat_map(|slip| [step_m, -step_m].map(|m| slip.by(m) * best)).collect();
            let tried: Vec<(f64, Pose)> = moves.into_par_iter().map(|p| (worth_of(&p), p)).collect();
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

    /// What a motion explains, points and normals, where it lands.
    pub fn landed(&self, motion: &Pose) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
        let samples = self.evidence.samples[0];
        self.explained(motion).into_iter().map(|i| (motion * samples.points[i], motion * samples.normals[i])).unzip()
    }

    /// Slips of what a motion explains, where it lands.
    pub fn slips(&self, motion: &Pose) -> Option<[Slip; 3]> {
        let (points, normals) = self.landed(motion);
        slips(&points, &normals)
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
pub(super) fn landed(evidence: &Evidence<'_>, state: usize, samples: &[usize], other_from_this: &Pose, open: &[bool]) -> f64 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::articulate::{SurfaceSamples, synthetic::Scene};

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

    #[test]
    fn an_arm_on_an_arm_is_found_by_the_arm_that_it_hangs_on() {
        // About axes that are not parallel: in the world the second arm neither slides nor turns about an edge of its own.
        let mut scene = Scene { texture: 0.0, ..Scene::lamp() };
        let twist = Screw { direction: Vector3::x_axis(), point: Point3::new(0.0, 0.0, 0.33), angle_rad: 0.9, advance_m: 0.0 };
        scene.parts[2].motion = scene.parts[1].motion * twist.motion();
        scene.seen(0.006, 0.012, |evidence, labels| {
            let found = propose_from_residual(&evidence, &[Pose::identity()], 0.4);
            let all = &evidence.samples[0].points;
            for part in [1, 2] {
                let points: Vec<&Point3<f64>> = all.iter().zip(&labels[0]).filter(|(_, l)| **l == part).map(|(p, _)| p).collect();
                let truth = scene.truth(usize::from(part));
                let off_m = |m: &Pose| points.iter().map(|p| (m * *p - truth * *p).norm()).sum::<f64>() / points.len() as f64;
                let nearest_m = found.iter().map(off_m).fold(f64::INFINITY, f64::min);
                assert!(nearest_m < 0.01, "part {part}: {nearest_m} of {}", found.len());
            }
        });
    }
}
