//! Settings of the generator.

use std::str::FromStr;

use super::{DepthSource, HandheldSensor, HandleStyle, PoseSource};
use capture::Paper;

/// Family of object shapes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// Doors, flaps, drawers and sliding panels in a carcass; low ones may have a lid.
    Cabinet,
    /// Lamp arm: a chain of links.
    Lamp,
    /// Folding door: a chain of panels.
    FoldingDoor,
    /// Box with screw caps.
    CappedBox,
    /// Two shells with a hinge, like a laptop.
    Clamshell,
}

impl Family {
    /// All families.
    pub const ALL: [Self; 5] =
        [Self::Cabinet, Self::Lamp, Self::FoldingDoor, Self::CappedBox, Self::Clamshell];

    /// Name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cabinet => "cabinet",
            Self::Lamp => "lamp",
            Self::FoldingDoor => "folding_door",
            Self::CappedBox => "capped_box",
            Self::Clamshell => "clamshell",
        }
    }

    /// Least and largest number of rigid parts, the static one included.
    pub fn part_limits(self) -> [usize; 2] {
        match self {
            Self::Cabinet => [2, 7],
            Self::Lamp => [2, 4],
            Self::FoldingDoor => [2, 4],
            Self::CappedBox => [2, 3],
            Self::Clamshell => [2, 2],
        }
    }

    /// The family with a name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|f| f.name() == name)
    }
}

/// Size of random rigid motions.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseSpread {
    /// Translation, meters.
    pub translation_m: f64,
    /// Rotation, radians.
    pub rotation_rad: f64,
}

/// A text that is no [`PoseSpread`].
#[derive(Debug, thiserror::Error)]
#[error("give millimeters and degrees as MM,DEG, e.g. 5,0.5; neither negative")]
pub struct ParseSpreadError;

impl FromStr for PoseSpread {
    type Err = ParseSpreadError;

    /// Reads `MM,DEG`.
    fn from_str(text: &str) -> Result<Self, ParseSpreadError> {
        let numbers: Vec<f64> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
        match numbers[..] {
            [mm, deg]
                if text.split(',').count() == 2
                    && (0.0..1e6).contains(&mm)
                    && (0.0..=180.0).contains(&deg) =>
            {
                Ok(Self { translation_m: mm / 1000.0, rotation_rad: deg.to_radians() })
            }
            _ => Err(ParseSpreadError),
        }
    }
}

/// Settings for an object and its recording.
#[derive(Clone, Debug, PartialEq)]
pub struct SynthConfig {
    /// Seed of all random choices.
    pub seed: u64,
    /// Number of rigid parts, the static one included; `None` draws 2 to 6.
    pub parts: Option<usize>,
    /// Family; `None` draws one that can have this number of parts.
    pub family: Option<Family>,
    /// Handles of doors, flaps and drawers of cabinets; `None` keeps the family's plain ones.
    pub handles: Option<HandleStyle>,
    /// Whether the object is textured; `None` draws it, with textures in three of four.
    pub textured: Option<bool>,
    /// Factor on the noise of depth and color; 0 is a perfect sensor.
    pub noise: f64,
    /// Error of state 1's world frame against state 0's, in a random direction and about a random axis.
    pub drift: PoseSpread,
    /// Factor of at most 1 on the joint motions between the states; the object is the same.
    pub motion_scale: f64,
    /// Tilt of every joint axis from its nominal direction, in a random direction, degrees; parts may then
    /// touch slightly.
    pub skew_deg: f64,
    /// Share of the surface under patches of dark lacquer, which have color but no depth.
    pub lacquer: f64,
    /// Number of recorded states beyond the first two, with other joint positions.
    pub further: usize,
    /// Views per state, if `rate_hz` gives none.
    pub views: usize,
    /// Views per second of a handheld camera; their number follows from the length of its path.
    pub rate_hz: Option<f64>,
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// Effects of a handheld camera; `None` records without errors and with masks.
    pub sensor: Option<HandheldSensor>,
    /// Where depth comes from; matched images have no masks.
    pub depth: DepthSource,
    /// Whether the object stands in a room.
    pub room: bool,
    /// Who reports the camera's poses.
    pub poses: PoseSource,
    /// Paper of a printed tag board on the floor in front of the object; `None` for no board.
    pub board: Option<Paper>,
    /// Whether the camera's accelerometer is recorded.
    pub imu: bool,
}

impl Default for SynthConfig {
    fn default() -> Self {
        Self {
            seed: 0,
            parts: None,
            family: None,
            handles: None,
            textured: None,
            noise: 1.0,
            drift: PoseSpread::default(),
            motion_scale: 1.0,
            skew_deg: 0.0,
            lacquer: 0.0,
            further: 0,
            views: 30,
            rate_hz: None,
            width: 640,
            height: 480,
            sensor: None,
            depth: DepthSource::default(),
            room: false,
            poses: PoseSource::default(),
            board: None,
            imu: false,
        }
    }
}

/// A setting out of its range; the message gives the remedy.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SynthConfigError {
    /// The family cannot have this number of parts.
    #[error("{what} has {fewest} to {most} parts, the static one included, not {parts}")]
    Parts {
        /// Name of the family.
        what: &'static str,
        /// Least number of parts.
        fewest: usize,
        /// Largest number of parts.
        most: usize,
        /// Requested number of parts.
        parts: usize,
    },
    /// Number of views per state.
    #[error("{0} views: give 2 to 1000")]
    Views(usize),
    /// Views per second.
    #[error("rate {0}: give 1 to 60 views a second")]
    Rate(f64),
    /// Number of states.
    #[error("{0} states: give 2 to 100")]
    States(usize),
    /// Size of the images.
    #[error("images of {width}x{height}: give 64 to 4096 pixels a side")]
    Images {
        /// Width, pixels.
        width: usize,
        /// Height, pixels.
        height: usize,
    },
    /// Noise factor.
    #[error("noise {0}: give a factor from 0 to 20")]
    Noise(f64),
    /// Factor on the joint motions.
    #[error("motion scale {0}: give a factor from 0.01 to 1")]
    MotionScale(f64),
    /// Level of the sensor effects.
    #[error("sensor level {0}: give 0 to {max}", max = HandheldSensor::MAX_LEVEL)]
    SensorLevel(f64),
    /// Level of a stereo camera's errors.
    #[error("stereo level {0}: give 0 to {max}", max = DepthSource::MAX_LEVEL)]
    StereoLevel(f64),
    /// A sensor and a source of poses that both have errors.
    #[error("a sensor and poses of {0} each have errors of poses: give one of the two")]
    TwoPoseErrors(&'static str),
    /// A board in a room.
    #[error("a board lies on a free floor: leave out the room")]
    BoardInRoom,
    /// Share of lacquered surface.
    #[error("lacquer {0}: give a share from 0 to 0.9")]
    Lacquer(f64),
    /// Tilt of the joint axes, degrees.
    #[error("skew {0}: give 0 to 10 degrees")]
    Skew(f64),
}

impl SynthConfig {
    /// Largest number of parts in any family.
    pub const MAX_PARTS: usize = 7;

    /// Whether recordings have masks of the object.
    pub fn has_masks(&self) -> bool {
        self.sensor.is_none() && self.depth == DepthSource::Modeled
    }

    /// Checks that the settings allow an object.
    ///
    /// # Errors
    /// A number out of its range, or a family that cannot have this number of parts.
    pub fn check(&self) -> Result<(), SynthConfigError> {
        if let Some(parts) = self.parts {
            let [fewest, most] = self.family.map_or([2, Self::MAX_PARTS], Family::part_limits);
            if !(fewest..=most).contains(&parts) {
                let what = self.family.map_or("an object", Family::name);
                return Err(SynthConfigError::Parts { what, fewest, most, parts });
            }
        }
        if !(2..=1000).contains(&self.views) {
            return Err(SynthConfigError::Views(self.views));
        }
        if let Some(rate_hz) = self.rate_hz.filter(|r| !(1.0..=60.0).contains(r)) {
            return Err(SynthConfigError::Rate(rate_hz));
        }
        if self.further > 98 {
            return Err(SynthConfigError::States(self.further + 2));
        }
        if ![self.width, self.height].iter().all(|s| (64..=4096).contains(s)) {
            return Err(SynthConfigError::Images { width: self.width, height: self.height });
        }
        if !(0.0..=20.0).contains(&self.noise) {
            return Err(SynthConfigError::Noise(self.noise));
        }
        if !(0.01..=1.0).contains(&self.motion_scale) {
            return Err(SynthConfigError::MotionScale(self.motion_scale));
        }
        if !(0.0..=10.0).contains(&self.skew_deg) {
            return Err(SynthConfigError::Skew(self.skew_deg));
        }
        if !(0.0..=0.9).contains(&self.lacquer) {
            return Err(SynthConfigError::Lacquer(self.lacquer));
        }
        let level = self.sensor.map_or(0.0, |s| s.level());
        if !(0.0..=HandheldSensor::MAX_LEVEL).contains(&level) {
            return Err(SynthConfigError::SensorLevel(level));
        }
        let level = self.depth.stereo_level().unwrap_or(0.0);
        if !(0.0..=DepthSource::MAX_LEVEL).contains(&level) {
            return Err(SynthConfigError::StereoLevel(level));
        }
        if self.sensor.is_some() && matches!(self.poses, PoseSource::Robot | PoseSource::Slam) {
            return Err(SynthConfigError::TwoPoseErrors(self.poses.name()));
        }
        if self.room && self.board.is_some() {
            return Err(SynthConfigError::BoardInRoom);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_are_read() {
        let spread: PoseSpread = "5, 0.5".parse().unwrap();
        assert!(
            (spread.translation_m - 0.005).abs() < 1e-12
                && (spread.rotation_rad - 0.5f64.to_radians()).abs() < 1e-12
        );
        for wrong in ["5", "5,", "5,x,1", "-1,0", "1,200", "nan,0", "1,2,3"] {
            assert!(wrong.parse::<PoseSpread>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let check = |change: fn(&mut SynthConfig)| {
            let mut config = SynthConfig::default();
            change(&mut config);
            config.check()
        };
        assert_eq!(check(|_| {}), Ok(()));
        assert!(check(|c| c.parts = Some(1)).is_err() && check(|c| c.parts = Some(8)).is_err());
        assert!(
            check(|c| (c.parts, c.family) = (Some(3), Some(Family::Clamshell)))
                .unwrap_err()
                .to_string()
                .contains("clamshell has 2 to 2")
        );
        assert!(check(|c| c.motion_scale = 1.5).is_err());
        assert!(check(|c| c.skew_deg = -1.0).is_err() && check(|c| c.lacquer = 1.0).is_err());
        assert!(check(|c| c.sensor = Some(HandheldSensor::new(f64::NAN))).is_err());
        assert!(
            check(|c| c.noise = f64::NAN).is_err()
                && check(|c| c.views = 1).is_err()
                && check(|c| c.rate_hz = Some(f64::NAN)).is_err()
                && check(|c| c.width = 10).is_err()
        );
    }
}
