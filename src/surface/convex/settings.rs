//! Settings of the collision solids.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// Least thickness of a solid, meters.
/// chosen: simulators refuse flat hulls, and thinner ones let contacts through
pub const MIN_THICKNESS_M: f64 = 0.002;

/// Settings of the collision solids.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ConvexConfig {
    /// Largest number of solids of a part.
    pub max_solids: usize,
    /// Largest tolerated distance of a solid in front of the seen surface, meters.
    pub tolerance_m: f64,
    /// Gap kept free around the path of a moving part, meters.
    pub gap_m: f64,
}

impl Default for ConvexConfig {
    fn default() -> Self {
        Self { max_solids: 64, tolerance_m: 0.002, gap_m: 0.003 }
    }
}

/// Whether no view saw a place (in the mesh's frame, meters).
pub type Hidden<'a> = &'a (dyn Fn(&Point3<f64>) -> bool + Sync);
