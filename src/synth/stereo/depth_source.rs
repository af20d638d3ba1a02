//! Where the depth of a recording comes from.

use std::str::FromStr;

/// How depth images are made.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum DepthSource {
    /// True depth with the errors of [`crate::DepthCamera`] and of the sensor.
    #[default]
    Modeled,
    /// Two infrared images, matched.
    Stereo {
        /// Factor on noise and on the errors of the rig's geometry.
        level: f64,
    },
}

impl DepthSource {
    /// Largest level. chosen: twice the errors of a usual camera
    pub const MAX_LEVEL: f64 = 2.0;

    /// Level of a stereo camera; `None` for modeled depth.
    pub fn stereo_level(self) -> Option<f64> {
        match self {
            Self::Modeled => None,
            Self::Stereo { level } => Some(level),
        }
    }
}

/// A text that is no [`DepthSource`].
#[derive(Debug, thiserror::Error)]
#[error("give model, stereo or stereo:LEVEL with a level from 0 to {}", DepthSource::MAX_LEVEL)]
pub struct ParseDepthError;

impl FromStr for DepthSource {
    type Err = ParseDepthError;

    /// Parses `model`, `stereo` or `stereo:LEVEL`.
    fn from_str(text: &str) -> Result<Self, ParseDepthError> {
        if text == "model" {
            return Ok(Self::Modeled);
        }
        let rest = text.strip_prefix("stereo").ok_or(ParseDepthError)?;
        let level =
            if rest.is_empty() { Ok(1.0) } else { rest.strip_prefix(':').unwrap_or_default().parse() };
        let level = level.ok().filter(|l| (0.0..=Self::MAX_LEVEL).contains(l)).ok_or(ParseDepthError)?;
        Ok(Self::Stereo { level })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_are_read() {
        let level = |text: &str| text.parse::<DepthSource>().map(DepthSource::stereo_level);
        assert_eq!(level("model").unwrap(), None);
        assert_eq!(level("stereo").unwrap(), Some(1.0));
        assert_eq!(level("stereo:0").unwrap(), Some(0.0));
        for wrong in ["", "stereo:", "stereo:3", "stereo:nan", "stereo1", "tof:1", "stereo:1:2"] {
            assert!(level(wrong).is_err(), "{wrong}");
        }
    }
}
