//! Settings of the surfaces.

use serde::{Deserialize, Serialize};

/// Settings of the surfaces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SurfaceConfig {
    /// Source of the surfaces.
    pub source: SurfaceSource,
    /// Nodes along each side of the scene cube for meshes.
    pub nodes: usize,
    /// Nodes along each side for distance fields and visibility (docs/method.md 3.4).
    pub distance_nodes: usize,
    /// Points sampled on each state's surface.
    pub points: usize,
    /// Components with a smaller share of the largest one's triangles are dropped.
    pub min_component: f64,
    /// Truncation distance in the normalized cube of half side 1 (docs/method.md 1.3), the units of published
    /// constants; null = the larger of 2 % of the object's extent and four times the median of the expected
    /// depth noise.
    pub truncation_normalized: Option<f64>,
    /// Whether shreds are removed from the borders of part surfaces and their rims straightened.
    pub mend_borders: bool,
    /// Whether mending also closes small holes and bays in flat faces, where no view saw through.
    pub close_holes: bool,
}

/// Source of the surface of a state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceSource {
    /// The fused depth images.
    #[default]
    Fusion,
    /// The zero level of the neural field, where frames observed it.
    Field,
}

impl Default for SurfaceConfig {
    fn default() -> Self {
        Self {
            source: SurfaceSource::default(),
            nodes: 224,
            distance_nodes: 201,
            points: 25_000,
            min_component: 0.02,
            truncation_normalized: None,
            mend_borders: true,
            close_holes: true,
        }
    }
}
