//! Assumptions of a diagnosis from frames.

/// Assumptions of a diagnosis from frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameOptions {
    /// Least error of the twin's surface and joints, meters; a larger error is estimated with the effects.
    pub accuracy_m: f64,
    /// One frame in this many is held out for the proof.
    pub held_out_every: usize,
}

impl Default for FrameOptions {
    fn default() -> Self {
        Self { accuracy_m: 0.0003, held_out_every: 3 }
    }
}
