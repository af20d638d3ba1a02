//! Lengths from which all gates and priors are derived: the object's size, the range, the depth noise there.
//! See docs/method.md (15.1).

use super::twin::SeenTwin;
use crate::camera::record::frames::FrameRun;
use numeric::statistics::median;

/// Standard deviation of the placement of a joint or a part, as a share of the part's size.
///
/// tuned: made objects (tests/gap_frames.rs)
pub const MISPLACED: f64 = 0.03;
/// Standard deviation of a camera's errors, as a share of its range: in depth and in the position of its
/// mount; also that of its angles, in radians.
///
/// chosen: depth accuracy of stereo cameras by their data sheets, 2 % of the range; the mount is calibrated
/// by this depth.
pub const MISCALIBRATED: f64 = 0.02;
/// Largest residual of a reading on the surface, in standard deviations of the displacement due to effects.
///
/// chosen: a round number; 95 % of a normal distribution
pub const GATE: f64 = 2.0;
/// Least lever of a turn, as a share of the object's size, for a part without a mesh.
///
/// chosen: such a part counts as smaller than the gate, 0.06 of the object and more
const LEAST_LEVER: f64 = 0.02;

/// Scales of a twin and its recordings, meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scales {
    /// Half the diagonal of the largest part.
    pub radius_m: f64,
    /// Median distance from the cameras to the center of the root part.
    pub range_m: f64,
    /// Standard deviation of a depth reading at this range, for the noisiest recording.
    pub reading_m: f64,
    /// Least error of the twin's surface.
    pub accuracy_m: f64,
}

impl Scales {
    /// Scales of a twin in its recordings. Camera poses are in the frame of the twin's root.
    pub fn of_twin(twin: &SeenTwin, runs: &[FrameRun], accuracy_m: f64) -> Self {
        let center = twin.parts[0].center;
        let ranges_m: Vec<f64> = runs
            .iter()
            .flat_map(|r| &r.frames)
            .map(|f| (f.world_from_camera.translation.vector - center.coords).norm())
            .collect();
        let range_m = median(ranges_m).unwrap_or_default();
        let reading_m = runs.iter().map(|r| r.noise.sigma_m(range_m)).fold(0.0, f64::max);
        Self { radius_m: twin.radius_m(), range_m, reading_m, accuracy_m }
    }

    /// Residuals beyond this are conflicts: twice the standard deviation of the displacement due to effects,
    /// meters.
    pub fn gate_m(&self) -> f64 {
        GATE * (MISPLACED * self.radius_m).hypot(MISCALIBRATED * self.range_m)
    }

    /// Lever arm of a part's turn at its surface, meters.
    pub fn lever_m(&self, twin: &SeenTwin, part: usize) -> f64 {
        twin.parts[part].radius_m.max(LEAST_LEVER * self.radius_m)
    }

    /// Lever arm of a joint's child, meters.
    pub fn child_lever_m(&self, twin: &SeenTwin, joint: usize) -> f64 {
        self.lever_m(twin, twin.joints[joint].child)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jar_gets_no_gate_of_a_fridge() {
        let jar = Scales { radius_m: 0.07, range_m: 0.4, reading_m: 0.001, accuracy_m: 0.0003 };
        let fridge = Scales { radius_m: 0.9, range_m: 2.4, reading_m: 0.015, accuracy_m: 0.0003 };
        assert!((jar.gate_m() - 2.0 * 0.0021f64.hypot(0.008)).abs() < 1e-12);
        assert!(fridge.gate_m() > 6.0 * jar.gate_m());
        // An object twice as large, seen from twice as far, has twice the gate.
        let double = Scales { radius_m: 0.14, range_m: 0.8, ..jar };
        assert!((double.gate_m() - 2.0 * jar.gate_m()).abs() < 1e-12);
    }
}
