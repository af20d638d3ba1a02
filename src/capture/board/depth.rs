//! Ratio of a board's measured depth to its distance by its tags.

use nalgebra::{Point3, Vector3};

use super::layout::BoardLayout;
use crate::RgbdFrame;
use geometry::Pose;
use numeric::statistics::median;

/// Step between sampled columns and rows: neighboring readings have common errors.
const STRIDE: usize = 2;
/// Fewest depth readings of a view.
const LEAST_READINGS: usize = 60;
/// Cosine between ray and normal below which a stereo camera errs.
/// chosen: 75 deg; beyond it few stereo cameras read well
const GRAZING: f64 = 0.26;

/// Median ratio of the depth readings on a board to its distance in a view; `None` where few readings fall on
/// it.
pub(super) fn depth_ratio(frame: &RgbdFrame, layout: &BoardLayout, board_from_camera: &Pose) -> Option<f64> {
    let k = &frame.intrinsics;
    let normal = board_from_camera.inverse_transform_vector(&Vector3::z());
    let eye = board_from_camera.translation.vector;
    let [half_x, half_y] = layout.half_grid_m();
    let mut ratios = Vec::new();
    for y in (0..k.height).step_by(STRIDE) {
        for x in (0..k.width).step_by(STRIDE) {
            let depth_m = f64::from(frame.depth_m[y * k.width + x]);
            let ray = k.ray_at(x as f64, y as f64);
            let down = normal.dot(&ray);
            if depth_m <= 0.0 || down > -GRAZING * ray.norm() {
                continue;
            }
            // The camera stands at the height eye.z above the board.
            let board_m = -eye.z / down;
            let at = board_from_camera * Point3::from(ray * board_m);
            if at.x.abs() < half_x && at.y.abs() < half_y {
                ratios.push(depth_m / board_m);
            }
        }
    }
    if ratios.len() < LEAST_READINGS { None } else { median(ratios) }
}
