//! The effects of a handheld sensor, which can be switched individually.

use std::str::FromStr;

/// A difference between a handheld recording and one without errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Effect {
    /// Scale error of depth.
    DepthScale,
    /// Smooth depth error fixed to the pixels.
    DepthWarp,
    /// Disparity noise, correlated between neighboring pixels.
    DepthNoise,
    /// Readings between the two surfaces at a depth edge.
    FlyingPixels,
    /// Missing depth on dark, glossy and grazing surfaces.
    DepthLoss,
    /// Shift of color against depth.
    ColorShift,
    /// Delay of poses against the images.
    PoseLag,
    /// Drift of odometry.
    PoseDrift,
    /// Independent error of every pose.
    PoseJitter,
    /// Displacement of each state's world from state 0's.
    Relocalization,
    /// Exposure and white balance that change between views.
    Exposure,
    /// Image corners darker than the center.
    Vignetting,
    /// Different light in each state.
    Light,
    /// Reflections of bulbs on the object.
    Highlights,
    /// Colors blurred by camera motion.
    MotionBlur,
    /// Clutter around the object.
    Clutter,
    /// A hand in front of the object in some views.
    Hand,
}

impl Effect {
    /// All effects.
    pub const ALL: [Self; 17] = [
        Self::DepthScale,
        Self::DepthWarp,
        Self::DepthNoise,
        Self::FlyingPixels,
        Self::DepthLoss,
        Self::ColorShift,
        Self::PoseLag,
        Self::PoseDrift,
        Self::PoseJitter,
        Self::Relocalization,
        Self::Exposure,
        Self::Vignetting,
        Self::Light,
        Self::Highlights,
        Self::MotionBlur,
        Self::Clutter,
        Self::Hand,
    ];

    /// Name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::DepthScale => "depth_scale",
            Self::DepthWarp => "depth_warp",
            Self::DepthNoise => "depth_noise",
            Self::FlyingPixels => "flying_pixels",
            Self::DepthLoss => "depth_loss",
            Self::ColorShift => "color_shift",
            Self::PoseLag => "pose_lag",
            Self::PoseDrift => "pose_drift",
            Self::PoseJitter => "pose_jitter",
            Self::Relocalization => "relocalization",
            Self::Exposure => "exposure",
            Self::Vignetting => "vignetting",
            Self::Light => "light",
            Self::Highlights => "highlights",
            Self::MotionBlur => "motion_blur",
            Self::Clutter => "clutter",
            Self::Hand => "hand",
        }
    }
}

/// A text that names no effect.
#[derive(Debug, thiserror::Error)]
#[error("no effect of a sensor has this name; give some of {}", Effect::ALL.map(Effect::name).join(", "))]
pub struct ParseEffectError;

impl FromStr for Effect {
    type Err = ParseEffectError;

    fn from_str(text: &str) -> Result<Self, ParseEffectError> {
        Self::ALL.into_iter().find(|e| e.name() == text.trim()).ok_or(ParseEffectError)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_and_a_wrong_one_lists_the_right_ones() {
        for effect in Effect::ALL {
            assert_eq!(effect.name().parse::<Effect>().unwrap(), effect);
        }
        let refused = "depth_warpp".parse::<Effect>().unwrap_err().to_string();
        assert!(Effect::ALL.iter().all(|e| refused.contains(e.name())), "{refused}");
    }
}
