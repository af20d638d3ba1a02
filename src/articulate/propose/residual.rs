//! Proposes motions from geometry: from patches of surface left in one state and reached in the other.
//!
//! If a surface of one state is in space that the other state saw empty, and no known motion takes it onto a
//! surface, an unknown motion moved it. Patches of such surface are tried on those of the other state
//! (`trial.rs`). The best motions are polished and accepted one after the other, each with the surface it
//! explains, and patches that may hang on it are tried. This finds plain surfaces, which give no matches.

use nalgebra::{UnitQuaternion, Vector3};
use rayon::prelude::*;

use crate::{
    pair::{surface_pair::SurfacePair, unexplained::LEAST_SHARE},
    propose::{round_part::round_turn, search::Search, slid_panel::moved_patches, trial::motions_on},
    samples::{hinge::PARALLEL, slip::Slip},
};
use geometry::Pose;

/// A slide is preferred to a small turn from this share of the turn's worth on.
/// tuned: shared/bags
const AS_MUCH: f64 = 0.95;

/// Motions of unexplained patches onto unexplained surface, from state 0 to state 1, best first; each is
/// judged by the surface left by those before.
pub(crate) fn propose_from_residual(pair: &SurfacePair<'_>, motions: &[Pose], extent_m: f64) -> Vec<Pose> {
    let mut search = Search::new(pair, motions, extent_m);
    let least = LEAST_SHARE * search.left.open.iter().map(Vec::len).sum::<usize>() as f64;
    let found = [0, 1].map(|s| moved_patches(&search.left, pair, s, &search.faces[s]));
    let mut candidates: Vec<Pose> =
        motions.iter().flat_map(|body| motions_on(&search, body, &found)).collect();
    let mut kept: Vec<Pose> = Vec::new();
    while !candidates.is_empty() {
        // Computed again for each motion, as those before took surface away.
        let worths: Vec<(f64, f64)> = candidates.par_iter().map(|m| search.hinged_worth(m)).collect();
        let enough = worths.iter().enumerate().filter(|(_, w)| w.1 >= least);
        let Some((best, _)) = enough.max_by(|a, b| a.1.0.total_cmp(&b.1.0).then(b.0.cmp(&a.0))) else {
            break;
        };
        let motion = polished_motion(&search, &candidates.swap_remove(best));
        search.take_explained(&motion);
        // A part attached to the found part follows it: a drawer in a door, a lever on a drawer.
        candidates.extend(motions_on(&search, &motion, &found));
        kept.push(motion);
    }
    kept
}

/// The best motion nearby; a slide rather than a small turn if it explains as much; for a round part the best
/// of all turns.
fn polished_motion(search: &Search<'_, '_>, motion: &Pose) -> Pose {
    // Point-to-plane fits leave slips open; only a search along them finds the edges.
    let Some(slips) = search.slips_of(motion) else { return *motion };
    let (worth, best) =
        search.climbed_motion(motion, slips, |m| search.sharp_worth(m), |pose| search.slips_of(pose));
    // A slide does not change normals, so a large turn cannot be mistaken for one.
    if best.rotation.angle() > PARALLEL {
        return round_turn(search, &best).unwrap_or(best);
    }
    let center = search.explained_center(&best);
    // The slide moves the center as the turn does, so both start at one place.
    let slide = Pose::from_parts((best * center - center).into(), UnitQuaternion::identity());
    let along = [0, 1, 2].map(|k| Slip::along_direction(Vector3::ith(k, 1.0)));
    let (slide_worth, slide) = search.climbed_motion(&slide, along, |m| search.sharp_worth(m), |_| None);
    let best = if slide_worth >= AS_MUCH * worth { slide } else { best };
    round_turn(search, &best).unwrap_or(best)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::{SurfaceSamples, samples::synthetic::Scene};
    use geometry::Screw;

    #[test]
    fn a_plain_panel_slides_by_what_it_uncovers() {
        const SPACING_M: f64 = 0.01;
        let rectangle = |y: std::ops::Range<i64>, z: std::ops::Range<i64>| {
            y.flat_map(move |j| {
                z.clone().map(move |k| Point3::new(0.0, SPACING_M * j as f64, SPACING_M * k as f64))
            })
        };
        let state = |shift: i64| {
            let points: Vec<Point3<f64>> =
                rectangle(-50..70, -20..-5).chain(rectangle(shift..shift + 40, 0..30)).collect();
            SurfaceSamples {
                normals: vec![Vector3::x(); points.len()],
                colors: vec![[0.5; 3]; points.len()],
                points,
            }
        };
        let surfaces = [state(0), state(-15)];
        let seen_empty = |from_m: f64| {
            move |p: &Point3<f64>| {
                p.x > 0.03
                    || (p.z > -0.005 && p.x > -0.03 && !(from_m - 0.005..from_m + 0.395).contains(&p.y))
            }
        };
        let free = [seen_empty(0.0), seen_empty(-0.15)];
        let pair = SurfacePair::new([&surfaces[0], &surfaces[1]], [Some(&free[0]), Some(&free[1])], 0.03);
        let found = propose_from_residual(&pair, &[Pose::identity()], 1.2);
        let off_m = |p: Point3<f64>| (found[0] * p - p - Vector3::new(0.0, -0.15, 0.0)).norm();
        let panel = || rectangle(0..40, 0..30);
        let mean_m = panel().map(off_m).sum::<f64>() / panel().count() as f64;
        assert!(mean_m < 2.0 * SPACING_M, "{mean_m}");
    }

    #[test]
    fn an_arm_on_an_arm_is_found_by_the_arm_that_it_hangs_on() {
        // About axes that are not parallel: in the world the second arm neither slides nor turns about an
        // edge of its own.
        let mut scene = Scene { texture: 0.0, ..Scene::lamp() };
        let twist = Screw {
            direction: Vector3::x_axis(),
            point: Point3::new(0.0, 0.0, 0.33),
            angle_rad: 0.9,
            advance_m: 0.0,
        };
        scene.parts[2].motion = scene.parts[1].motion * twist.to_motion();
        scene.seen(0.006, 0.012, |pair, labels| {
            let found = propose_from_residual(&pair, &[Pose::identity()], 0.4);
            let all = &pair.samples[0].points;
            for part in [1, 2] {
                let points: Vec<&Point3<f64>> =
                    all.iter().zip(&labels[0]).filter(|(_, l)| **l == part).map(|(p, _)| p).collect();
                let truth = scene.truth(usize::from(part));
                let off_m = |m: &Pose| {
                    points.iter().map(|p| (m * *p - truth * *p).norm()).sum::<f64>() / points.len() as f64
                };
                let nearest_m = found.iter().map(off_m).fold(f64::INFINITY, f64::min);
                assert!(nearest_m < 0.01, "part {part}: {nearest_m} of {}", found.len());
            }
        });
    }
}
