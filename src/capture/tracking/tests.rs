use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};
use rand_core::Rng;

use super::{lost::Lost, *};
use crate::analytic::{cuboid, looking_at_origin, view_of};
use crate::{NoiseConfig, RgbdFrame};
use common::{ahead::Ahead, stop::Stop};
use geometry::{Intrinsics, Pose};
use numeric::random::stage_rng;

const NOISE: NoiseConfig =
    NoiseConfig { constant_m: 0.0005, quadratic_per_m: 0.0005, edge_sigmas: 6.0, grazing_cosine: 0.15 };
const INTRINSICS: Intrinsics =
    Intrinsics { width: 320, height: 240, fx: 300.0, fy: 300.0, cx: 159.2, cy: 120.9 };
/// Height of the floor, meters.
const FLOOR_M: f64 = -0.1;

/// A box with another one beside it, which may have moved, on a floor.
fn boxes(moved: Vector3<f64>) -> impl Fn(&Point3<f64>) -> f64 {
    move |p| {
        let beside = cuboid(Vector3::new(0.06, 0.09, 0.08))(&(p - Vector3::new(0.1, -0.28, -0.02) - moved));
        let floor = p.z - FLOOR_M;
        cuboid(Vector3::new(0.2, 0.12, 0.1))(p).min(beside).min(floor)
    }
}

/// Gray at a point of space: smooth random blobs that no two places share.
fn texture(p: &Point3<f64>) -> u8 {
    let wave = |k: f64, shift: f64| {
        (k * (p.x + 0.31 * p.y) + shift).sin() * (k * (p.y - 0.27 * p.z) + 2.0 * shift).sin()
            + (k * (p.z + 0.43 * p.x) - shift).sin()
    };
    let sum = wave(37.0, 0.3) + wave(61.0, 1.1) + wave(97.0, 2.3) + wave(151.0, 0.7);
    (128.0 + 16.0 * sum) as u8
}

/// What a camera sees, with depth noise; `textured` or gray.
fn view(scene: &dyn Fn(&Point3<f64>) -> f64, eye: Point3<f64>, textured: bool, number: usize) -> RgbdFrame {
    let mut frame = view_of(scene, INTRINSICS, looking_at_origin(eye));
    let mut rng = stage_rng(7, "view", number as u64);
    let mut normal = || (0..12).map(|_| rng.next_u64() as f64 / u64::MAX as f64).sum::<f64>() - 6.0;
    for i in 0..frame.depth_m.len() {
        let gray = frame.world_point(i).filter(|_| textured).map_or(90, |p| texture(&p));
        frame.rgb[i] = [gray; 3];
    }
    for d in frame.depth_m.iter_mut().filter(|d| **d > 0.0) {
        *d += (NOISE.sigma_m(f64::from(*d)) * normal()) as f32;
    }
    frame.mask = None;
    frame.stamp_nanos = number as i64 * 100_000_000;
    frame
}

fn eye(number: usize) -> Point3<f64> {
    let turn = 0.4 + 0.09 * number as f64;
    Point3::new(0.8 * turn.cos(), 0.8 * turn.sin(), 0.5 + 0.03 * (number % 3) as f64)
}

fn views(scene: &dyn Fn(&Point3<f64>) -> f64, count: usize) -> Vec<RgbdFrame> {
    (0..count).map(|i| view(scene, eye(i), true, i)).collect()
}

/// Tracks frames, which know their poses but do not give them away.
fn track(frames: &[RgbdFrame]) -> (Track, Vec<Option<Lost>>) {
    let mut tracker = Tracker::new(3);
    let hidden = |f: &RgbdFrame| RgbdFrame { world_from_camera: Pose::identity(), ..f.clone() };
    let lost = frames
        .iter()
        .map(|f| tracker.add(Observation::of_frame(hidden(f), &NOISE, &Ahead::default())).err())
        .collect();
    (tracker.finish(&Stop::never()).unwrap(), lost)
}

/// Largest error of a tracked pose against the first one's: meters, and radians.
fn errors(track: &Track, frames: &[RgbdFrame]) -> [f64; 2] {
    let first = (0..frames.len()).find(|&i| track.poses[i].is_some()).unwrap();
    let pairs = frames.iter().zip(&track.poses).filter_map(|(f, pose)| Some((f.world_from_camera, (*pose)?)));
    pairs.fold([0.0; 2], |[moved, turned], (truth, found)| {
        let true_step = frames[first].world_from_camera.inverse() * truth;
        let step = track.poses[first].unwrap().inverse() * found;
        let off = true_step.inverse() * step;
        [moved.max(off.translation.vector.norm()), turned.max(off.rotation.angle())]
    })
}

#[test]
fn a_camera_is_followed_and_two_runs_agree() {
    let frames = views(&boxes(Vector3::zeros()), 10);
    let (found, lost) = track(&frames);
    assert!(lost.iter().all(Option::is_none), "{lost:?}");
    assert_eq!(found.findings.tracked, 10);
    let [moved_m, turned_rad] = errors(&found, &frames);
    assert!(moved_m < 0.003 && turned_rad < 0.004, "{moved_m} m, {turned_rad} rad");
    assert_eq!(track(&frames).0.poses, found.poses);
}

#[test]
fn views_in_any_order_hang_together() {
    let mut frames = views(&boxes(Vector3::zeros()), 9);
    frames = [0, 4, 8, 2, 6, 1, 7, 3, 5].map(|i| frames[i].clone()).to_vec();
    let (found, _) = track(&frames);
    assert_eq!(found.findings.tracked, 9, "{:?}", found.findings);
    let [moved_m, turned_rad] = errors(&found, &frames);
    assert!(moved_m < 0.003 && turned_rad < 0.004, "{moved_m} m, {turned_rad} rad");
}

#[test]
fn a_covered_lens_is_said_and_the_camera_is_found_again() {
    let mut frames = views(&boxes(Vector3::zeros()), 8);
    for frame in &mut frames[3..5] {
        frame.rgb.fill([0; 3]);
        frame.depth_m.fill(0.0);
    }
    let (found, lost) = track(&frames);
    assert_eq!(found.findings.lost, [[3, 4]]);
    assert!(lost[3].is_some() && lost[4].is_some() && lost[5].is_none(), "{lost:?}");
    assert!(found.poses[3].is_none() && found.poses[7].is_some());
    let [moved_m, _] = errors(&found, &frames);
    assert!(moved_m < 0.003, "{moved_m} m");
}

#[test]
fn along_a_plain_wall_the_camera_is_lost() {
    let wall = |p: &Point3<f64>| p.z;
    let frames: Vec<RgbdFrame> =
        (0..4).map(|i| view(&wall, Point3::new(0.3 + 0.02 * i as f64, 0.0, 0.8), false, i)).collect();
    let (found, lost) = track(&frames);
    assert_eq!(found.findings.tracked, 1);
    assert!(lost[1..].iter().all(|l| *l == Some(Lost::Blank)), "{lost:?}");
    // With texture the same wall is followed.
    let frames: Vec<RgbdFrame> =
        (0..4).map(|i| view(&wall, Point3::new(0.3 + 0.02 * i as f64, 0.0, 0.8), true, i)).collect();
    let (found, lost) = track(&frames);
    assert_eq!(found.findings.tracked, 4, "{lost:?}");
    assert!(errors(&found, &frames)[0] < 0.003);
}

#[test]
fn the_support_is_level_and_low() {
    let frames = views(&boxes(Vector3::zeros()), 6);
    let (found, _) = track(&frames);
    let Upright { world_from_map, by, .. } = found.upright_world();
    assert_eq!(by, UpBy::Support);
    for (frame, pose) in frames.iter().zip(&found.poses) {
        let pose = world_from_map * pose.unwrap();
        let up = pose.inverse_transform_vector(&Vector3::z());
        let true_up = frame.world_from_camera.inverse_transform_vector(&Vector3::z());
        assert!(up.angle(&true_up) < 0.01, "{}", up.angle(&true_up));
        let height_m = pose.translation.vector.z;
        let true_m = frame.world_from_camera.translation.vector.z - FLOOR_M;
        assert!((height_m - true_m).abs() < 0.005, "{height_m} {true_m}");
    }
    // Cameras look along x.
    let ahead = found.poses.iter().flatten().map(|p| world_from_map * p * Vector3::z()).sum::<Vector3<f64>>();
    assert!(ahead.x > 0.0 && ahead.y.abs() < 1e-6 * ahead.x, "{ahead}");
}

#[test]
fn states_are_aligned_by_what_stands_still() {
    let first = views(&boxes(Vector3::zeros()), 6);
    // The texture moves with the small box.
    let moved = Vector3::new(0.12, 0.02, 0.0);
    let scene = boxes(moved);
    let second: Vec<RgbdFrame> = (0..6)
        .map(|i| {
            let mut frame = view(&scene, eye(i) + Vector3::new(0.02, 0.01, 0.05), true, 50 + i);
            for k in 0..frame.depth_m.len() {
                let Some(p) = frame.world_point(k) else { continue };
                let on_box = (p - moved - Vector3::new(0.1, -0.28, -0.02)).coords.abs();
                if p.z > FLOOR_M + 0.005 && on_box.x < 0.07 && on_box.y < 0.1 {
                    frame.rgb[k] = [texture(&(p - moved)); 3];
                }
            }
            frame
        })
        .collect();
    let tracks = [&first, &second].map(|f| track(f).0);
    let (map0_from_map1, share) = align_tracks(&tracks[0], &tracks[1], 0, &Stop::never()).unwrap().unwrap();
    assert!(share > 0.8, "{share}");
    let truth = first[0].world_from_camera.inverse() * second[0].world_from_camera;
    let found = tracks[0].poses[0].unwrap().inverse() * map0_from_map1 * tracks[1].poses[0].unwrap();
    let off = truth.inverse() * found;
    assert!(off.translation.vector.norm() < 0.004 && off.rotation.angle() < 0.006, "{off}");
}

#[test]
fn states_that_show_nothing_alike_are_refused() {
    let first = views(&boxes(Vector3::zeros()), 3);
    let second: Vec<RgbdFrame> =
        (0..3).map(|i| view(&|p: &Point3<f64>| p.z - 3.0, eye(i), true, i)).collect();
    let tracks = [&first, &second].map(|f| track(f).0);
    let found = align_tracks(&tracks[0], &tracks[1], 0, &Stop::never()).unwrap();
    assert_eq!(found.err(), Some(Unaligned::NothingAlike));
}

#[test]
fn a_view_that_shows_nothing_is_lost_with_its_reason() {
    let lost_by = |spoil: &dyn Fn(&mut RgbdFrame)| {
        let mut frames = views(&boxes(Vector3::zeros()), 5);
        spoil(&mut frames[3]);
        let mut tracker = Tracker::new(0);
        frames
            .into_iter()
            .map(|f| tracker.add(Observation::of_frame(f, &NOISE, &Ahead::default())).err())
            .collect::<Vec<_>>()
    };
    let black = |f: &mut RgbdFrame| f.rgb.fill([2; 3]);
    let unread = |f: &mut RgbdFrame| f.depth_m.fill(0.0);
    let found = [
        (lost_by(&black), Lost::Dark),
        (lost_by(&unread), Lost::Unread),
        (lost_by(&|f: &mut RgbdFrame| [black, unread].iter().for_each(|spoil| spoil(f))), Lost::Covered),
    ];
    for (views, why) in found {
        // Surfaces alone may place a dark view; what is said of one that they do not place is why.
        assert!(views[3].is_none_or(|w| w == why), "{why:?}: {views:?}");
        assert!(why == Lost::Dark || views[3] == Some(why), "{why:?}: {views:?}");
        assert!(views[4].is_none(), "the next view is found again: {views:?}");
    }
    // Nothing but a gray wall, which leaves open where along it the camera is.
    let wall: Vec<RgbdFrame> =
        (0..3).map(|i| view(&|p: &Point3<f64>| p.z - FLOOR_M, eye(i), false, i)).collect();
    let mut tracker = Tracker::new(0);
    let found: Vec<_> = wall
        .into_iter()
        .map(|f| tracker.add(Observation::of_frame(f, &NOISE, &Ahead::default())).err())
        .collect();
    assert_eq!(found[1..], [Some(Lost::Blank); 2]);
}

/// What a live tracker says of frames, which know their poses but do not give them away.
fn live(frames: &[RgbdFrame], most: usize) -> (LiveTracker, Vec<Result<LiveView, Lost>>) {
    let mut tracker = LiveTracker::new(3, most);
    let hidden = |f: &RgbdFrame| RgbdFrame { world_from_camera: Pose::identity(), ..f.clone() };
    let seen = frames
        .iter()
        .map(|f| tracker.see(Observation::of_frame(hidden(f), &NOISE, &Ahead::default())))
        .collect();
    (tracker, seen)
}

#[test]
fn views_are_placed_as_they_come_upright_and_with_what_they_err() {
    let frames = views(&boxes(Vector3::zeros()), 10);
    let (_, seen) = live(&frames, 100);
    let found: Vec<LiveView> = seen.into_iter().map(Result::unwrap).collect();
    for (view, frame) in found.iter().zip(&frames) {
        // Up is that of the floor; the first view stands where the others say.
        let up = frame.world_from_camera.rotation.inverse() * Vector3::z();
        let found_up = view.world_from_camera.rotation.inverse() * Vector3::z();
        assert!(up.angle(&found_up) < 0.02, "{up} {found_up}");
        let way = frames[0].world_from_camera.inverse() * frame.world_from_camera;
        let found_way = found[0].world_from_camera.inverse() * view.world_from_camera;
        let off = (way.inverse() * found_way).translation.vector.norm();
        assert!(off < 0.001 + 4.0 * view.error_m && view.error_m < 0.003, "{off} {view:?}");
        assert!(view.inliers > 0.9 && !view.is_fast, "{view:?}");
        // The floor is the world's.
        let height = frame.world_from_camera.translation.z - FLOOR_M;
        assert!((view.world_from_camera.translation.z - height).abs() < 0.02, "{view:?}");
    }
    assert!(found.windows(2).all(|w| w[1].error_m > 0.0 && w[0].error_m <= w[1].error_m + 0.001));
}

#[test]
fn a_view_that_is_lost_leaves_no_trace_and_looking_back_finds_the_camera() {
    let mut frames = views(&boxes(Vector3::zeros()), 8);
    frames[3].rgb.fill([0; 3]);
    frames[3].depth_m.fill(0.0);
    // Somewhere else: a plain wall.
    frames[4] = view(&|p: &Point3<f64>| 2.0 - p.x.abs().max(p.y.abs()), Point3::new(0.2, 0.1, 0.3), false, 4);
    let (tracker, seen) = live(&frames, 100);
    assert_eq!(seen[3], Err(Lost::Covered));
    assert!(seen[4].is_err(), "{seen:?}");
    assert!(Lost::Covered.remedy().starts_with("keep the lens free"));
    let found = seen[6].unwrap();
    let way = frames[0].world_from_camera.inverse() * frames[6].world_from_camera;
    let off = way.inverse() * (seen[0].unwrap().world_from_camera.inverse() * found.world_from_camera);
    assert!(off.translation.vector.norm() < 0.004, "{off}");
    assert!((2..=6).contains(&tracker.keyframes()), "{}", tracker.keyframes());
}

#[test]
fn a_full_map_takes_no_more_views_and_still_places_them() {
    let frames = views(&boxes(Vector3::zeros()), 6);
    let (tracker, seen) = live(&frames, 2);
    assert!(tracker.is_full() && tracker.keyframes() == 2);
    assert!(seen.iter().all(Result::is_ok), "{seen:?}");
}

#[test]
fn a_camera_that_moves_fast_is_said() {
    let frames: Vec<RgbdFrame> =
        [0, 1, 5].map(|i| view(&boxes(Vector3::zeros()), eye(i), true, i)).into_iter().collect();
    let (_, seen) = live(&frames, 100);
    let fast: Vec<bool> = seen.iter().map(|v| v.unwrap().is_fast).collect();
    assert_eq!(fast, [false, false, true]);
}

#[test]
fn up_is_what_is_known_better_and_a_contradiction_is_said() {
    let frames = views(&boxes(Vector3::zeros()), 6);
    let mut found = track(&frames).0;
    let alone = found.upright_world();
    assert!(alone.by == UpBy::Support && alone.apart_rad.is_none() && !alone.contradicted);
    let sigma_rad = alone.sigma_rad.unwrap();
    assert!((0.005..0.05).contains(&sigma_rad), "{sigma_rad}");
    let up = alone.world_from_map.rotation.inverse() * Vector3::z();
    // Gravity by an instrument, off by an angle, as well known as it says.
    let mut with = |off_rad: f64, sigma_rad: f64| {
        let turn = UnitQuaternion::from_axis_angle(&Unit::new_normalize(up.cross(&Vector3::x())), off_rad);
        let measured = imu::MeasuredUp {
            up: Unit::new_normalize(turn * up),
            sigma_rad,
            bias: Vector3::zeros(),
            windows: 9,
        };
        found.measured_up = Some(Ok(measured));
        let upright = found.upright_world();
        let tilt = (upright.world_from_map.rotation.inverse() * Vector3::z()).angle(&up);
        assert!((upright.apart_rad.unwrap() - off_rad).abs() < 1e-3, "{upright:?}");
        (upright.by, upright.contradicted, (1e3 * tilt).round() as i64)
    };
    assert_eq!(with(0.02, 0.002), (UpBy::Imu, false, 20));
    assert_eq!(with(0.02, 0.07), (UpBy::Support, false, 0));
    assert_eq!(with(0.3, 0.002), (UpBy::Imu, true, 300));
    assert_eq!(with(0.3, 0.07), (UpBy::Support, true, 0));
    found.measured_up = Some(Err(imu::NoGravity::Short { windows: 1 }));
    assert_eq!(found.upright_world().by, UpBy::Support);
}
