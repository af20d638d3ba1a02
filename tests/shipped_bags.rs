//! The recordings in `bags/` against their truth.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

#[path = "common/opened.rs"]
mod opened;

use std::path::PathBuf;

use capture::{Capture, CaptureConfig};
use io::inspect;
use nalgebra::Point3;
use opened::open;

fn bag(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("bags").join(name)
}

/// Points of `seen.npy`: float32, N x 4.
fn seen(name: &str, state: usize) -> Vec<Point3<f64>> {
    let bytes = std::fs::read(bag(name).join(format!("truth/state{state}/seen.npy"))).unwrap();
    let header = usize::from(u16::from_le_bytes([bytes[8], bytes[9]])) + 10;
    let number = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    bytes[header..]
        .chunks_exact(16)
        .map(|row| Point3::new(number(row), number(&row[4..]), number(&row[8..])))
        .collect()
}

fn object_points(capture: &Capture, state: usize) -> Vec<Point3<f64>> {
    let of_frame = |f: &capture::RgbdFrame| {
        (0..f.depth_m.len()).filter(|p| f.is_object(*p)).filter_map(|p| f.world_point(p)).collect::<Vec<_>>()
    };
    capture.states[state].iter().flat_map(of_frame).collect()
}

/// Median and 95 % quantile of the distance from true surface points to the nearest reading, meters.
fn completeness(capture: &Capture, name: &str, state: usize) -> (f64, f64) {
    let points = object_points(capture, state);
    let truth = seen(name, state);
    let nearest =
        |t: &Point3<f64>| points.iter().map(|p| (p - t).norm_squared()).fold(f64::INFINITY, f64::min).sqrt();
    let mut distances: Vec<f64> = truth.iter().step_by(truth.len() / 200).map(nearest).collect();
    distances.sort_by(f64::total_cmp);
    (distances[distances.len() / 2], distances[distances.len() * 95 / 100])
}

#[test]
fn readings_lie_on_the_true_surface() {
    for (name, views) in [("drawer", 16), ("drawer_raw", 12), ("laptop", 16)] {
        let capture = open(&[bag(name)], &CaptureConfig::default(), 0).unwrap();
        assert_eq!((capture.name.as_str(), &capture.warnings), (name, &Vec::new()));
        for state in 0..2 {
            assert_eq!(capture.states[state].len(), views);
            let (median, most) = completeness(&capture, name, state);
            assert!(median < 0.003 && most < 0.012, "{name} {state}: {median} {most}");
        }
    }
}

#[test]
fn isolation_without_masks_finds_the_masked_object() {
    for name in ["drawer", "laptop"] {
        let masked = open(&[bag(name)], &CaptureConfig::default(), 0).unwrap();
        let mut config = CaptureConfig::default();
        config.isolate.use_masks = false;
        let found = open(&[bag(name)], &config, 0).unwrap();
        let (mut right, mut wrong, mut missed) = (0, 0, 0);
        for (a, b) in masked.states.iter().flatten().zip(found.states.iter().flatten()) {
            for p in (0..a.depth_m.len()).filter(|p| a.depth_m[*p] > 0.0) {
                // Pixels of the mask without depth were too close to the floor to tell.
                let claimed = b.is_object(p) && b.depth_m[p] > 0.0;
                match (a.is_object(p), claimed) {
                    (true, true) => right += 1,
                    (false, true) => wrong += 1,
                    (true, false) => missed += 1,
                    (false, false) => {}
                }
            }
        }
        println!("{name}: right {right}, wrong {wrong}, missed {missed}");
        assert!(wrong * 200 < right, "{name}: {wrong} wrong, {right} right");
        assert!(missed * 12 < right, "{name}: {missed} missed, {right} right");
    }
}

#[test]
fn inspection_calls_them_usable() {
    for name in ["drawer", "drawer_raw", "laptop"] {
        let text = inspect(&bag(name)).unwrap().to_text();
        assert!(
            text.contains("usable: yes")
                && text.contains("aligned_depth_to_color")
                && text.contains("(static)"),
            "{text}"
        );
    }
}
