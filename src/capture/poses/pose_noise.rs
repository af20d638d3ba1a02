//! Size of camera pose errors.

use serde::{Deserialize, Serialize};

/// Standard deviation of a pose error along and about each axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseNoise {
    /// Translation per axis, meters.
    pub translation_m: f64,
    /// Rotation per axis, radians.
    pub rotation_rad: f64,
}

impl PoseNoise {
    /// Error of a handheld camera or of one on a calibrated arm: 5 mm and 0.5 degrees in total.
    pub const EXPECTED: Self = Self { translation_m: 0.003, rotation_rad: 0.005 };

    /// Smallest size considered: a micrometer, and a microradian.
    pub(crate) const LEAST: Self = Self { translation_m: 1e-6, rotation_rad: 1e-6 };

    /// Standard deviation of the displacement of a point at some depth, meters.
    #[must_use]
    pub fn displacement_m(&self, depth_m: f64) -> f64 {
        self.translation_m.hypot(self.rotation_rad * depth_m)
    }

    /// Whether translation or rotation is as large as expected.
    pub(crate) fn reaches_expected(&self) -> bool {
        self.translation_m >= Self::EXPECTED.translation_m || self.rotation_rad >= Self::EXPECTED.rotation_rad
    }

    /// Error of the mean of `count` poses.
    pub(crate) fn of_mean(&self, count: usize) -> Self {
        self.scaled_by(1.0 / (count.max(1) as f64).sqrt())
    }

    /// Both parts multiplied by `factor`.
    pub(crate) fn scaled_by(&self, factor: f64) -> Self {
        Self { translation_m: factor * self.translation_m, rotation_rad: factor * self.rotation_rad }
    }

    /// Both parts limited to those of `most`.
    pub(crate) fn at_most(&self, most: &Self) -> Self {
        Self {
            translation_m: self.translation_m.min(most.translation_m),
            rotation_rad: self.rotation_rad.min(most.rotation_rad),
        }
    }

    /// Both parts at least [`Self::LEAST`].
    pub(crate) fn at_least(&self) -> Self {
        Self {
            translation_m: self.translation_m.max(Self::LEAST.translation_m),
            rotation_rad: self.rotation_rad.max(Self::LEAST.rotation_rad),
        }
    }

    /// Error of the difference of two independent poses.
    pub(crate) fn of_difference(&self, other: &Self) -> Self {
        Self {
            translation_m: self.translation_m.hypot(other.translation_m),
            rotation_rad: self.rotation_rad.hypot(other.rotation_rad),
        }
    }
}
