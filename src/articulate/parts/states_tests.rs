//! Parts that pairs of states make together.

use nalgebra::{Point3, Vector3};

use super::*;
use crate::{
    register,
    samples::synthetic::{Scene, camera_ring},
};
use numeric::random::stage_rng;

#[test]
fn two_points_are_of_one_part_if_every_pair_says_so() {
    let first = [0, 0, 1, 1, 1, 0];
    let second = [0, 2, 2, 0, 0, 0];
    let classes = common_refinement(&[&first, &second]);
    assert_eq!(classes, [(vec![0, 0], 2), (vec![1, 0], 2), (vec![0, 2], 1), (vec![1, 2], 1)]);
    // A pair without motion distinguishes nothing, and where no point stands still the static part is there
    // all the same.
    assert_eq!(common_refinement(&[&[1, 1], &[0, 0]]), [(vec![0, 0], 0), (vec![1, 0], 2)]);
}

/// The chest with the lid and the drawer at shares of their ways in state 1 of the scene.
fn chest(lid: f64, drawer: f64) -> Scene {
    let mut scene = Scene::box_with_lid_and_drawer();
    let part = |motion: &Pose, share: f64| {
        Screw::of_motion(motion)
            .map_or(Pose::identity(), |s| s.motion_by(share * s.angle_rad, share * s.advance_m))
    };
    scene.parts[1].motion = part(&scene.parts[1].motion, lid);
    scene.parts[2].motion = part(&scene.parts[2].motion, drawer);
    scene
}

/// Unites the registrations of state 0 with the second state of every scene; checks labels and motions.
fn check(scenes: &[Scene], parts: usize) -> United {
    let cameras = camera_ring(10);
    let config = crate::RegisterConfig::default();
    let (zero, truth) = scenes[0].surface(0, &cameras, 0.01);
    let free0 = |p: &Point3<f64>| scenes[0].is_free(0, &cameras, p);
    let surfaces: Vec<_> = scenes.iter().map(|s| s.surface(1, &cameras, 0.01).0).collect();
    let free: Vec<_> = scenes.iter().map(|s| |p: &Point3<f64>| s.is_free(1, &cameras, p)).collect();
    // Every 7th point is matched.
    let matches = |s: &Scene| -> Vec<LiftedMatch> {
        let at = |i: usize| LiftedMatch {
            point0: zero.points[i],
            point1: s.truth(usize::from(truth[i])) * zero.points[i],
            sigma_m: 0.002,
            frames: [0; 2],
            pixels: [[0.0; 2]; 2],
        };
        (0..zero.points.len()).step_by(7).map(at).collect()
    };
    let matches: Vec<_> = scenes.iter().map(matches).collect();
    let found: Vec<Registration> = (0..scenes.len())
        .map(|k| {
            let empty: [Option<FreeSpace<'_>>; 2] = [Some(&free0), Some(&free[k])];
            register(
                &matches[k],
                [&zero, &surfaces[k]],
                empty,
                None,
                &config,
                &mut stage_rng(1, "test", k as u64),
            )
            .unwrap()
        })
        .collect();
    let pairs: Vec<StatePair> = (0..scenes.len())
        .map(|k| StatePair {
            matches: &matches[k],
            surface: &surfaces[k],
            free: Some(&free[k]),
            found: &found[k],
        })
        .collect();
    let united = unite(&zero, Some(&free0), &pairs, None).unwrap();
    assert_eq!(united.motions[0].len(), parts, "{:?}", united.curve);
    // Each part of the truth is one of the parts found, and moves as it did.
    for (k, scene) in scenes.iter().enumerate() {
        let off = (0..zero.points.len()).filter(|&i| {
            let moved = united.motions[k][usize::from(united.labels[0][i])] * zero.points[i];
            (moved - scene.truth(usize::from(truth[i])) * zero.points[i]).norm() > 0.01
        });
        let off = off.count();
        assert!(
            off * 100 < 6 * zero.points.len(),
            "state {}: {off} of {} points move otherwise",
            k + 1,
            zero.points.len()
        );
    }
    united
}

#[test]
fn parts_that_move_in_different_states_are_all_found() {
    check(&[chest(1.0, 0.0), chest(0.0, 1.0)], 3);
}

#[test]
fn parts_that_move_in_all_states_stay_the_same() {
    check(&[chest(1.0, 0.6), chest(0.4, 1.0)], 3);
}

#[test]
fn a_state_at_rest_adds_no_part() {
    let united = check(&[chest(1.0, 1.0), chest(0.0, 0.0)], 3);
    assert!(united.motions[1].iter().all(|m| m.translation.vector == Vector3::zeros()));
}
