//! Who reports the camera's poses.

use std::str::FromStr;

use super::{Effect, HandheldSensor};
use geometry::Pose;
use numeric::random::{self, stage_rng};

/// Who reports the camera's poses, with that one's errors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PoseSource {
    /// True poses, with the errors of a configuration's sensor, noise and drift.
    #[default]
    Exact,
    /// A robot that holds the camera: a constant error of the camera on its hand, and little jitter.
    Robot,
    /// A tracker that drifts and localizes anew in each state.
    Slam,
    /// Nobody: a recording has no poses.
    Nobody,
}

/// Error of the camera on a robot's hand: radians (0.3 degrees) and meters.
/// chosen: a usual hand-eye calibration
const HAND_TURN_RAD: f64 = 0.3 * std::f64::consts::PI / 180.0;
const HAND_SHIFT_M: f64 = 0.002;
/// Level of a robot's jitter: 0.1 mm and 0.005 degrees. chosen: repeatability of usual arms
const ROBOT_JITTER: f64 = 0.1;

impl PoseSource {
    /// All sources.
    pub const ALL: [Self; 4] = [Self::Exact, Self::Robot, Self::Slam, Self::Nobody];

    /// Name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Robot => "robot",
            Self::Slam => "slam",
            Self::Nobody => "none",
        }
    }

    /// The effects of a sensor that stand for its errors.
    pub(super) fn sensor(self) -> HandheldSensor {
        match self {
            Self::Exact | Self::Nobody => HandheldSensor::clean(),
            Self::Robot => HandheldSensor::new(ROBOT_JITTER).only(&[Effect::PoseJitter]),
            Self::Slam => HandheldSensor::new(1.0).only(&[
                Effect::PoseDrift,
                Effect::PoseJitter,
                Effect::Relocalization,
            ]),
        }
    }

    /// Constant error of the reported poses in the camera's frame, the same in all states.
    pub fn hand_error(self, seed: u64) -> Pose {
        if self != Self::Robot {
            return Pose::identity();
        }
        let rng = &mut stage_rng(seed, "synth/hand_error", 0);
        let shift = random::random_direction(rng).into_inner() * HAND_SHIFT_M;
        let turn = random::random_direction(rng).into_inner() * HAND_TURN_RAD;
        Pose::new(shift, turn)
    }
}

/// A text that names no [`PoseSource`].
#[derive(Debug, thiserror::Error)]
#[error("give one of {}", PoseSource::ALL.map(PoseSource::name).join(", "))]
pub struct ParsePosesError;

impl FromStr for PoseSource {
    type Err = ParsePosesError;

    fn from_str(text: &str) -> Result<Self, ParsePosesError> {
        Self::ALL.into_iter().find(|s| s.name() == text).ok_or(ParsePosesError)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_are_read_by_name() {
        for name in ["exact", "robot", "slam", "none"] {
            assert_eq!(name.parse::<PoseSource>().unwrap().name(), name);
        }
        assert!("vio".parse::<PoseSource>().unwrap_err().to_string().contains("slam"));
    }

    #[test]
    fn a_robots_error_is_constant_and_of_the_stated_size() {
        let off = PoseSource::Robot.hand_error(4);
        assert!((off.translation.vector.norm() - 0.002).abs() < 1e-12);
        assert!((off.rotation.angle().to_degrees() - 0.3).abs() < 1e-9);
        assert!(off == PoseSource::Robot.hand_error(4) && off != PoseSource::Robot.hand_error(5));
        assert_eq!(PoseSource::Slam.hand_error(4), Pose::identity());
    }
}
