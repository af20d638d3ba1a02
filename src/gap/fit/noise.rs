//! Efforts on a joint beyond its model: noise of the recorded effort, and an unnamed lasting effort. See
//! docs/method.md 14.6.

/// Standard deviations of the unexplained effort.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EffortNoise {
    /// White part: independent at every sample, N m or N.
    pub white: f64,
    /// Lasting part ("wander"), N m or N: effects beyond the catalogue (ripple, flexibility, heat, cables)
    /// correlate neighboring residuals. Modelled as a first-order Gauss-Markov process.
    pub wander: f64,
    /// Correlation time of the wander, seconds: it decays to 1/e.
    pub memory_s: f64,
    /// Deviation of the joint from its modelled position, rad or m, if whole windows are predicted
    /// ([`Weighing::Predictions`](crate::fit::problem::Weighing)); else 0.
    pub deflection: f64,
}

impl EffortNoise {
    /// White noise alone.
    pub fn white_noise(white: f64) -> Self {
        Self { white, ..Self::default() }
    }

    /// The noise multiplied by a factor.
    #[must_use]
    pub fn scaled_by(self, by: f64) -> Self {
        Self { white: self.white * by, wander: self.wander * by, deflection: self.deflection * by, ..self }
    }

    /// The noise with a white part of at least `least`.
    #[must_use]
    pub fn at_least(self, least: f64) -> Self {
        Self { white: self.white.max(least), ..self }
    }

    /// Size of this noise as a share of another one's.
    pub fn share_of(&self, other: &Self) -> f64 {
        let size = |n: &Self| if other.deflection > 0.0 { n.deflection } else { n.total_deviation() };
        size(self) / size(other).max(1e-300)
    }

    /// Whether it exceeds the noise of a sensor: by a lasting part or a deflection.
    pub fn has_remainder(&self) -> bool {
        self.wander > 0.0 || self.deflection > 0.0
    }

    /// Standard deviation of the effort at one time, N m or N.
    pub fn total_deviation(&self) -> f64 {
        self.white.hypot(self.wander)
    }

    /// Correlation of the wander over `interval_s` seconds.
    pub fn wander_share_after(&self, interval_s: f64) -> f64 {
        if self.wander > 0.0 { (-interval_s / self.memory_s).exp() } else { 0.0 }
    }
}
