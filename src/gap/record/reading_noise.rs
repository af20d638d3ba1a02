//! Noise of recorded positions: of a joint at rest, and from jitter of the stamps.

/// Standard deviations of a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReadingNoise {
    /// Of a position at rest, rad or m.
    pub at_rest: f64,
    /// Of a stamp against the true time of its reading, seconds: a position error growing with speed.
    pub jitter_s: f64,
}

/// Least standard deviation of a position, rad or m. chosen: far below the step of any encoder.
const LEAST: f64 = 1e-9;

impl ReadingNoise {
    /// The same noise at every speed.
    #[must_use]
    pub fn at_rest(at_rest: f64) -> Self {
        Self { at_rest: at_rest.max(LEAST), jitter_s: 0.0 }
    }

    /// Variance of a reading at a speed, rad^2 or m^2.
    #[must_use]
    pub fn variance_at_speed(&self, speed: f64) -> f64 {
        self.at_rest * self.at_rest + (self.jitter_s * speed).powi(2)
    }
}
