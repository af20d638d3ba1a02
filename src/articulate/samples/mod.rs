//! Surface samples: points of a surface, found by position, joined to their neighbors.

pub mod flat_patch;
pub mod hinge;
pub mod mesh_samples;
pub mod place_costs;
pub mod sample_index;
pub mod slip;
pub mod spacing;
pub mod surface_graph;
#[cfg(test)]
pub mod synthetic;
