//! Surface samples: points of a surface, found by position, joined to their neighbors.

pub(crate) mod flat_patch;
pub(crate) mod hinge;
pub(crate) mod mesh_samples;
pub(crate) mod place_costs;
pub(crate) mod sample_index;
pub(crate) mod slip;
pub(crate) mod spacing;
pub(crate) mod surface_graph;
#[cfg(test)]
pub mod synthetic;
