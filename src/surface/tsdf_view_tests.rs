//! Readings of single pixels, and what lies between them.

use nalgebra::Point3;

use super::*;

const K: Intrinsics = Intrinsics { width: 5, height: 4, fx: 6.0, fy: 5.0, cx: 2.2, cy: 1.4 };

/// A slanted plane, whose inverse depth is linear in the pixel.
fn inverse_depth(u: f64, v: f64) -> f64 {
    1.2 + 0.02 * u - 0.03 * v
}

fn frame() -> RgbdFrame {
    let count = K.width * K.height;
    let depth_m = |i: usize| (1.0 / inverse_depth((i % K.width) as f64, (i / K.width) as f64)) as f32;
    RgbdFrame {
        id: String::new(),
        stamp_nanos: 0,
        intrinsics: K,
        world_from_camera: Pose::identity(),
        rgb: vec![[0; 3]; count],
        depth_m: (0..count).map(depth_m).collect(),
        mask: None,
        readings: Vec::new(),
    }
}

#[test]
fn readings_weigh_by_their_precision_and_have_a_sign_by_their_role() {
    let noise = NoiseConfig::default();
    let mut frame = frame();
    frame.depth_m[..8].copy_from_slice(&[2.0, 2.0, 2.0, 0.0, 0.0, 0.0, 0.5, 0.5]);
    let mut roles = vec![PixelRole::Skip; frame.depth_m.len()];
    use PixelRole::{FreeOnly, Skip, Surface};
    roles[..8].copy_from_slice(&[Surface, FreeOnly, Skip, Surface, FreeOnly, Skip, Surface, FreeOnly]);
    let view = TsdfView::new(&frame, &vec![0.5; roles.len()], &roles, Pose::identity(), &noise);
    let precision = |depth_m: f64| ((noise.sigma_m(1.0) / noise.sigma_m(depth_m)).powi(2)) as f32;
    // Empty space is never surer than at a meter; without a depth all of the ray is empty.
    let expected = [
        (2.0, 0.5 * precision(2.0)),
        (2.0, -precision(2.0)),
        (0.0, 0.0),
        (0.0, 0.0),
        (f32::INFINITY, -1.0),
        (0.0, 0.0),
        (0.5, 0.5 * precision(0.5)),
        (0.5, -1.0),
    ];
    for (reading, (depth_m, weight)) in view.readings.iter().zip(expected) {
        assert_eq!(reading.depth_m, depth_m);
        assert!((reading.signed_weight() - weight).abs() < 1e-6, "{} {weight}", reading.signed_weight());
        assert_eq!((reading.weight(), reading.is_surface()), (reading.signed_weight().abs(), weight > 0.0));
    }
    assert!(precision(0.5) > 1.5);
}

fn readings_of(frame: &RgbdFrame) -> Vec<Reading> {
    frame.depth_m.iter().map(|d| Reading::of_surface(*d, 1.0)).collect()
}

#[test]
fn a_plane_is_exact_between_pixels_and_unknown_beyond_them() {
    let readings = readings_of(&frame());
    let at = |u: f32, v: f32| interpolated_depth(&readings, &K, [u + 0.5, v + 0.5], 0.1);
    for (u, v) in [(0.0, 0.0), (0.3, 0.6), (3.9, 2.9), (2.0, 1.25), (3.5, 0.0), (0.0, 2.5)] {
        let depth_m = 1.0 / inverse_depth(f64::from(u), f64::from(v));
        assert!(at(u, v).is_some_and(|d| (f64::from(d) - depth_m).abs() < 1e-6), "{u} {v}: {:?}", at(u, v));
    }
    for (u, v) in [(-0.1, 1.0), (1.0, -0.1), (4.0, 1.0), (1.0, 3.0), (4.2, 1.0), (1.0, 3.2)] {
        assert_eq!(at(u, v), None, "{u} {v}");
    }
}

#[test]
fn readings_of_two_surfaces_have_nothing_between_them() {
    let mut readings = readings_of(&frame());
    // A step of 0.1 m at pixel (2, 1): further behind, or before.
    let first = readings[7].depth_m;
    for step_m in [0.1, -0.1] {
        readings[7] = Reading::of_surface(first + step_m, 1.0);
        let at = |u: f32, v: f32, truncation_m: f32| {
            interpolated_depth(&readings, &K, [u + 0.5, v + 0.5], truncation_m)
        };
        for (u, v) in [(1.5, 0.5), (2.5, 0.5), (1.5, 1.5), (2.5, 1.5)] {
            assert_eq!(at(u, v, 0.05), None, "{u} {v}");
            assert!(at(u, v, 0.2).is_some(), "{u} {v}");
        }
        assert!(at(3.5, 1.5, 0.05).is_some() && at(0.5, 1.5, 0.05).is_some());
    }
    // Nor have those of which one is no surface.
    readings[7] = Reading::of_free_space(first, 1.0);
    assert_eq!(interpolated_depth(&readings, &K, [2.0, 1.0], 0.2), None);
}

/// What some readings, all of one depth, say of a point before pixel (2, 1).
fn said_at(reading: Reading, z_m: f32, truncation_m: f32) -> Option<(Option<f32>, f32)> {
    let camera = RowCamera::new(&K, &Pose::identity(), &Point3::origin(), 0.1);
    let ray = K.ray_at(2.0, 1.0).cast::<f32>();
    match reading_of_node(&[reading; K.width * K.height], &K, &camera, &(ray * z_m), truncation_m)? {
        NodeReading::Free { weight } => Some((None, weight)),
        NodeReading::Near { s, weight, pixel } => {
            assert_eq!(pixel, K.width + 2);
            Some((Some(s), weight))
        }
    }
}

#[test]
fn a_reading_says_that_space_is_free_or_how_near_its_surface_is() {
    let surface = Reading::of_surface(1.0, 0.5);
    // Ahead by the truncation or more; then within it; then behind.
    assert_eq!(said_at(surface, 0.5, 0.25), Some((None, 0.5)));
    assert_eq!(said_at(surface, 0.75, 0.25), Some((None, 0.5)));
    for (z_m, s) in [(0.875, 0.5), (1.0, 0.0), (1.125, -0.5)] {
        let (found, weight) = said_at(surface, z_m, 0.25).unwrap();
        assert!((found.unwrap() - s).abs() < 1e-5 && weight == 0.5, "{z_m}");
    }
    assert_eq!(said_at(surface, 1.25, 0.25), None);
    assert_eq!(said_at(surface, 1.5, 0.25), None);
    // Of something else only what is free.
    let other = Reading::of_free_space(1.0, 0.5);
    assert_eq!(said_at(other, 0.5, 0.25), Some((None, 0.5)));
    assert_eq!(said_at(other, 0.875, 0.25), None);
    assert_eq!(said_at(Reading::NOTHING, 0.125, 0.25), None);
}

#[test]
fn weights_fall_behind_a_surface() {
    // min(1, k (1 + d)).
    for (d, once, twice) in [(0.5, 1.0, 1.0), (0.0, 1.0, 1.0), (-0.25, 0.75, 1.0), (-0.75, 0.25, 0.5)] {
        assert_eq!((behind_weight(d, 1.0), behind_weight(d, 2.0)), (once, twice));
    }
}

#[test]
fn pixels_off_the_mask_without_depth_are_empty_rays_only_where_masks_were_recorded() {
    let mut frame = frame();
    frame.depth_m[9] = 0.0;
    frame.mask = Some((0..frame.depth_m.len()).map(|pixel| pixel != 9).collect());
    let at = |unread| {
        let view = TsdfView::of_object(&frame, unread, &NoiseConfig::default());
        (view.readings[9].depth_m, view.readings[9].weight())
    };
    assert_eq!(at(Unread::Empty), (f32::INFINITY, 1.0));
    assert_eq!(at(Unread::Unknown).1, 0.0);
}
