//! Other motions that the shape of a part allows: a bar or a panel may as well have been turned end for end.
//! Its hinge distinguishes them. (The spin of caps: `round_parts.rs`.) See docs/method.md 6.9.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Point3, SymmetricEigen, Unit, UnitQuaternion, Vector3};
use rayon::prelude::*;
use tracing::debug;

use crate::{
    pair::reprojection::{EXPLAINED, FREE},
    parts::{
        labeling::labels_and_costs,
        matched_pair::MatchedPair,
        round_parts::without,
        score::{is_matched, scores_and_shares, weighed_as},
        settle::settle_once,
    },
    propose::search::Search,
    samples::{
        hinge::{PARALLEL, axis_of_turn, axis_off_m, hinge_score, touch_m},
        slip::{Slip, round_axis},
    },
};
use geometry::{Pose, Screw};

/// Rounds in which a turned motion settles.
const ROUNDS: usize = 3;
/// Number of thicknesses of a panel, up to the reach of reprojections, that are tried on either side.
/// chosen: steps of 1.5 mm for an object of half a meter
const THICKNESSES: i32 = 8;
/// Turn at which the score of a hinge is halved, radians: few joints turn farther, and a part turned end for
/// end turns by half a turn less its own.
/// tuned: shared/bags
const FAR_TURN: f64 = 2.1;

/// The motions, with each part turned end for end if that explains more, weighted by the score of its hinge.
/// Parts that matches fix stay as they are.
///
/// One side of a panel lies where the other would after half a turn. So where each state saw another side,
/// the motion that takes one side to the other explains all of it, and the true one none. A turned motion
/// that takes no more into space seen empty thus explains as much as the motion as it was.
pub(crate) fn turned_by_hinge(pair: &MatchedPair<'_>, mut motions: Vec<Pose>) -> Vec<Pose> {
    for k in 1..motions.len() {
        if is_matched(pair, &motions, k) {
            continue;
        }
        let found = labels_and_costs(&pair.surfaces, &motions);
        let (labels, _) = &*found;
        let hinge_as_it_was = best_hinge_score(pair, &motions, &labels[0], k);
        let evidence_as_it_was = weighed_as(pair, &motions, labels).0[k];
        let contradicted_as_it_was = contradicted_share(pair, &motions, labels, k);
        let mut best: Option<(f64, Vec<Pose>)> = None;
        for turned in turned_motions(pair, &motions, labels, k) {
            let mut others = with_motion(&motions, k, turned);
            // Both explain about the same surface: unless its hinge is better, the turn is not worth the
            // rounds.
            let hinge = best_hinge_score(pair, &others, &labels[0], k);
            if hinge <= hinge_as_it_was {
                continue;
            }
            let found = if contradicted_share(pair, &others, labels, k) <= contradicted_as_it_was {
                evidence_as_it_was * hinge
            } else {
                (0..ROUNDS).for_each(|_| settle_once(pair, &mut others));
                hinged_evidence(pair, &others, k)
            };
            if best.as_ref().is_none_or(|b| found > b.0) {
                best = Some((found, others));
            }
        }
        let Some((found, others)) = best else { continue };
        let as_it_was = evidence_as_it_was * hinge_as_it_was;
        let turns = found > as_it_was;
        debug!(
            part = k,
            turns,
            evidence_turned = found,
            evidence_as_it_was = as_it_was,
            "part tried end for end"
        );
        if turns {
            motions = others;
        }
    }
    motions
}

/// Motions with another one of part `k`.
fn with_motion(motions: &[Pose], k: usize, motion: Pose) -> Vec<Pose> {
    let mut others = motions.to_vec();
    others[k] = motion;
    others
}

/// The evidence for part `k` times the score of its hinge.
fn hinged_evidence(pair: &MatchedPair<'_>, motions: &[Pose], k: usize) -> f64 {
    best_hinge_score(pair, motions, &labels_and_costs(&pair.surfaces, motions).0[0], k)
        * scores_and_shares(pair, motions).0[k]
}

/// Share of the samples of part `k` that its motion takes into space that the other state saw empty.
fn contradicted_share(pair: &MatchedPair<'_>, motions: &[Pose], labels: &[Vec<u8>; 2], k: usize) -> f64 {
    let mut samples = 0.0;
    let mut contradicted = 0.0;
    for state in 0..2 {
        let costs = pair.surfaces.shape_costs(state, motions, Some(&labels[1 - state]));
        for (row, label) in costs.chunks_exact(motions.len()).zip(&labels[state]) {
            if usize::from(*label) == k {
                samples += 1.0;
                contradicted += f64::from(u8::from(row[k] >= FREE));
            }
        }
    }
    contradicted / f64::max(samples, 1.0)
}

/// How well the motion of part `k` could be that of a hinge on another part, from 0 to 1: its axis is close
/// to the surfaces of both, and it does not turn too far. A slide relative to another part has no axis; both
/// must touch. See docs/method.md (6.13).
fn best_hinge_score(pair: &MatchedPair<'_>, motions: &[Pose], labels: &[u8], k: usize) -> f64 {
    let mut surfaces: Vec<Vec<Point3<f64>>> = vec![Vec::new(); motions.len()];
    for (p, l) in pair.surfaces.samples[0].points.iter().zip(labels) {
        surfaces[usize::from(*l)].push(*p);
    }
    let own = &surfaces[k];
    let mut best = 0.0;
    for parent in (0..motions.len()).filter(|p| *p != k) {
        let relative = motions[parent].inverse() * motions[k];
        let surface = &surfaces[parent];
        let (off_m, angle_rad) = match axis_of_turn(&relative) {
            Some(axis) => (axis_off_m(&axis.point, &axis.direction, own, surface), axis.angle_rad),
            None => (touch_m(own, surface), 0.0),
        };
        best = f64::max(best, hinge_score(off_m, pair.extent_m) / (1.0 + (angle_rad / FAR_TURN).powi(4)));
    }
    best
}

/// Other possible motions of part `k`, each where it explains most and where it contradicts least: its own
/// after half a turn about its middle and the direction of its axis; for a round bar its [`swings`]. Empty
/// for a slide.
fn turned_motions(pair: &MatchedPair<'_>, motions: &[Pose], labels: &[Vec<u8>; 2], k: usize) -> Vec<Pose> {
    let Some(axis) = axis_of_turn(&motions[k]) else { return Vec::new() };
    let costs = pair.surfaces.shape_costs(0, motions, Some(&labels[1]));
    let explained = |i: &usize| usize::from(labels[0][*i]) == k && costs[i * motions.len() + k] < EXPLAINED;
    let surface = pair.surfaces.samples[0];
    let (points, normals): (Vec<Point3<f64>>, Vec<Vector3<f64>>) =
        (0..labels[0].len()).filter(explained).map(|i| (surface.points[i], surface.normals[i])).unzip();
    let Some(Middle { center, thin }) = Middle::of(&points) else { return Vec::new() };
    let starts = match round_axis(&points, &normals) {
        Some(round) => swings(motions, k, &center, &round.direction),
        None => {
            let half = Screw { direction: axis.direction, point: center, angle_rad: PI, advance_m: 0.0 };
            vec![motions[k] * half.to_motion()]
        }
    };
    // The center of a panel seen from one side is on that side, so the turn misplaces it by its thickness, at
    // most the reach.
    let search = Search::new(&pair.surfaces, &without(motions, k), pair.extent_m);
    let total = |motion: &Pose| search.sharp_total(motion).0;
    let step_m = pair.surfaces.scales.plane_m;
    let steps = (pair.surfaces.reach_m / step_m).ceil() as i64;
    let mut placed = Vec::with_capacity(2 * starts.len());
    for start in starts {
        let shifted = |by_m: f64| start * Slip::along_direction(thin).motion_by(by_m);
        // In the order of the steps, so the choice among equal ones does not depend on threads.
        let coarse = (-THICKNESSES..=THICKNESSES).into_par_iter();
        let apart: Vec<(f64, Pose)> = coarse
            .map(|s| shifted(f64::from(s) / f64::from(THICKNESSES) * pair.surfaces.reach_m))
            .map(|motion| (contradicted_share(pair, &with_motion(motions, k, motion), labels, k), motion))
            .collect();
        placed.extend(apart.into_iter().reduce(|a, b| if b.0 < a.0 { b } else { a }).map(|a| a.1));
        let beside: Vec<(f64, Pose)> = (-steps..=steps)
            .into_par_iter()
            .map(|s| shifted(s as f64 * step_m))
            .map(|motion| (total(&motion), motion))
            .collect();
        let Some((_, best)) = beside.into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a }) else {
            continue;
        };
        let slips = search.slips_of(&best);
        placed.push(slips.map_or(best, |s| search.climbed_motion(&best, s, total, |m| search.slips_of(m)).1));
    }
    placed
}

/// Motions of part `k`, a bar round about a line through `center`, that take it to the place of its own
/// motion with either end first, and do not spin it about the line relative to some other part: the spin of a
/// bar is not seen. Empty for a cap, whose line stays in place.
fn swings(motions: &[Pose], k: usize, center: &Point3<f64>, line: &Unit<Vector3<f64>>) -> Vec<Pose> {
    let mut swings = Vec::new();
    for parent in (0..motions.len()).filter(|p| *p != k) {
        let relative = motions[parent].inverse() * motions[k];
        let to = relative * center;
        let turned = relative * line.into_inner();
        if turned.angle(line) < PARALLEL {
            continue;
        }
        for turn in [turned, -turned].iter().filter_map(|end| UnitQuaternion::rotation_between(line, end)) {
            swings.push(motions[parent] * Pose::from_parts((to - turn * center).into(), turn));
        }
    }
    swings.retain(|motion| motion.rotation.angle_to(&motions[k].rotation) > PARALLEL);
    swings
}

/// The center of points and the direction of their least extent.
struct Middle {
    center: Point3<f64>,
    /// Unit direction.
    thin: Vector3<f64>,
}

impl Middle {
    /// Of the box around points along their principal directions; `None` if there are too few.
    fn of(points: &[Point3<f64>]) -> Option<Self> {
        const LEAST: usize = 12;
        if points.len() < LEAST {
            return None;
        }
        let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
        let spread: Matrix3<f64> =
            points.iter().map(|p| (p.coords - mean) * (p.coords - mean).transpose()).sum();
        let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(spread);
        let center = eigenvectors.column_iter().map(|axis| {
            let mut along: Vec<f64> = points.iter().map(|p| axis.dot(&p.coords)).collect();
            along.sort_by(f64::total_cmp);
            // A few wrong samples beyond the ends would shift the center, and the turned motion by twice
            // that.
            let cut = along.len() / 50;
            axis * (0.5 * (along[cut] + along[along.len() - 1 - cut]))
        });
        let thin = eigenvectors.column(eigenvalues.imin()).into_owned();
        Some(Self { center: center.sum::<Vector3<f64>>().into(), thin })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        pair::surface_pair::SurfacePair,
        samples::synthetic::{Scene, camera_ring, turn},
    };

    #[test]
    fn a_plain_arm_turned_end_for_end_goes_back_to_its_hinges() {
        let scene = Scene { texture: 0.0, ..Scene::lamp() };
        let turned = scene.truth(1) * turn(Vector3::y(), [0.0, 0.0, 0.18], PI);
        scene.seen(0.006, 0.012, |surfaces, _| {
            let pair = MatchedPair::new(&[], 0.4, surfaces);
            for start in [scene.truth(1), turned] {
                let found = turned_by_hinge(&pair, vec![Pose::identity(), start, scene.truth(2)])[1];
                for z in [0.05, 0.31] {
                    let end = Point3::new(0.0, 0.0, z);
                    let off_m = (found * end - scene.truth(1) * end).norm();
                    assert!(off_m < 0.01, "{off_m}");
                }
            }
        });
    }

    #[test]
    fn a_lid_of_which_each_state_shows_another_side_hangs_on_its_hinge() {
        let scene = Scene::case();
        // Of the lid its inside in state 0 and its outside in state 1.
        seen_of_lid(
            &scene,
            |state, outward| if state == 0 { outward < -0.9 } else { outward > 0.9 },
            |pair| {
                let found = turned_by_hinge(pair, vec![Pose::identity(), swapped_sides(&scene)])[1];
                for (x, z) in [(-0.2, 0.03), (0.2, 0.03), (0.2, 0.29)] {
                    let corner = Point3::new(x, 0.157, z);
                    let off_m = (found * corner - scene.truth(1) * corner).norm();
                    assert!(
                        off_m < 0.02,
                        "{off_m} m at {corner}: within the lid's thickness, which is not seen"
                    );
                }
            },
        );
    }

    #[test]
    fn a_round_bar_swings_without_a_spin() {
        let middle = [0.0, 0.0, 0.18];
        let line = Vector3::z_axis();
        let center = Point3::from(middle);
        let parent = Pose::new(Vector3::new(0.1, 0.0, 0.0), Vector3::new(0.0, 0.4, 0.0));
        let own = parent * turn(Vector3::y(), [0.0; 3], 1.3);
        for spin_rad in [1.0, PI] {
            let motions = [Pose::identity(), own * turn(Vector3::z(), middle, spin_rad), parent];
            let all = swings(&motions, 1, &center, &line);
            let off =
                |m: &Pose, to: &Pose| (m.inverse() * to).rotation.angle() + (m * center - to * center).norm();
            assert!(all.iter().any(|m| off(m, &own) < 1e-9), "{all:?}");
            // The other end first, about the hinge's direction.
            let other_end = own * turn(Vector3::y(), middle, PI);
            assert!(all.iter().any(|m| off(m, &other_end) < 1e-9), "{all:?}");
        }
        let cap = Screw { direction: line, point: center, angle_rad: 1.0, advance_m: 0.01 }.to_motion();
        assert!(swings(&[Pose::identity(), cap], 1, &center, &line).is_empty());
    }

    #[test]
    fn a_lid_whose_inside_one_state_hides_is_turned_into_its_place() {
        let scene = Scene::case();
        // Without the lid's edges, which tell how thick it is, and in state 1 without its inside.
        seen_of_lid(
            &scene,
            |state, outward| outward > 0.9 || (state == 0 && outward < -0.9),
            |pair| {
                let motions = [Pose::identity(), swapped_sides(&scene)];
                let found =
                    turned_motions(pair, &motions, &labels_and_costs(&pair.surfaces, &motions).0, 1)[0];
                for (x, z) in [(-0.2, 0.03), (0.2, 0.03), (0.2, 0.29)] {
                    let corner = Point3::new(x, 0.157, z);
                    let across = scene.truth(1) * Vector3::y();
                    let off_m = across.dot(&(found * corner - scene.truth(1) * corner)).abs();
                    assert!(off_m < 0.003, "{off_m}");
                }
            },
        );
    }

    /// Calls with the case as ten cameras see it, of its lid only the samples that are shown: by the state
    /// and the cosine between their normals and the lid's outside.
    fn seen_of_lid(
        scene: &Scene,
        is_shown: impl Fn(usize, f64) -> bool,
        then: impl FnOnce(&MatchedPair<'_>),
    ) {
        let cameras = &camera_ring(10);
        let [first, second] = [0, 1].map(|state| {
            let (all, parts) = scene.surface(state, cameras, 0.006);
            let out = if state == 0 { Vector3::y() } else { scene.truth(1) * Vector3::y() };
            let kept = |i: &usize| parts[*i] == 0 || is_shown(state, all.normals[*i].dot(&out));
            all.chosen_samples(&(0..all.points.len()).filter(kept).collect::<Vec<usize>>())
        });
        let free = [0, 1].map(|s| move |p: &Point3<f64>| scene.is_free(s, cameras, p));
        let surfaces = SurfacePair::new([&first, &second], [Some(&free[0]), Some(&free[1])], 0.016);
        then(&MatchedPair::new(&[], 0.4, surfaces));
    }

    /// The motion that takes one side of the case's lid to the other.
    fn swapped_sides(scene: &Scene) -> Pose {
        scene.truth(1) * turn(Vector3::x(), [0.0, 0.15, 0.16], PI)
    }
}
