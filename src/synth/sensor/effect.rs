//! The effects of a sensor, each a switch.

use std::str::FromStr;

/// A difference between a recording made by hand and a clean one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Effect {
    /// Depth off by a factor.
    DepthScale,
    /// Depth off by a smooth field fixed to the pixels.
    DepthWarp,
    /// Noise of disparity, common to neighboring pixels.
    DepthNoise,
    /// Readings between the surfaces on both sides of an edge.
    FlyingPixels,
    /// No depth on dark, glossy and grazing surfaces.
    DepthLoss,
    /// Color shifted against depth.
    ColorShift,
    /// Poses behind the images.
    PoseLag,
    /// Poses with the drift of odometry.
    PoseDrift,
    /// An error of every pose by itself.
    PoseJitter,
    /// The world of each state off state 0's.
    Relocalization,
    /// Exposure and white balance by view.
    Exposure,
    /// Corners darker than the middle.
    Vignetting,
    /// Another light in each state.
    Light,
    /// Mirror images of bulbs in the object.
    Highlights,
    /// Colors smeared by the motion of the camera.
    MotionBlur,
    /// Things around the object.
    Clutter,
    /// A hand before the object in some views.
    Hand,
}

impl Effect {
    /// All of them.
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
    #[must_use]
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

/// A text without an effect's name.
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
