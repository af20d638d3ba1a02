//! How far camera poses are off.

use serde::{Deserialize, Serialize};

/// Errors of a pose along and about each axis, one standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseNoise {
    /// Meters.
    pub translation_m: f64,
    /// Radians.
    pub rotation_rad: f64,
}

impl PoseNoise {
    /// Of a hand-held camera, or of one on a calibrated arm: 5 mm and 0.5 degrees in all.
    pub const EXPECTED: Self = Self { translation_m: 0.003, rotation_rad: 0.005 };

    /// The smallest of interest: a micrometer, and a microradian.
    pub(crate) const LEAST: Self = Self { translation_m: 1e-6, rotation_rad: 1e-6 };

    /// By how much a point at some depth is off, one standard deviation, meters.
    #[must_use]
    pub fn displacement_m(&self, depth_m: f64) -> f64 {
        self.translation_m.hypot(self.rotation_rad * depth_m)
    }

    /// Whether it is as large as expected errors, along or about an axis.
    pub(crate) fn reaches_expected(&self) -> bool {
        self.translation_m >= Self::EXPECTED.translation_m || self.rotation_rad >= Self::EXPECTED.rotation_rad
    }

    /// Of the mean of so many poses.
    pub(crate) fn of_mean(&self, count: usize) -> Self {
        self.scaled_by(1.0 / (count.max(1) as f64).sqrt())
    }

    /// So many times as large.
    pub(crate) fn scaled_by(&self, factor: f64) -> Self {
        Self { translation_m: factor * self.translation_m, rotation_rad: factor * self.rotation_rad }
    }

    /// No larger than another.
    pub(crate) fn at_most(&self, most: &Self) -> Self {
        Self {
            translation_m: self.translation_m.min(most.translation_m),
            rotation_rad: self.rotation_rad.min(most.rotation_rad),
        }
    }

    /// No smaller than [`Self::LEAST`].
    pub(crate) fn at_least(&self) -> Self {
        Self {
            translation_m: self.translation_m.max(Self::LEAST.translation_m),
            rotation_rad: self.rotation_rad.max(Self::LEAST.rotation_rad),
        }
    }

    /// Of the difference of two.
    pub(crate) fn of_difference(&self, other: &Self) -> Self {
        Self {
            translation_m: self.translation_m.hypot(other.translation_m),
            rotation_rad: self.rotation_rad.hypot(other.rotation_rad),
        }
    }
}
