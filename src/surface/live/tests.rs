use nalgebra::{Point3, Vector3};

use super::{LiveMap, LiveSettings, Moved};
use crate::shapes::{cuboid, looking_at_origin, orbit, sphere, view_of};
use capture::{NoiseConfig, PoseNoise, RgbdFrame};
use geometry::{Intrinsics, Pose};
use numeric::random::{isotropic_normal, stage_rng, standard_normal};

const CAMERA: Intrinsics = Intrinsics { width: 200, height: 160, fx: 210.0, fy: 208.0, cx: 101.3, cy: 78.6 };

fn map_of(megabytes: usize) -> LiveMap {
    LiveMap::new(LiveSettings { noise: NoiseConfig::default(), most_bytes: megabytes << 20 })
}

fn from(eye: [f64; 3], shape: &dyn Fn(&Point3<f64>) -> f64) -> RgbdFrame {
    view_of(shape, CAMERA, looking_at_origin(Point3::from(eye)))
}

/// Largest and mean distance of the surface from a shape.
fn errors_m(map: &LiveMap, shape: &dyn Fn(&Point3<f64>) -> f64) -> [f64; 2] {
    let mesh = map.mesh();
    let errors: Vec<f64> = mesh.vertices.iter().map(|p| shape(&p.cast()).abs()).collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    [errors.iter().copied().fold(0.0, f64::max), mean]
}

/// A cabinet on a floor, with a drawer of which so much is outside.
fn cabinet(out_m: f64) -> impl Fn(&Point3<f64>) -> f64 {
    move |p| {
        let body = cuboid(Vector3::new(0.15, 0.15, 0.2))(p);
        let floor = p.z + 0.2;
        body.min(floor).min(drawer(out_m)(p))
    }
}

fn drawer(out_m: f64) -> impl Fn(&Point3<f64>) -> f64 {
    move |p| cuboid(Vector3::new(out_m / 2.0, 0.12, 0.06))(&(p - Vector3::new(0.15 + out_m / 2.0, 0.0, 0.0)))
}

/// Views of a shape from an arc before it, without masks, with the noise of a sensor and of poses.
fn noisy_arc(shape: &dyn Fn(&Point3<f64>) -> f64, seed: u64, poses: &PoseNoise) -> Vec<RgbdFrame> {
    let mut rng = stage_rng(seed, "live", 0);
    let noise = NoiseConfig::default();
    (0..10)
        .map(|i| {
            let (sin, cos) = (-0.9 + 0.2 * f64::from(i)).sin_cos();
            let mut frame = from([0.9 * cos, 0.9 * sin, 0.35], shape);
            frame.mask = None;
            for z in frame.depth_m.iter_mut().filter(|z| **z > 0.0) {
                *z += (noise.sigma_m(f64::from(*z)) * standard_normal(&mut rng)) as f32;
            }
            let off = Pose::new(
                isotropic_normal(&mut rng, poses.translation_m * 3f64.sqrt()),
                isotropic_normal(&mut rng, poses.rotation_rad * 3f64.sqrt()),
            );
            frame.world_from_camera *= off;
            frame
        })
        .collect()
}

fn moved(before: &[RgbdFrame], after: &[RgbdFrame]) -> Moved {
    let mut map = map_of(64);
    before.iter().for_each(|f| assert!(map.add_view(f)));
    assert_eq!(map.moved_surface(), None);
    map.begin_state();
    assert_eq!(map.moved_surface(), None);
    after.iter().for_each(|f| assert!(map.add_view(f)));
    map.refresh();
    map.moved_surface().unwrap()
}

#[test]
fn a_sphere_and_a_wall_lie_within_a_fraction_of_a_spacing() {
    let mut map = map_of(64);
    orbit(&sphere(0.2), 24, 0.8).iter().for_each(|f| assert!(map.add_view(f)));
    map.refresh();
    let [largest_m, mean_m] = errors_m(&map, &sphere(0.2));
    let spacing_m = map.spacing_m();
    assert!((0.005..=0.01).contains(&spacing_m), "{spacing_m}");
    assert!(largest_m < 0.35 * spacing_m && mean_m < 0.05 * spacing_m, "{largest_m} {mean_m} of {spacing_m}");
    // Cells at the seams of chunks belong to one of them, and none is missing.
    let area_m2 = map.mesh().area_m2();
    assert!((area_m2 / (4.0 * std::f64::consts::PI * 0.04) - 1.0).abs() < 0.01, "{area_m2}");
    for (p, color) in map.mesh().vertices.iter().zip(&map.mesh().colors) {
        let expected = crate::shapes::color_of(&p.cast());
        assert!((0..3).all(|k| color[k].abs_diff(expected[k]) <= 8), "{color:?} {expected:?}");
    }

    let wall = |p: &Point3<f64>| p.x + 0.1;
    let mut map = map_of(64);
    for y in [-0.3, -0.1, 0.1, 0.3] {
        assert!(map.add_view(&from([0.8, y, 0.2], &wall)));
    }
    map.refresh();
    let [largest_m, mean_m] = errors_m(&map, &wall);
    assert!(largest_m < 0.1 * map.spacing_m() && mean_m < 0.02 * map.spacing_m(), "{largest_m} {mean_m}");
}

#[test]
fn an_endless_corridor_gets_coarser_and_no_larger() {
    let corridor = |p: &Point3<f64>| (0.6 - p.y.abs()).min(0.5 - p.z.abs());
    let mut map = map_of(8);
    let mut spacings = Vec::new();
    let along = Pose::face_towards(&Point3::origin(), &Point3::new(1.0, 0.5, -0.1), &-Vector3::z());
    for i in 0..60 {
        let mut pose = along;
        pose.translation.vector.x = 0.25 * f64::from(i);
        let mut frame = view_of(&corridor, CAMERA, pose);
        frame.mask = None;
        assert!(map.add_view(&frame));
        map.refresh();
        assert!(map.bytes() <= 8 << 20, "{i}: {}", map.bytes());
        spacings.push(map.spacing_m());
    }
    assert!(spacings[59] >= 4.0 * spacings[0], "{spacings:?}");
    // What was seen at the beginning is still there, and where it was.
    let near = |p: &Point3<f32>| p.x < 1.5;
    let mesh = map.mesh();
    let begin: Vec<_> = mesh.vertices.iter().filter(|p| near(p)).collect();
    assert!(begin.len() > 30, "{}", begin.len());
    // Beside what the views look at cells are up to four times as wide.
    let off_m = mesh.vertices.iter().map(|p| corridor(&p.cast()).abs()).fold(0.0, f64::max);
    assert!(off_m < 4.0 * map.spacing_m(), "{off_m} {}", map.spacing_m());
}

#[test]
fn the_back_is_unseen_and_the_next_view_looks_there() {
    let shape = |p: &Point3<f64>| cuboid(Vector3::new(0.1, 0.1, 0.1))(p).min(p.z + 0.1);
    let front = |i: i32| {
        let mut frame = from([0.8, 0.06 * f64::from(i - 1), 0.35], &shape);
        frame.mask = None;
        frame
    };
    let mut map = map_of(64);
    (0..3).for_each(|i| assert!(map.add_view(&front(i))));
    map.refresh();
    let (unseen, next) = map.unseen_and_next().unwrap();
    // The shadow of the box: its sides and its top; the face that was seen is not unseen.
    assert!(
        unseen.area_m2 > 0.03 && unseen.unseen_share() > 0.1,
        "{} {}",
        unseen.area_m2,
        unseen.unseen_share()
    );
    let is_front = |p: &Point3<f64>| p.x > 0.13 && p.y.abs() < 0.08 && p.z.abs() < 0.08;
    assert!(unseen.patches.iter().all(|p| !is_front(&p.center)));
    assert!(unseen.patches.iter().any(|p| p.center.x < -0.05));
    let next = next.unwrap();
    let eye = next.world_from_camera.translation.vector;
    assert!(eye.x < -0.1 && eye.z > 0.0, "{:?} {}", eye, next.gain_m2);
    let axis = next.world_from_camera.rotation * Vector3::z();
    assert!(axis.dot(&-eye.normalize()) > 0.95, "{axis}");
    let down = next.world_from_camera.rotation * Vector3::y();
    assert!(down.z < 0.0, "{down}");

    let mut frame = view_of(&shape, CAMERA, next.world_from_camera);
    frame.mask = None;
    assert!(map.add_view(&frame));
    map.refresh();
    let left_m2 = map.gain_m2(&next.world_from_camera).unwrap();
    assert!((0.5..1.5).contains(&((next.gain_m2 - left_m2) / next.gain_m2)), "{} {left_m2}", next.gain_m2);
    let (after, _) = map.unseen_and_next().unwrap();
    assert!(after.area_m2 < 0.8 * unseen.area_m2, "{} {}", after.area_m2, unseen.area_m2);
    assert!(after.seen_m2 > unseen.seen_m2 && after.unseen_share() < unseen.unseen_share());
}

#[test]
fn an_object_seen_all_around_needs_no_further_view() {
    let mut map = map_of(64);
    orbit(&sphere(0.2), 40, 0.8).iter().for_each(|f| assert!(map.add_view(f)));
    map.refresh();
    let (unseen, next) = map.unseen_and_next().unwrap();
    assert!(unseen.unseen_share() < 0.02 && next.is_none(), "{} {next:?}", unseen.unseen_share());
}

#[test]
fn what_moved_lights_up_and_nothing_else() {
    let none = PoseNoise { translation_m: 0.0, rotation_rad: 0.0 };
    for (from_m, to_m) in [(0.01, 0.06), (0.08, 0.02)] {
        let moved = moved(&noisy_arc(&cabinet(from_m), 1, &none), &noisy_arc(&cabinet(to_m), 2, &none));
        let (lit, other) = match from_m < to_m {
            true => (&moved.appeared, &moved.gone),
            false => (&moved.gone, &moved.appeared),
        };
        // The front of the drawer has 0.24 m by 0.12 m; half of its sides comes to it.
        assert!((0.015..0.06).contains(&lit.area_m2()), "{} {:?}", from_m, moved.areas_m2());
        assert!(other.area_m2() < 0.002, "{:?}", moved.areas_m2());
        let part = drawer(from_m.max(to_m));
        let off_m = lit.vertices.iter().map(|p| part(&p.cast()).abs()).fold(0.0, f64::max);
        let least_x = lit.vertices.iter().map(|p| p.x).fold(f32::INFINITY, f32::min);
        assert!(off_m < 0.015 && least_x > 0.155, "{off_m} {least_x}");
    }
}

#[test]
fn noise_of_depth_and_poses_lights_nothing() {
    for seed in 0..6u64 {
        let views = |s: u64| noisy_arc(&cabinet(0.05), 10 * seed + s, &PoseNoise::EXPECTED);
        assert_eq!(moved(&views(1), &views(2)).areas_m2(), [0.0; 2], "{seed}");
    }
}

#[test]
fn a_single_view_lights_nothing() {
    let none = PoseNoise { translation_m: 0.0, rotation_rad: 0.0 };
    let before = noisy_arc(&cabinet(0.01), 1, &none);
    let after = noisy_arc(&cabinet(0.08), 2, &none);
    assert_eq!(moved(&before[..1], &after).appeared.area_m2(), 0.0);
    assert_eq!(moved(&before, &after[..1]).areas_m2(), [0.0; 2]);
}

#[test]
fn the_same_views_give_the_same_bytes() {
    let frames = noisy_arc(&cabinet(0.05), 3, &PoseNoise::EXPECTED);
    let made = |threads| {
        let work = || {
            let mut map = map_of(64);
            frames.iter().for_each(|f| {
                map.add_view(f);
                map.refresh();
            });
            let ids: Vec<(i32, u64)> = map.chunks().map(|c| (c.id, c.version)).collect();
            (ids, map.mesh(), map.unseen_and_next(), map.bytes())
        };
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
    };
    let first = made(1);
    assert!(first.0.len() > 10 && first.0.windows(2).any(|w| w[0].1 != w[1].1));
    assert_eq!(first, made(3));
}

#[test]
fn a_surface_that_is_seen_through_goes() {
    let there = cabinet(0.05);
    let gone = |p: &Point3<f64>| (p.z + 0.2).min(p.x + 0.6);
    let none = PoseNoise { translation_m: 0.0, rotation_rad: 0.0 };
    let mut map = map_of(64);
    assert!(map.add_view(&noisy_arc(&there, 1, &none)[4]));
    map.refresh();
    let above = |map: &LiveMap| map.mesh().vertices.iter().filter(|p| p.z > 0.0 && p.x > -0.5).count();
    assert!(above(&map) > 200);
    let empty = noisy_arc(&gone, 2, &none);
    (0..30).for_each(|i| _ = map.add_view(&empty[i % 10]));
    map.refresh();
    assert!(above(&map) < 20, "{}", above(&map));
}

#[test]
fn what_makes_no_sense_is_left_out() {
    let good = from([0.8, 0.0, 0.2], &sphere(0.2));
    let mut map = map_of(0);
    let mut spoil = |change: fn(&mut RgbdFrame)| {
        let mut frame = good.clone();
        change(&mut frame);
        map.add_view(&frame)
    };
    assert!(!spoil(|f| f.world_from_camera.translation.vector.x = f64::NAN));
    assert!(!spoil(|f| f.world_from_camera.translation.vector.x = 1e300));
    assert!(!spoil(|f| f.intrinsics.fx = 0.0));
    assert!(!spoil(|f| f.intrinsics.cx = f64::INFINITY));
    assert!(!spoil(|f| f.intrinsics.width = usize::MAX));
    assert!(!spoil(|f| f.rgb.clear()));
    assert!(!spoil(|f| f.mask = Some(Vec::new())));
    assert!(!spoil(|f| f.depth_m.fill(0.0)));
    assert!(!spoil(|f| f.depth_m.fill(f32::NAN)));
    assert!(!spoil(|f| f.depth_m.fill(f32::INFINITY)));
    assert!(!spoil(|f| f.depth_m.fill(-1.0)));
    assert_eq!((map.view_count(), map.bytes()), (0, 0));
    // A wide and a narrow camera, depths at both ends: bounded, whatever they show.
    for (fx, depth_m) in [(1e-3, 2.9), (1e9, 2.9), (200.0, 1e-6), (200.0, 2.99), (1e-3, 1e-3)] {
        let mut frame = good.clone();
        (frame.intrinsics.fx, frame.intrinsics.fy) = (fx, fx);
        frame.mask = None;
        frame.depth_m.fill(depth_m);
        map.add_view(&frame);
        map.refresh();
        _ = map.unseen_and_next();
        assert!(map.bytes() <= LiveSettings::LEAST_BYTES, "{fx} {depth_m} {}", map.bytes());
    }
}
