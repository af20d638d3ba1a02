//! Parts found in scenes with a known answer.

use nalgebra::{Point3, Vector3};
use rand_core::Rng;

use crate::{
    LiftedMatch, RegisterConfig, RegisterError, Registrar, Registration,
    parts::{
        elimination::{best_motions, elimination_steps},
        matched_pair::MatchedPair,
    },
    register,
    samples::synthetic::{Scene, camera_ring},
};
use geometry::Pose;
use numeric::random::stage_rng;

fn uniform(rng: &mut impl Rng) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// Matches of one sample in `every` with 1 mm of noise, and one wrong one for three right ones.
fn matches(scene: &Scene, points: &[Point3<f64>], labels: &[u8], every: usize) -> Vec<LiftedMatch> {
    let mut rng = stage_rng(5, "matches", 0);
    let mut all = Vec::new();
    for i in (0..points.len()).step_by(every) {
        let noise = Vector3::from_fn(|_, _| 0.002 * (uniform(&mut rng) - 0.5));
        let wrong = points[(rng.next_u64() % points.len() as u64) as usize];
        let ends = [
            Some(scene.truth(usize::from(labels[i])) * points[i] + noise),
            (i / every % 3 == 0).then_some(wrong),
        ];
        all.extend(ends.into_iter().flatten().map(|point1| LiftedMatch {
            point0: points[i],
            point1,
            sigma_m: 0.001,
            frames: [0, 0],
            pixels: [[0.0; 2]; 2],
        }));
    }
    all
}

fn found(scene: &Scene, every: Option<usize>, parts: Option<usize>) -> Result<Registration, RegisterError> {
    let cameras = camera_ring(10);
    found_from([&cameras, &cameras], scene, every, parts)
}

/// By what the cameras of each state see.
fn found_from(
    cameras: [&[Pose]; 2],
    scene: &Scene,
    every: Option<usize>,
    parts: Option<usize>,
) -> Result<Registration, RegisterError> {
    let [(s0, labels), (s1, _)] = [0, 1].map(|s| scene.surface(s, cameras[s], 0.008));
    let matches = every.map_or_else(Vec::new, |every| matches(scene, &s0.points, &labels, every));
    let free = [0, 1].map(|s| move |p: &Point3<f64>| scene.is_free(s, cameras[s], p));
    register(
        &matches,
        [&s0, &s1],
        [Some(&free[0]), Some(&free[1])],
        parts,
        &RegisterConfig::default(),
        &mut stage_rng(0, "register", 0),
    )
}

/// Every part's motion is found once, within a distance at its center, and nothing else is.
fn check(scene: &Scene, every: Option<usize>, within_m: f64) {
    let registration = found(scene, every, None).unwrap();
    assert_eq!(registration.motions.len(), scene.parts.len(), "{:?}", registration.curve);
    for (k, part) in scene.parts.iter().enumerate() {
        let center = scene.world * part.boxes[0].0;
        let close = |m: &&Pose| (*m * center - scene.truth(k) * center).norm() < within_m;
        let off = registration
            .motions
            .iter()
            .map(|m| (m * center - scene.truth(k) * center).norm())
            .collect::<Vec<_>>();
        assert_eq!(registration.motions.iter().filter(close).count(), 1, "part {k}: {off:?}");
    }
    let points: Vec<usize> = registration.curve.iter().map(|p| p.parts).collect();
    assert!(points.windows(2).all(|w| w[0] > w[1]) && points.last() == Some(&1), "{points:?}");
    // The evidence falls off by a factor from the last part to what is no part.
    let weakest = |parts: usize| {
        registration.curve.iter().find(|p| p.parts == parts).and_then(|p| p.weakest).unwrap_or(0.0)
    };
    assert!(weakest(scene.parts.len()) > 2.0 * weakest(scene.parts.len() + 1), "{:?}", registration.curve);
}

#[test]
fn textured_parts_are_counted() {
    for scene in [Scene::box_with_lid(), Scene::box_with_lid_and_drawer(), Scene::lamp(), Scene::jar()] {
        check(&scene, Some(9), 0.003);
    }
}

#[test]
fn a_plain_part_is_found_by_its_surface() {
    check(&Scene { texture: 0.0, ..Scene::box_with_lid() }, None, 0.003);
}

#[test]
fn plain_parts_beside_each_other_are_found_by_their_surface() {
    // Where the drawer ends is known to the distance between samples, 8 mm.
    check(&Scene { texture: 0.0, ..Scene::box_with_lid_and_drawer() }, None, 0.006);
}

#[test]
fn the_choice_does_not_depend_on_the_order_of_the_proposals() {
    let scene = Scene::box_with_lid_and_drawer();
    let points = scene.surface(0, &camera_ring(10), 0.012);
    let matches = matches(&scene, &points.0.points, &points.1, 9);
    scene.seen(0.012, 0.02, |surfaces, _| {
        let pair = MatchedPair::new(&matches, 0.4, surfaces);
        // The true motions, each a second time a little off, and one that is nothing's.
        let off = Pose::new(Vector3::new(0.004, -0.003, 0.005), Vector3::new(0.0, 0.01, 0.01));
        let [lid, drawer] = [scene.truth(1), scene.truth(2)];
        let proposed = [lid, drawer, off * lid, off * drawer, Pose::translation(0.05, 0.02, 0.0)];
        let end = Point3::new(0.1, -0.1, 0.1);
        let chosen = |order: [usize; 5]| {
            let motions = std::iter::once(Pose::identity()).chain(order.map(|k| proposed[k])).collect();
            let mut found = best_motions(&elimination_steps(&pair, motions));
            found.sort_by(|a, b| {
                (a * end).x.total_cmp(&(b * end).x).then((a * end).y.total_cmp(&(b * end).y))
            });
            found
        };
        let expected = chosen([0, 1, 2, 3, 4]);
        assert_eq!(expected.len(), 3);
        for order in [[4, 3, 2, 1, 0], [2, 4, 1, 0, 3], [3, 1, 0, 4, 2], [1, 2, 3, 0, 4]] {
            let found = chosen(order);
            assert_eq!(found.len(), expected.len(), "{order:?}");
            for (a, b) in found.iter().zip(&expected) {
                assert!((a * end - b * end).norm() < 1e-3, "{order:?}: {a} {b}");
            }
        }
    });
}

#[test]
fn an_object_at_rest_is_one_part_and_this_is_said() {
    let mut scene = Scene::box_with_lid_and_drawer();
    scene.parts.iter_mut().for_each(|p| p.motion = Pose::identity());
    let registration = found(&scene, Some(9), None).unwrap();
    assert_eq!((registration.motions.len(), registration.warnings.len()), (1, 0));
    assert!(registration.notes.iter().any(|n| n.text.contains("no part moved")), "{:?}", registration.notes);
    assert!(matches!(found(&scene, Some(9), Some(2)), Err(RegisterError::NoMotion { .. })));
}

#[test]
fn states_seen_from_opposite_sides_do_not_say_that_nothing_moved() {
    let mut scene = Scene::box_with_lid_and_drawer();
    scene.parts.iter_mut().for_each(|p| p.motion = Pose::identity());
    let cameras = camera_ring(10);
    let refused = found_from([&cameras[..3], &cameras[5..8]], &scene, None, None);
    assert!(matches!(refused, Err(RegisterError::LittleShared { .. })), "{refused:?}");
}

#[test]
fn more_parts_than_there_are_cannot_be_asked_for() {
    let asked = found(&Scene::box_with_lid(), Some(9), Some(3));
    assert!(matches!(asked, Err(RegisterError::FewerParts { asked: 3, found: 2, .. })), "{asked:?}");
}

#[test]
fn a_search_goes_on_from_any_of_its_steps() {
    let scene = Scene::box_with_lid_and_drawer();
    let cameras = camera_ring(10);
    let [(s0, labels), (s1, _)] = [0, 1].map(|s| scene.surface(s, &cameras, 0.012));
    let matches = matches(&scene, &s0.points, &labels, 9);
    let config = RegisterConfig::default();
    let begin = || {
        let mut rng = stage_rng(0, "register", 0);
        Registrar::new(&matches, [&s0, &s1], [None, None], None, &config, &mut rng).unwrap()
    };
    let mut whole = begin();
    let mut kept = Vec::new();
    while whole.done_steps() < whole.total_steps() {
        kept.push(postcard::to_allocvec(whole.checkpoint()).unwrap());
        whole.step().unwrap();
    }
    let expected = whole.registration();
    // Before the surface proposes, before parts are counted, among the last rounds.
    for at in [1, kept.len() - 10, kept.len() - 2] {
        let mut search = begin();
        search.restore(postcard::from_bytes(&kept[at]).unwrap());
        while search.done_steps() < search.total_steps() {
            search.step().unwrap();
        }
        let found = search.registration();
        assert_eq!((&found.motions, &found.labels), (&expected.motions, &expected.labels), "from step {at}");
        assert_eq!(found.curve, expected.curve);
    }
}
