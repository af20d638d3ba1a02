//! Errors of the twin itself, from its reconstruction.

/// Own errors of a twin; all zero for an exact one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OwnErrors {
    /// Root mean square distance between its surfaces reconstructed in different states, meters.
    pub surface_m: f64,
    /// Errors of its joints, in their order; empty if they are exact.
    pub joints: Vec<JointError>,
}

/// Standard deviations of a joint's axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointError {
    /// Of its direction, radians.
    pub axis_rad: f64,
    /// Of its position, meters.
    pub place_m: f64,
}

impl OwnErrors {
    /// Whether the twin is taken as exact.
    pub fn is_exact(&self) -> bool {
        *self == Self::default()
    }
}
