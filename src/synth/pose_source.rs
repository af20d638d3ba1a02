//! Who reports the camera's poses.

use std::str::FromStr;

use super::{Effect, HandheldSensor, PoseSpread};
use geometry::Pose;
use numeric::random::{self, stage_rng};

/// Who reports the camera's poses, with that one's errors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum PoseSource {
    /// True poses, with the errors of a configuration's sensor and drift.
    #[default]
    Exact,
    /// Those, with an error of this root mean square size, drawn independently for each frame.
    Noisy(PoseSpread),
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
    /// Name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Noisy(_) => "noisy",
            Self::Robot => "robot",
            Self::Slam => "slam",
            Self::Nobody => "none",
        }
    }

    /// The effects of a sensor that stand for its errors.
    pub(super) fn sensor(self) -> HandheldSensor {
        match self {
            Self::Exact | Self::Noisy(_) | Self::Nobody => HandheldSensor::clean(),
            Self::Robot => HandheldSensor::new(ROBOT_JITTER).only(&[Effect::PoseJitter]),
            Self::Slam => HandheldSensor::new(1.0).only(&[
                Effect::PoseDrift,
                Effect::PoseJitter,
                Effect::Relocalization,
            ]),
        }
    }

    /// Size of the errors that are drawn independently for each frame.
    pub(super) fn spread(self) -> PoseSpread {
        match self {
            Self::Noisy(spread) => spread,
            Self::Exact | Self::Robot | Self::Slam | Self::Nobody => PoseSpread::default(),
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
#[error("give exact, noisy:MM,DEG (e.g. noisy:5,0.5), robot, slam or none")]
pub struct ParsePosesError;

impl FromStr for PoseSource {
    type Err = ParsePosesError;

    fn from_str(text: &str) -> Result<Self, ParsePosesError> {
        match text {
            "exact" => Ok(Self::Exact),
            "robot" => Ok(Self::Robot),
            "slam" => Ok(Self::Slam),
            "none" => Ok(Self::Nobody),
            _ => {
                let spread = text.strip_prefix("noisy:").and_then(|s| s.parse().ok());
                spread.map(Self::Noisy).ok_or(ParsePosesError)
            }
        }
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
        let spread = PoseSpread { translation_m: 0.005, rotation_rad: 0.5f64.to_radians() };
        assert_eq!("noisy:5,0.5".parse::<PoseSource>().unwrap(), PoseSource::Noisy(spread));
        for wrong in ["noisy", "noisy:", "noisy:5", "noisy:-1,0"] {
            assert!(wrong.parse::<PoseSource>().is_err(), "{wrong}");
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
