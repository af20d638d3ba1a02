use nalgebra::{Point3, Vector3};

use super::*;
use geometry::{Intrinsics, Pose};
use numeric::random::{stage_rng, uniform_in};
use numeric::statistics::SIGMAS_PER_MAD;

const NOISE: NoiseConfig =
    NoiseConfig { constant_m: 0.0, quadratic_per_m: 0.001, edge_sigmas: 6.0, grazing_cosine: 0.15 };

/// Waves in all directions, so that every patch has texture; plain where `contrast` is 0.
fn brightness(p: &Point3<f64>, contrast: f64) -> u8 {
    let mut sum = 0.0;
    for k in 0..12 {
        let rng = &mut stage_rng(5, "waves", k);
        let wave = Vector3::from_fn(|_, _| uniform_in(rng, -160.0, 160.0));
        sum += (wave.dot(&p.coords) + uniform_in(rng, 0.0, 6.0)).sin();
    }
    (127.0 + contrast * sum).clamp(0.0, 255.0) as u8
}

/// Views of the plane z = 0.1 x + 1 from several places, without depth in a square of the plane.
fn views(contrast: f64) -> (Vec<RgbdFrame>, Vec<Vec<f64>>) {
    let intrinsics = Intrinsics { width: 160, height: 120, fx: 150.0, fy: 150.0, cx: 79.0, cy: 60.0 };
    let of = |k: usize| {
        let turn = 0.35 * (k as f64 - 3.0) / 3.0;
        let eye = Vector3::new(turn.sin(), 0.15 * (k % 3) as f64 - 0.15, 1.0 - turn.cos());
        let world_from_camera = Pose::new(eye, Vector3::new(0.0, -turn, 0.0));
        let mut truth = vec![0.0; 160 * 120];
        let mut depth_m = vec![0.0f32; 160 * 120];
        let mut rgb = vec![[0; 3]; 160 * 120];
        for pixel in 0..truth.len() {
            let ray =
                world_from_camera.rotation * intrinsics.ray_at((pixel % 160) as f64, (pixel / 160) as f64);
            // z - 0.1 x = 1 along the ray.
            let at = (1.0 - eye.z + 0.1 * eye.x) / (ray.z - 0.1 * ray.x);
            let point = Point3::from(eye + ray * at);
            truth[pixel] = at;
            rgb[pixel] = [brightness(&point, contrast); 3];
            let is_dark = point.x.abs() < 0.12 && point.y.abs() < 0.12;
            depth_m[pixel] = if is_dark { 0.0 } else { at as f32 };
        }
        let frame = RgbdFrame {
            id: format!("0_{k:04}"),
            stamp_nanos: k as i64,
            intrinsics,
            world_from_camera,
            rgb,
            depth_m,
            mask: Some(vec![true; 160 * 120]),
            readings: Vec::new(),
        };
        (frame, truth)
    };
    (0..7).map(of).unzip()
}

#[test]
fn a_dark_square_gets_the_depth_that_views_agree_on() {
    let (mut frames, truth) = views(14.0);
    let before = frames.clone();
    let found =
        fill_from_color(&mut frames, &NOISE, UseColorDepth::Always, 1, &Stop::never()).unwrap().unwrap();
    assert!(found.filled as f64 > 0.8 * found.holes as f64, "{found:?}");
    let mut errors = Vec::new();
    for ((frame, before), truth) in frames.iter().zip(&before).zip(&truth) {
        for pixel in 0..truth.len() {
            if before.depth_m[pixel] > 0.0 {
                assert!(frame.depth_m[pixel] == before.depth_m[pixel] && frame.readings[pixel] == 1.0);
            } else if frame.depth_m[pixel] > 0.0 {
                errors.push((f64::from(frame.depth_m[pixel]) / truth[pixel] - 1.0).abs());
            }
        }
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors[errors.len() * 95 / 100] < 0.005, "{}", errors[errors.len() * 95 / 100]);
    // What is stated of the errors is their size.
    let sigma = SIGMAS_PER_MAD * errors[errors.len() / 2];
    assert!((0.3..4.0).contains(&(found.relative_sigma / sigma)), "{found:?} {sigma}");
}

#[test]
fn a_square_without_texture_stays_without_depth() {
    let (mut frames, _) = views(0.0);
    let found = fill_from_color(&mut frames, &NOISE, UseColorDepth::Always, 1, &Stop::never()).unwrap();
    assert_eq!(found.unwrap().filled, 0);
}

#[test]
fn a_seed_determines_the_depths() {
    let of = || {
        let (mut frames, _) = views(14.0);
        let _ = fill_from_color(&mut frames, &NOISE, UseColorDepth::Always, 1, &Stop::never()).unwrap();
        frames.into_iter().map(|f| f.depth_m).collect::<Vec<_>>()
    };
    assert_eq!(of(), of());
}

#[test]
fn wide_holes_are_filled_and_shadows_left() {
    let (mut frames, _) = views(14.0);
    assert!(
        fill_from_color(&mut frames.clone(), &NOISE, UseColorDepth::Never, 1, &Stop::never())
            .unwrap()
            .is_none()
    );
    let mut half = frames.clone();
    for frame in &mut half {
        frame.depth_m.iter_mut().enumerate().filter(|(p, _)| p % 160 < 80).for_each(|(_, d)| *d = 0.0);
    }
    assert!(
        fill_from_color(&mut half, &NOISE, UseColorDepth::Auto, 1, &Stop::never())
            .unwrap()
            .is_some_and(|f| f.unread > 0.3)
    );
    // Lines as shadows are: depth beside them everywhere.
    for frame in &mut frames {
        for (pixel, depth_m) in frame.depth_m.iter_mut().enumerate() {
            *depth_m = if pixel % 160 % 40 < 8 { 0.0 } else { 1.0 };
        }
    }
    assert!(fill_from_color(&mut frames, &NOISE, UseColorDepth::Auto, 1, &Stop::never()).unwrap().is_none());
}
