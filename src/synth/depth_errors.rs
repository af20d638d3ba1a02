//! Errors of depth readings beyond the noise of the depth camera itself.

/// Depth errors of each pixel of a frame; an empty list means none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DepthErrors {
    /// Factor on the depth.
    pub factor: Vec<f64>,
    /// Error added to the disparity, pixels.
    pub disparity_px: Vec<f64>,
    /// Pixels without a reading.
    pub lost: Vec<bool>,
    /// Depth of a reading between two surfaces, instead of either, meters.
    pub between_m: Vec<Option<f64>>,
}

impl DepthErrors {
    pub(super) fn factor(&self, i: usize) -> f64 {
        self.factor.get(i).copied().unwrap_or(1.0)
    }

    pub(super) fn disparity_px(&self, i: usize) -> f64 {
        self.disparity_px.get(i).copied().unwrap_or(0.0)
    }

    pub(super) fn is_lost(&self, i: usize) -> bool {
        self.lost.get(i).copied().unwrap_or(false)
    }

    pub(super) fn between_m(&self, i: usize) -> Option<f64> {
        self.between_m.get(i).copied().flatten()
    }
}
