//! Features of made scenes are matched where they show the same.

use crate::samples::synthetic::{Scene, camera_ring};
use capture::{Correspondence, MatchConfig, PixelMatch, RgbdFrame, frame_pairs, match_states, on_object};

#[test]
fn matches_lie_on_the_same_surface_points() {
    let scene = Scene::box_with_lid();
    let frames: [Vec<RgbdFrame>; 2] = [0, 1].map(|s| scene.frames(s, &camera_ring(6)));
    let config = MatchConfig { neighbors: 2, ..MatchConfig::default() };
    let matches = match_states([&frames[0], &frames[1]], &config);
    assert!(matches.len() > 150, "{}", matches.len());
    let good = matches.iter().filter(|m| scene.match_error_m(&frames, m).is_some_and(|e| e < 0.004)).count();
    assert!(good * 100 > 80 * matches.len(), "{good} of {}", matches.len());
    let swapped = match_states([&frames[1], &frames[0]], &config);
    let mut back: Vec<PixelMatch> = swapped
        .into_iter()
        .map(|m| PixelMatch { frame0: m.frame1, pixel0: m.pixel1, frame1: m.frame0, pixel1: m.pixel0 })
        .collect();
    back.sort_by_key(|m| (m.frame0, m.frame1, m.pixel0.map(f32::to_bits), m.pixel1.map(f32::to_bits)));
    assert_eq!(back, matches);
    assert_eq!(match_states([&frames[0], &frames[1]], &config), matches);
}

#[test]
fn matches_of_a_model_are_kept_on_the_object_only() {
    let mut frame = Scene::box_with_lid().frames(0, &camera_ring(1)).remove(0);
    let w = frame.intrinsics.width;
    let h = frame.intrinsics.height;
    frame.mask = Some((0..w * h).map(|i| i % w < 10).collect());
    let frames = [frame];
    let on = [9.4, 3.0];
    let off = [9.6, 3.0];
    let found = |pixel0, pixel1, confidence| Correspondence { pixels: [pixel0, pixel1], confidence };
    let all = [
        found(on, [2.0, 5.0], 0.9),
        found([1.0, 1.0], on, 0.3),
        found(on, off, 0.9),
        found(off, on, 0.9),
        found(on, on, 0.1),
        found(on, on, f32::NAN),
        found(on, [3.0, h as f32], 0.9),
        found(on, [2.0, 5.0], 0.8),
    ];
    let matches = on_object([&frames, &frames], 0, 0, &all, 0.3);
    let of = |pixel0, pixel1| PixelMatch { frame0: 0, pixel0, frame1: 0, pixel1 };
    assert_eq!(matches, [of([1.0, 1.0], on), of(on, [2.0, 5.0])]);
}

#[test]
fn frames_are_paired_with_those_that_look_from_nearby() {
    let scene = Scene::box_with_lid();
    let frames = scene.frames(0, &camera_ring(8));
    let pairs = frame_pairs([&frames, &frames], 3);
    assert_eq!(pairs.len(), 24);
    assert!(pairs.iter().all(|&(i, j)| [0, 1, 7].contains(&((i + 8 - j) % 8))), "{pairs:?}");
}
