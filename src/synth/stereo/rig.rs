//! Geometry of a stereo rig beside a color camera: as its calibration says, and as it is.

use nalgebra::Vector3;

use geometry::{Intrinsics, Pose};
use numeric::random::{self, stage_rng};

/// Nominal distance between the imagers, meters. chosen: that of a D435
const BASELINE_M: f64 = 0.05;
/// Position of the projector along the baseline, from the left imager, meters.
/// chosen: between the imagers, as in a D435
const PROJECTOR_M: f64 = 0.029;
/// Nominal position of the left imager in the color camera's frame, meters along x.
/// chosen: as in a D435
const LEFT_IN_COLOR_M: f64 = 0.015;
/// Error of the baseline at level 1, share. chosen: after a few warm and cold cycles
const BASELINE_ERROR: f64 = 0.003;
/// Rotation of the right imager from rectified at level 1, radians: 0.02 degrees. chosen: 0.2 pixels
const RECTIFICATION_RAD: f64 = 0.02 * std::f64::consts::PI / 180.0;
/// Error of the color camera's pose at level 1: radians (0.08 degrees) and meters.
/// chosen: about a pixel at 1 m
const COLOR_TURN_RAD: f64 = 0.08 * std::f64::consts::PI / 180.0;
const COLOR_SHIFT_M: f64 = 0.0004;
/// Columns of the infrared images beyond the color image's on the left, share of its width: close surfaces
/// there need columns of the right image. chosen: covers disparities at arm's length
const LEFT_MARGIN: f64 = 0.125;
/// Columns and rows beyond the color image on the other sides, share of its width. chosen: covers the errors
/// of the color camera's pose
const MARGIN: f64 = 0.0125;

/// A stereo rig. Images of both imagers are taken as rectified, with equal intrinsics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StereoRig {
    /// Intrinsics of both imagers.
    pub intrinsics: Intrinsics,
    /// Distance between the imagers in the calibration, meters.
    pub baseline_m: f64,
    /// Pose of the left imager in the color camera's frame, in the calibration.
    pub color_from_left: Pose,
    /// The true pose of the right imager in the left one's frame.
    pub true_left_from_right: Pose,
    /// The true pose of the left imager in the color camera's frame.
    pub true_color_from_left: Pose,
    /// Pose of the projector in the left imager's frame.
    pub left_from_projector: Pose,
}

impl StereoRig {
    /// The rig of a seed beside a color camera; `level` is a factor on the errors of its geometry.
    pub fn drawn(level: f64, color: &Intrinsics, seed: u64) -> Self {
        let rng = &mut stage_rng(seed, "synth/stereo/rig", 0);
        let sign = if random::is_chosen(rng, 0.5) { 1.0 } else { -1.0 };
        let true_baseline_m = BASELINE_M * (1.0 + sign * level * BASELINE_ERROR);
        let off_rectified = random::random_direction(rng).into_inner() * (level * RECTIFICATION_RAD);
        let shift = random::random_direction(rng).into_inner() * (level * COLOR_SHIFT_M);
        let turn = random::random_direction(rng).into_inner() * (level * COLOR_TURN_RAD);
        let color_from_left = Pose::translation(LEFT_IN_COLOR_M, 0.0, 0.0);
        Self {
            intrinsics: intrinsics_beside(color),
            baseline_m: BASELINE_M,
            color_from_left,
            true_left_from_right: Pose::new(Vector3::x() * true_baseline_m, off_rectified),
            true_color_from_left: color_from_left * Pose::new(shift, turn),
            left_from_projector: Pose::translation(PROJECTOR_M, 0.0, 0.0),
        }
    }

    /// Depth of a disparity by the calibration, meters.
    pub fn depth_of_disparity(&self, disparity_px: f64) -> f64 {
        self.intrinsics.fx * self.baseline_m / disparity_px
    }
}

/// The imagers' intrinsics: pixels as those of the color camera, more of them.
fn intrinsics_beside(color: &Intrinsics) -> Intrinsics {
    let left = (LEFT_MARGIN * color.width as f64).round();
    let beside = (MARGIN * color.width as f64).round();
    Intrinsics {
        width: color.width + (left + beside) as usize,
        height: color.height + 2 * beside as usize,
        cx: color.cx + left,
        cy: color.cy + beside,
        ..*color
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn color() -> Intrinsics {
        Intrinsics { width: 640, height: 480, fx: 577.0, fy: 577.0, cx: 322.0, cy: 237.0 }
    }

    #[test]
    fn errors_have_the_stated_sizes_and_directions_of_the_seed() {
        for level in [0.0, 1.0, 2.0] {
            let rig = StereoRig::drawn(level, &color(), 5);
            let right = rig.true_left_from_right;
            let stretched = (right.translation.vector.norm() / 0.05 - 1.0).abs();
            assert!((stretched - 0.003 * level).abs() < 1e-9);
            assert!((right.rotation.angle().to_degrees() - 0.02 * level).abs() < 1e-9);
            let off = rig.color_from_left.inverse() * rig.true_color_from_left;
            assert!((off.rotation.angle().to_degrees() - 0.08 * level).abs() < 1e-9);
            assert!((off.translation.vector.norm() - 0.0004 * level).abs() < 1e-12);
        }
        let [one, two] = [1.0, 2.0].map(|level| StereoRig::drawn(level, &color(), 5).true_left_from_right);
        assert!((2.0 * one.rotation.scaled_axis() - two.rotation.scaled_axis()).norm() < 1e-12);
        assert_ne!(StereoRig::drawn(1.0, &color(), 5), StereoRig::drawn(1.0, &color(), 6));
    }
}
