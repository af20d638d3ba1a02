use nalgebra::{Point3, Vector3};
use rand_core::Rng;

use super::{depth_warp::DepthWarp, *};
use crate::analytic::{cuboid, looking_at_origin, view_of};
use geometry::{Intrinsics, Pose, exp_so3, shift_and_turn};
use numeric::{random::stage_rng, statistics::CHI_SQUARE_999};

const NOISE: NoiseConfig =
    NoiseConfig { constant_m: 0.0005, quadratic_per_m: 0.0005, edge_sigmas: 6.0, grazing_cosine: 0.15 };
const INTRINSICS: Intrinsics =
    Intrinsics { width: 240, height: 180, fx: 230.0, fy: 230.0, cx: 119.2, cy: 91.0 };

struct Normal(Box<dyn FnMut() -> f64>);

impl Normal {
    fn new(seed: u64) -> Self {
        let mut rng = stage_rng(seed, "poses", 0);
        Self(Box::new(move || (0..12).map(|_| rng.next_u64() as f64 / u64::MAX as f64).sum::<f64>() - 6.0))
    }

    fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| sigma * (self.0)())
    }

    /// Adds depth noise, so many times that of the model.
    fn spoil(&mut self, frame: &mut RgbdFrame, times: f64) {
        for d in frame.depth_m.iter_mut().filter(|d| **d > 0.0) {
            *d += (times * NOISE.sigma_m(f64::from(*d)) * (self.0)()) as f32;
        }
    }
}

/// A box with a smaller one on it, on a floor.
fn boxes(p: &Point3<f64>) -> f64 {
    let upper = cuboid(Vector3::new(0.05, 0.07, 0.06))(&(p - Vector3::new(0.08, 0.03, 0.16)));
    let floor = cuboid(Vector3::new(0.7, 0.7, 0.02))(&(p + Vector3::new(0.0, 0.0, 0.12)));
    cuboid(Vector3::new(0.2, 0.15, 0.1))(p).min(upper).min(floor)
}

fn wall(p: &Point3<f64>) -> f64 {
    cuboid(Vector3::new(2.0, 2.0, 0.02))(p)
}

/// Frames of a scene from places in a quarter circle, with depth noise.
fn frames(scene: &dyn Fn(&Point3<f64>) -> f64, tilt: f64, count: usize) -> Vec<RgbdFrame> {
    let mut normal = Normal::new(5);
    let view = |i: usize| {
        // Every frame sees two sides of the boxes.
        let turn = 0.5 + 0.6 * i as f64 / count as f64;
        let eye = Point3::new(0.8 * tilt * turn.cos(), 0.8 * tilt * turn.sin(), 0.6 + 0.1 * (i % 3) as f64);
        let mut frame = view_of(scene, INTRINSICS, looking_at_origin(eye));
        frame.mask = None;
        normal.spoil(&mut frame, 1.0);
        frame
    };
    (0..count).map(view).collect()
}

/// The frames with errors of their poses of that size along and about each axis.
fn disturbed(frames: &[RgbdFrame], translation_m: f64, rotation_rad: f64) -> Vec<RgbdFrame> {
    let mut normal = Normal::new(9);
    let moved = |f: &RgbdFrame| {
        let error = Pose::new(normal.vector(translation_m), normal.vector(rotation_rad));
        RgbdFrame { world_from_camera: f.world_from_camera * error, ..f.clone() }
    };
    frames.iter().map(moved).collect()
}

/// The poses of one state corrected.
fn refine(frames: &mut [RgbdFrame]) -> Option<PoseCorrection> {
    let surfels: Vec<Surfels> = frames.iter().map(|f| Surfels::of_frame(f, &NOISE, |_| true)).collect();
    let Refined { poses, correction, .. } =
        Refined::of_state_alone(&problem_of_state(frames, &surfels, Matches::new(), false, &Stop::never())?)
            .unwrap()?;
    if correction.used {
        frames.iter_mut().zip(poses).for_each(|(f, pose)| f.world_from_camera = pose);
    }
    Some(correction)
}

/// Root mean square error of the cameras' motions from one to the next: meters, radians. These are free of
/// the gauge.
fn relative_errors(found: &[RgbdFrame], truth: &[RgbdFrame]) -> [f64; 2] {
    let motion = |w: &[RgbdFrame]| w[0].world_from_camera.inverse() * w[1].world_from_camera;
    let errors: Vec<Pose> =
        found.windows(2).zip(truth.windows(2)).map(|(f, t)| motion(t).inverse() * motion(f)).collect();
    let rms = |value: &dyn Fn(&Pose) -> f64| {
        (errors.iter().map(|e| value(e).powi(2)).sum::<f64>() / errors.len() as f64).sqrt()
    };
    [rms(&|e| e.translation.vector.norm()), rms(&|e| e.rotation.angle())]
}

#[test]
fn known_errors_are_found() {
    let truth = frames(&boxes, 1.0, 9);
    let reported = disturbed(&truth, 0.004, 0.006);
    let mut found = reported.clone();
    let correction = refine(&mut found).unwrap();
    assert!(correction.used, "{correction:?}");
    let before = relative_errors(&reported, &truth);
    let after = relative_errors(&found, &truth);
    assert!(after[0] < 0.2 * before[0] && after[1] < 0.03 * before[1], "{before:?} {after:?}");
    assert!(correction.residual_m[1] < 0.4 * correction.residual_m[0], "{correction:?}");
    // The gauge: corrections in the camera's frame have about no mean.
    let corrections = found
        .iter()
        .zip(&reported)
        .map(|(f, t)| super::solve::correction_of_pose(&t.world_from_camera, &f.world_from_camera)[0]);
    let mean = corrections.sum::<Vector3<f64>>() / found.len() as f64;
    assert!(mean.norm() < 0.5 * correction.translation_rms_m, "{mean} {correction:?}");
}

#[test]
fn exact_poses_stay() {
    let truth = frames(&boxes, 1.0, 8);
    let mut found = truth.clone();
    let correction = refine(&mut found).unwrap();
    assert!(!correction.used, "{correction:?}");
    assert!(found.iter().zip(&truth).all(|(f, t)| f.world_from_camera == t.world_from_camera));
}

#[test]
fn a_wall_seen_from_the_front_does_not_slide() {
    let truth = frames(&wall, 0.1, 6);
    let reported = disturbed(&truth, 0.004, 0.006);
    let mut found = reported.clone();
    refine(&mut found);
    for (f, t) in found.iter().zip(&reported) {
        // Nothing shows motions along the wall and of turns about its normal, where the cameras look but
        // for 6 degrees: they stay within what is expected of poses.
        let [moved, turned] = super::solve::correction_of_pose(&t.world_from_camera, &f.world_from_camera);
        assert!(
            moved.xy().norm() < PoseNoise::EXPECTED.translation_m
                && turned.z.abs() < PoseNoise::EXPECTED.rotation_rad,
            "{moved} {turned}"
        );
    }
    // Across the wall they agree: heights of all cameras are right up to their common error.
    let height =
        |f: &RgbdFrame, t: &RgbdFrame| f.world_from_camera.translation.z - t.world_from_camera.translation.z;
    let spread = |set: &[RgbdFrame]| {
        let all: Vec<f64> = set.iter().zip(&truth).map(|(f, t)| height(f, t)).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        all.iter().map(|h| (h - mean).powi(2)).sum::<f64>().sqrt()
    };
    assert!(spread(&found) < 0.5 * spread(&reported), "{} {}", spread(&found), spread(&reported));
}

#[test]
fn the_result_does_not_depend_on_the_threads() {
    let reported = disturbed(&frames(&boxes, 1.0, 5), 0.004, 0.006);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut found = reported.clone();
        let correction = pool.install(|| refine(&mut found));
        (correction, found.iter().map(|f| f.world_from_camera).collect::<Vec<_>>())
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn few_frames_tell_nothing() {
    let mut two = disturbed(&frames(&boxes, 1.0, 2), 0.004, 0.006);
    assert_eq!(refine(&mut two), None);
}

#[test]
fn the_mean_error_of_a_state_is_found_beside_a_part_that_moved() {
    // Walls behind show the turn about the vertical, of which the boxes' sides alone show too little to be
    // followed.
    let side = |p: &Point3<f64>| cuboid(Vector3::new(0.02, 0.7, 0.5))(&(p + Vector3::new(0.5, 0.0, 0.0)));
    let back = |p: &Point3<f64>| cuboid(Vector3::new(0.7, 0.02, 0.5))(&(p + Vector3::new(0.0, 0.5, 0.0)));
    let closed = |p: &Point3<f64>| boxes(p).min(side(p)).min(back(p));
    let opened = |p: &Point3<f64>| {
        closed(p).min(cuboid(Vector3::new(0.02, 0.1, 0.08))(&(p - Vector3::new(0.25, 0.0, 0.0))))
    };
    let [state0, state1] = [frames(&closed, 1.0, 9), frames(&opened, 1.2, 9)];
    let drift = Pose::new(Vector3::new(0.003, -0.002, 0.002), Vector3::new(0.002, 0.001, -0.003));
    let reported: Vec<RgbdFrame> = state1
        .iter()
        .map(|f| RgbdFrame { world_from_camera: drift * f.world_from_camera, ..f.clone() })
        .collect();
    let found = align_worlds([&state0, &reported], &NOISE, &PoseNoise::EXPECTED, false, &Stop::never())
        .unwrap()
        .unwrap();
    let left = found.corrected_from_reported * drift;
    assert!(left.translation.vector.norm() < 0.0005 && left.rotation.angle() < 0.0007, "{left}");
    let error = shift_and_turn(&left);
    let covariance = found.covariance.unwrap();
    let squared = error.dot(&(covariance.try_inverse().unwrap() * error));
    assert!(
        squared < CHI_SQUARE_999[5],
        "{squared} squared deviations in six directions: {error} {covariance}"
    );
    let few = align_worlds([&state0[..6], &reported], &NOISE, &PoseNoise::EXPECTED, false, &Stop::never())
        .unwrap()
        .unwrap();
    assert_eq!(few.covariance, None, "six frames do not determine the spread of six parameters");
    assert!(found.residual_m[1] < found.residual_m[0]);
    let still =
        align_worlds([&state0, &state1], &NOISE, &PoseNoise::EXPECTED, false, &Stop::never()).unwrap();
    assert!(still.is_none_or(|s| s.moved_m < 0.0005 && s.turned_rad < 0.0007));
}

/// A room: floor, two walls and boxes, which cameras see from all over.
fn room(p: &Point3<f64>) -> f64 {
    let floor = cuboid(Vector3::new(1.2, 1.2, 0.02))(&(p + Vector3::new(0.0, 0.0, 0.12)));
    let side = cuboid(Vector3::new(0.02, 1.2, 0.8))(&(p + Vector3::new(0.8, 0.0, 0.0)));
    let back = cuboid(Vector3::new(1.2, 0.02, 0.8))(&(p + Vector3::new(0.0, 0.8, 0.0)));
    boxes(p).min(floor).min(side).min(back)
}

/// Frames of the room from places that are drawn, with depth noise and errors of the poses.
fn of_room(seed: u64, count: usize) -> Vec<RgbdFrame> {
    drawn_room(seed, count, true)
}

/// The same without noise and errors.
fn room_as_it_is(seed: u64, count: usize) -> Vec<RgbdFrame> {
    drawn_room(seed, count, false)
}

fn drawn_room(seed: u64, count: usize, with_errors: bool) -> Vec<RgbdFrame> {
    let mut normal = Normal::new(seed);
    let mut drift = Pose::identity();
    let size = f64::from(u8::from(with_errors));
    let view = |i: usize| {
        let turn = 0.3 + 0.9 * i as f64 / count as f64 + 0.1 * (normal.0)();
        let away = 1.0 + 0.2 * (normal.0)();
        let eye = Point3::new(away * turn.cos(), away * turn.sin(), 0.5 + 0.15 * (normal.0)());
        let mut frame = view_of(&room, INTRINSICS, looking_at_origin(eye));
        frame.world_from_camera.rotation *= exp_so3(&normal.vector(0.1));
        let mut frame = view_of(&room, INTRINSICS, frame.world_from_camera);
        frame.mask = None;
        normal.spoil(&mut frame, size);
        let jitter = Pose::new(normal.vector(0.001 * size), normal.vector(0.001 * size));
        drift *= Pose::new(normal.vector(0.0008 * size), normal.vector(0.0008 * size));
        frame.world_from_camera = drift * frame.world_from_camera * jitter;
        frame
    };
    (0..count).map(view).collect()
}

#[test]
fn a_camera_that_sits_off_its_hand_is_seen_by_all_poses() {
    let mut normal = Normal::new(7);
    let off = Pose::new(normal.vector(0.002), normal.vector(0.003));
    // Of a robot: poses are exact but for where the camera sits.
    let truth = room_as_it_is(3, 16);
    let mut reported = truth.clone();
    for frame in &mut reported {
        normal.spoil(frame, 1.0);
        frame.world_from_camera *= off;
    }
    let [before, _] = relative_errors(&reported, &truth);
    let errors = refine(&mut reported).expect("enough is seen").errors;
    let [after, _] = relative_errors(&reported, &truth);
    assert!(after < 0.1 * before, "{after} of {before}");
    assert!(errors.jitter.translation_m < 2e-4 && errors.walk.translation_m < 1e-4, "{errors:?}");
    assert!(errors.mounting.rotation_rad > 1e-3, "{errors:?}");
}

#[test]
fn views_of_another_state_straighten_those_of_a_bent_one() {
    let states = [2, 3].map(|seed| {
        let mut normal = Normal::new(seed);
        let mut frames = room_as_it_is(seed, 10);
        frames.iter_mut().for_each(|frame| normal.spoil(frame, 1.0));
        frames
    });
    let truth: Vec<Pose> = states.iter().flatten().map(|f| f.world_from_camera).collect();
    // The second half of state 1 is 3 mm off.
    let bent: Vec<Pose> = (0..truth.len())
        .map(|i| {
            let off_m = if i < 15 { 0.0 } else { 0.003 };
            Pose::from_parts(Vector3::new(off_m, off_m, 0.0).into(), Default::default()) * truth[i]
        })
        .collect();
    let joined = Joined {
        surfels: states.iter().flatten().map(|f| Surfels::of_frame(f, &NOISE, |_| true)).collect(),
        reported: bent.chunks(10).map(<[Pose]>::to_vec).collect(),
        found: bent.clone(),
        matches: Matches::new(),
        errors: vec![super::drift::PoseErrors::EXPECTED; 2],
    };
    let found = joined.most_likely_poses(&[ErrorDraw::default()], &Stop::never()).unwrap().unwrap();
    let apart_m = |poses: &[Pose]| {
        let of_view = |i: usize| poses[0].inverse() * poses[i];
        let off = |i: usize| (truth[0].inverse() * truth[i]).inverse() * of_view(i);
        (15..20).map(|i| off(i).translation.vector.norm()).fold(0.0, f64::max)
    };
    let [before_m, after_m] = [apart_m(&bent), apart_m(&found.poses)];
    assert!(before_m > 0.004 && after_m < 0.001, "{before_m} {after_m}");
    assert_eq!([found.draws.len(), found.draws[0].len()], [1, 20]);
}

/// The frames as a sensor with those errors reads them.
fn warped(mut states: Vec<Vec<RgbdFrame>>, warp: &DepthWarp) -> Vec<Vec<RgbdFrame>> {
    let width = INTRINSICS.width;
    for depth_m in states.iter_mut().flatten().map(|f| &mut f.depth_m) {
        for (i, d) in depth_m.iter_mut().enumerate() {
            *d /= (1.0 + warp.relative_error_at([(i % width) as f64, (i / width) as f64])) as f32;
        }
    }
    states
}

/// Smooth errors and one of scale, drawn.
fn drawn_warp(seed: u64) -> DepthWarp {
    let mut normal = Normal::new(seed);
    let mut warp = DepthWarp::without_errors(&INTRINSICS);
    let smooth = warp.smooth_covariance().cholesky().unwrap().l();
    let scale = 0.004 * (normal.0)();
    let values = smooth * nalgebra::DVector::from_fn(warp.values.len(), |_, _| 0.004 * (normal.0)());
    warp.values = values.iter().map(|v| v + scale).collect();
    warp
}

#[test]
fn the_errors_of_a_sensor_are_found_within_their_deviation() {
    let mut squares = Vec::new();
    let mut left = 0.0;
    let mut before = 0.0;
    for seed in 0..4 {
        let truth = drawn_warp(seed);
        let mut states = warped((0..2).map(|s| of_room(10 * seed + s, 12)).collect(), &truth);
        let found = refine_poses(&mut states, &NOISE, false, &Ahead::default(), &Stop::never())
            .unwrap()
            .sensor
            .unwrap();
        assert!(found.used, "{found}");
        let count = truth.values.len();
        let covariance = nalgebra::DMatrix::from_column_slice(count, count, &found.covariance);
        // At places all over the image.
        for pixel in (0..48).map(|i| [15.0 + 30.0 * f64::from(i % 8), 15.0 + 30.0 * f64::from(i / 8)]) {
            let mut support = nalgebra::DVector::zeros(count);
            truth.support_at(pixel).iter().for_each(|(k, weight)| support[k] += weight);
            let error = found.warp.relative_error_at(pixel) - truth.relative_error_at(pixel);
            squares.push(error.powi(2) / (support.dot(&(&covariance * &support))));
            left += error.powi(2);
            before += truth.relative_error_at(pixel).powi(2);
        }
    }
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    assert!(left < 0.1 * before, "{left} of {before}");
    assert!((0.05..2.25).contains(&mean), "{mean} squared deviations");
}

#[test]
fn a_sensor_without_errors_stays() {
    let read: Vec<_> = (0..2).map(|s| of_room(s, 10)).collect();
    let mut states = read.clone();
    let found = refine_poses(&mut states, &NOISE, false, &Ahead::default(), &Stop::never()).unwrap();
    let sensor = found.sensor.unwrap();
    assert!(!sensor.used, "{sensor}");
    assert!(states.iter().flatten().zip(read.iter().flatten()).all(|(a, b)| a.depth_m == b.depth_m));
}

#[test]
fn the_order_of_the_states_does_not_matter() {
    let states = warped((0..2).map(|s| of_room(s, 8)).collect(), &drawn_warp(1));
    let [mut forward, mut backward] = [states.clone(), states.into_iter().rev().collect()];
    let [one, other] = [&mut forward, &mut backward]
        .map(|s| refine_poses(s, &NOISE, false, &Ahead::default(), &Stop::never()).unwrap().sensor.unwrap());
    let apart = one.warp.values.iter().zip(&other.warp.values).map(|(a, b)| (a - b).abs());
    assert!(apart.fold(0.0, f64::max) < 1e-6, "{one} {other}");
}

/// A number in `[0, 1]` that a cell of space draws.
fn drawn_at(cell: [i64; 3]) -> f64 {
    let mixed = cell.iter().fold(0x9e37_79b9_u64, |h, c| (h ^ *c as u64).wrapping_mul(0xff51_afd7_ed55_8ccd));
    (mixed ^ (mixed >> 33)).wrapping_mul(0xc4ce_b9fe_1a85_ec53) as f64 / u64::MAX as f64
}

/// A gray that changes over centimeters.
fn texture(p: &Point3<f64>) -> u8 {
    const CELL_M: f64 = 0.025;
    let place = p.coords / CELL_M;
    let corner = place.map(f64::floor);
    let weight = |at: f64, far: i64| if far == 1 { at } else { 1.0 - at };
    let within = place - corner;
    let sum: f64 = (0..8i64)
        .map(|i| {
            let far = [i & 1, i >> 1 & 1, i >> 2];
            let cell = [0, 1, 2].map(|k| corner[k] as i64 + far[k]);
            (0..3).map(|k| weight(within[k], far[k])).product::<f64>() * drawn_at(cell)
        })
        .sum();
    (255.0 * sum) as u8
}

/// The frames with the texture of space, which lies so many pixels beside their depth.
fn painted(mut frames: Vec<RgbdFrame>, [du, dv]: [i64; 2]) -> Vec<RgbdFrame> {
    for f in &mut frames {
        let width = f.intrinsics.width as i64;
        let height = f.intrinsics.height as i64;
        let color = |i: i64| {
            let u = i % width - du;
            let v = i / width - dv;
            let inside = (0..width).contains(&u) && (0..height).contains(&v);
            let point = inside.then(|| f.world_point((v * width + u) as usize)).flatten();
            [point.map_or(0, |p| texture(&p)); 3]
        };
        f.rgb = (0..width * height).map(color).collect();
    }
    frames
}

#[test]
fn texture_shows_how_far_cameras_slid_along_a_wall() {
    let truth = painted(frames(&wall, 0.5, 8), [0, 0]);
    let reported = disturbed(&truth, 0.004, 0.002);
    let mut found = vec![reported.clone()];
    let findings = refine_poses(&mut found, &NOISE, false, &Ahead::default(), &Stop::never()).unwrap();
    assert!(findings.states[0].as_ref().is_some_and(|s| s.used), "{findings:?}");
    let before = relative_errors(&reported, &truth);
    let after = relative_errors(&found[0], &truth);
    assert!(after[0] < 0.4 * before[0] && after[1] < 0.4 * before[1], "{before:?} {after:?}");
}

#[test]
fn color_that_lies_beside_its_depth_is_found_and_moved() {
    let shift_px = [2, -1];
    let truth = drawn_warp(3);
    // Painted where cameras are, before poses and depth get their errors.
    let states = (0..2).map(|s| of_room(s, 12)).collect();
    let painted_as_seen = |frames: Vec<RgbdFrame>, seed: u64| {
        let seen = painted(room_as_it_is(seed, frames.len()), shift_px);
        frames.into_iter().zip(seen).map(|(f, s)| RgbdFrame { rgb: s.rgb, ..f }).collect::<Vec<_>>()
    };
    let states: Vec<Vec<RgbdFrame>> = warped(states, &truth);
    let mut states: Vec<Vec<RgbdFrame>> =
        states.into_iter().zip(0..).map(|(frames, seed)| painted_as_seen(frames, seed)).collect();
    let before = states[0][0].rgb.clone();
    let found =
        refine_poses(&mut states, &NOISE, false, &Ahead::default(), &Stop::never()).unwrap().sensor.unwrap();
    assert!(found.used, "{found}");
    for k in 0..2 {
        let error = found.color_shift_px[0][k] - shift_px[k] as f64;
        assert!(error.abs() < 0.4, "{found:?}");
    }
    assert_ne!(states[0][0].rgb, before, "colors were moved");
}

/// A camera that is carried by hand about the room, unevenly: an even turn at another time is the same turn
/// of another world.
fn carried(seconds: f64) -> Pose {
    let turn = 0.8 + 0.45 * (1.9 * seconds).sin();
    looking_at_origin(Point3::new(0.8 * turn.cos(), 0.8 * turn.sin(), 0.65 + 0.2 * (2.6 * seconds).cos()))
}

/// Painted frames of it, a tenth of a second apart, from some time on, whose poses are older by a lag.
fn late(from_s: f64, count: usize, lag_s: f64) -> Vec<RgbdFrame> {
    let mut normal = Normal::new(17);
    let mut view = |i: usize| {
        let time_s = from_s + 0.1 * i as f64;
        let mut frame = view_of(&room, INTRINSICS, carried(time_s));
        frame.mask = None;
        frame.stamp_nanos = (1e9 * time_s) as i64;
        normal.spoil(&mut frame, 1.0);
        frame
    };
    let mut frames = painted((0..count).map(&mut view).collect(), [0, 0]);
    for frame in &mut frames {
        frame.world_from_camera = carried(frame.stamp_nanos as f64 * 1e-9 - lag_s);
    }
    frames
}

#[test]
fn poses_that_are_older_than_their_images_are_found() {
    // Beside an error of depth, or nothing would need a sensor.
    for lag_s in [0.015, -0.015] {
        let read = (0..2).map(|s| late(3.0 * f64::from(s), 14, lag_s)).collect();
        let mut states = warped(read, &drawn_warp(2));
        let found = refine_poses(&mut states, &NOISE, false, &Ahead::default(), &Stop::never())
            .unwrap()
            .sensor
            .unwrap();
        let [found_s, sigma_s] = found.pose_lag_s;
        assert!(found.used && sigma_s < 0.004, "{found}");
        assert!((found_s - lag_s).abs() < 3.0 * sigma_s.max(0.001), "{lag_s} {found}");
        assert!(!found.has_late_poses());
    }
}

#[test]
fn a_delay_of_half_a_second_is_named_and_undone() {
    let truth = late(0.0, 20, 0.0);
    for lag_s in [0.5, -0.4] {
        let reported = late(0.0, 20, lag_s);
        let mut found = vec![reported.clone()];
        let agreement =
            refine_poses(&mut found, &NOISE, false, &Ahead::default(), &Stop::never()).unwrap().agreement[0]
                .unwrap();
        let delay_s = agreement.certain_delay_s();
        assert!(delay_s.is_some_and(|d| (d - lag_s).abs() < 0.05), "{lag_s} {agreement:?}");
        let before = relative_errors(&reported, &truth);
        let after = relative_errors(&found[0], &truth);
        assert!(after[0] < 0.5 * before[0], "{before:?} {after:?}");
    }
}

#[test]
fn poses_that_no_time_explains_contradict() {
    let agreement = |frames: Vec<RgbdFrame>| {
        refine_poses(&mut [frames], &NOISE, false, &Ahead::default(), &Stop::never()).unwrap().agreement[0]
            .unwrap()
    };
    let right = agreement(late(0.0, 12, 0.0));
    assert!(!right.contradicts() && right.share > 0.8, "{right:?}");
    let lost = agreement(disturbed(&late(0.0, 12, 0.0), 0.08, 0.08));
    assert!(lost.contradicts() && lost.certain_delay_s().is_none(), "{lost:?}");
}

#[test]
fn draws_are_as_large_as_what_is_left_of_the_errors() {
    let mut left = [0.0; 2];
    let mut drawn = [0.0; 2];
    for seed in 0..3 {
        let truth = late(0.3 * f64::from(seed), 12, 0.0);
        let mut found = vec![disturbed(&truth, 0.003, 0.004)];
        let findings = refine_poses(&mut found, &NOISE, false, &Ahead::default(), &Stop::never()).unwrap();
        assert!(findings.has_changes() && findings.draws.len() > 8);
        let square = |sum: &mut [f64; 2], errors: [f64; 2], share: f64| {
            (0..2).for_each(|k| sum[k] += share * errors[k].powi(2));
        };
        square(&mut left, relative_errors(&found[0], &truth), 1.0);
        for draw in &findings.draws {
            let moved = |(f, error): (&RgbdFrame, &Vector6<f64>)| {
                let [shift, turn] = [0, 3].map(|k| error.fixed_rows::<3>(k).into_owned());
                RgbdFrame { world_from_camera: f.world_from_camera * Pose::new(shift, turn), ..f.clone() }
            };
            let moved: Vec<RgbdFrame> = found[0].iter().zip(&draw.poses[0]).map(moved).collect();
            square(&mut drawn, relative_errors(&moved, &found[0]), 1.0 / findings.draws.len() as f64);
        }
    }
    for k in 0..2 {
        let ratio = (left[k] / drawn[k]).sqrt();
        assert!((0.3..1.5).contains(&ratio), "{k}: {ratio} {left:?} {drawn:?}");
    }
}

#[test]
fn tracked_poses_have_the_errors_that_their_frames_leave_open() {
    let truth = frames(&boxes, 0.8, 8);
    let mut reported = vec![truth.clone()];
    assert!(
        refine_poses(&mut reported, &NOISE, false, &Ahead::default(), &Stop::never())
            .unwrap()
            .draws
            .is_empty(),
        "right poses have no errors"
    );
    let mut tracked = vec![disturbed(&truth, 0.0005, 0.0005)];
    let found = refine_poses(&mut tracked, &NOISE, true, &Ahead::default(), &Stop::never()).unwrap();
    assert!(found.states[0].as_ref().is_some_and(|s| s.used && !s.beyond_expected()), "{found:?}");
    assert!(!found.draws.is_empty());
    // Of one frame against the next, as nothing shows where all are.
    let step = |draw: &ErrorDraw| (draw.poses[0][4] - draw.poses[0][3]).fixed_rows::<3>(0).norm_squared();
    let open_m = (found.draws.iter().map(step).sum::<f64>() / found.draws.len() as f64).sqrt();
    let [left_m, _] = relative_errors(&tracked[0], &truth);
    assert!(left_m < 3.0 * open_m && open_m < 0.005, "{left_m} {open_m}");
}
