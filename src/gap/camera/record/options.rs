//! Assumptions of a diagnosis by frames.

/// Assumptions of a diagnosis by frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameOptions {
    /// Least error of the twin's surface and joints, meters; larger errors are found with the effects.
    pub accuracy_m: f64,
    /// A frame of every so many is left to the proof.
    pub held_out_every: usize,
}

impl Default for FrameOptions {
    fn default() -> Self {
        Self { accuracy_m: 0.0003, held_out_every: 3 }
    }
}
