//! Boards drawn for tests.

use nalgebra::{Matrix3, Point2, Rotation3, UnitQuaternion, Vector3};

use super::layout::BoardLayout;
use crate::RgbdFrame;
use geometry::{Intrinsics, Pose};

/// A camera as many have it.
pub const INTRINSICS: Intrinsics =
    Intrinsics { width: 640, height: 480, fx: 577.0, fy: 575.0, cx: 321.7, cy: 237.3 };

/// A camera turned to a point of the board from a distance, tilted by some radians from straight above
/// towards a direction, and rolled.
pub fn looking_at(point: Point2<f64>, away_m: f64, [tilt, towards, roll]: [f64; 3]) -> Pose {
    let target = Vector3::new(point.x, point.y, 0.0);
    let (sin, cos) = towards.sin_cos();
    let out = Vector3::new(tilt.sin() * cos, tilt.sin() * sin, tilt.cos());
    let forward = -out;
    let right = forward.cross(&Vector3::y()).normalize();
    let axes =
        Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[right, forward.cross(&right), forward]));
    let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll);
    Pose::from_parts((target + out * away_m).into(), UnitQuaternion::from_rotation_matrix(&axes) * roll)
}

/// Samples along each side of a pixel.
const SAMPLES: usize = 8;

/// The view of a board on a gray floor: brightness as a camera encodes it, and depth.
pub fn drawn_board(layout: &BoardLayout, board_from_camera: &Pose) -> RgbdFrame {
    let k = INTRINSICS;
    let on_board = |u: f64, v: f64| {
        let ray = board_from_camera * k.ray_at(u, v);
        let depth_m = -board_from_camera.translation.vector.z / ray.z;
        let at = board_from_camera.translation.vector + ray * depth_m;
        (depth_m, Point2::new(at.x, at.y))
    };
    let [low, high] = layout.sheet_corners();
    let light = |at: &Point2<f64>| {
        let on_sheet = at.x > low.x && at.x < high.x && at.y > low.y && at.y < high.y;
        match (on_sheet, layout.is_black(at)) {
            (true, true) => 0.04,
            (true, false) => 0.8,
            _ => 0.25,
        }
    };
    let offset = |s: usize| (s as f64 + 0.5) / SAMPLES as f64 - 0.5;
    let pixel = |i: usize| {
        let u = (i % k.width) as f64;
        let v = (i / k.width) as f64;
        let sum: f64 = (0..SAMPLES * SAMPLES)
            .map(|s| light(&on_board(u + offset(s % SAMPLES), v + offset(s / SAMPLES)).1))
            .sum();
        let mean = sum / (SAMPLES * SAMPLES) as f64;
        ([(255.0 * mean.powf(1.0 / 2.2)).round() as u8; 3], on_board(u, v).0 as f32)
    };
    let (rgb, depth_m) = (0..k.width * k.height).map(pixel).unzip();
    RgbdFrame {
        id: String::new(),
        stamp_nanos: 0,
        intrinsics: k,
        world_from_camera: Pose::identity(),
        rgb,
        depth_m,
        mask: None,
        readings: Vec::new(),
    }
}
