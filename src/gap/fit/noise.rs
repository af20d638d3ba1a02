//! Efforts on a joint beyond its model: noise of the recorded effort, and a lasting effort without a name.
//! See docs/method.md 14.6.

/// Standard deviations of the unexplained effort.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EffortNoise {
    /// New at every sample, N m or N.
    pub white: f64,
    /// Of the lasting part, N m or N: effects of a machine beyond any catalogue (ripple, flexibility, heat,
    /// cables) correlate neighboring residuals. A first-order Gauss-Markov process.
    pub wander: f64,
    /// Time in which the wander falls to 1/e, seconds.
    pub memory_s: f64,
    /// Of where the joint is beside where its model has it, rad or m, where whole windows are predicted
    /// ([`Weighing::Predictions`](crate::fit::problem::Weighing)); else 0.
    pub deflection: f64,
}

impl EffortNoise {
    /// White noise alone.
    #[must_use]
    pub fn white_noise(white: f64) -> Self {
        Self { white, ..Self::default() }
    }

    /// A multiple of it.
    #[must_use]
    pub fn scaled_by(self, by: f64) -> Self {
        Self { white: self.white * by, wander: self.wander * by, deflection: self.deflection * by, ..self }
    }

    /// With a white part of at least `least`.
    #[must_use]
    pub fn at_least(self, least: f64) -> Self {
        Self { white: self.white.max(least), ..self }
    }

    /// Share of another noise's size left by this one.
    #[must_use]
    pub fn share_of(&self, other: &Self) -> f64 {
        let size = |n: &Self| if other.deflection > 0.0 { n.deflection } else { n.total_deviation() };
        size(self) / size(other).max(1e-300)
    }

    /// Whether it has a part beyond the noise of a sensor: a lasting one, or a deflection.
    #[must_use]
    pub fn has_remainder(&self) -> bool {
        self.wander > 0.0 || self.deflection > 0.0
    }

    /// Standard deviation of the effort at one time.
    #[must_use]
    pub fn total_deviation(&self) -> f64 {
        self.white.hypot(self.wander)
    }

    /// Share of the wander left after `interval_s`.
    #[must_use]
    pub fn wander_share_after(&self, interval_s: f64) -> f64 {
        if self.wander > 0.0 { (-interval_s / self.memory_s).exp() } else { 0.0 }
    }
}
