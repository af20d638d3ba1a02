//! Errors of a twin itself, as it was reconstructed.

/// Accuracy of a twin; all zero for an exact one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OwnErrors {
    /// Root mean square distance of its surfaces in different states, meters.
    pub surface_m: f64,
    /// Of its joints, in their order; none where they are exact.
    pub joints: Vec<JointError>,
}

/// Standard deviations of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointError {
    /// Of its axis' direction, radians.
    pub axis_rad: f64,
    /// Of its axis' place, meters.
    pub place_m: f64,
}

impl OwnErrors {
    /// Whether the twin is taken as exact.
    #[must_use]
    pub fn is_exact(&self) -> bool {
        *self == Self::default()
    }
}
