//! Surfaces: meshes, marching cubes, TSDF fusion, distance fields, visibility, rendering, shell inertia.
//!
//! ```
//! use capture::analytic::sphere;
//! use geometry::Grid3;
//! use nalgebra::Point3;
//! use surface::marching_cubes;
//!
//! // A ball of 20 cm by its distance at the nodes of a grid.
//! let values = vec![0.0; 31 * 31 * 31];
//! let mut grid = Grid3 { origin: Point3::new(-0.15, -0.15, -0.15), spacing_m: 0.01, dims: [31; 3], values };
//! let distance = sphere(0.1);
//! for node in 0..grid.values.len() {
//!     grid.values[node] = distance(&grid.position_of_index(node)) as f32;
//! }
//! let area_m2 = marching_cubes(&grid, 0.0).area_m2();
//! assert!((area_m2 / (4.0 * std::f64::consts::PI * 0.01) - 1.0).abs() < 0.02);
//! ```

mod atlas;
mod bake;
mod blocks;
mod borders;
mod closest;
mod color_field;
mod components;
mod config;
mod convex;
mod cube_table;
mod depth_tiles;
mod difference;
mod distance;
mod edges;
mod edt;
mod inertia;
mod light;
mod lighting;
mod live;
mod marching_cubes;
mod mesh;
mod normals;
mod outline;
mod patches;
mod pseudonormal;
mod raster;
mod row_sweep;
mod rows;
mod sample;
#[cfg(test)]
pub mod shapes;
mod simplify;
mod texture;
mod triangle;
mod tsdf;
mod tsdf_view;
mod visibility;
mod weld;

pub use atlas::{Atlas, atlas_of_mesh};
pub use bake::{BakeView, baked_texture, samples_of_spots};
pub use borders::{DepthView, Mended, Readings, mend_borders};
pub use closest::MeshDistance;
pub use color_field::{ColorField, ColorSample};
pub use components::{connected_components, keep_components};
pub use config::{SurfaceConfig, SurfaceSource};
pub use convex::{
    ConvexConfig, ConvexSolid, Hidden, MIN_THICKNESS_M, Plane, SolidFit, Walls, convex_hull, few_triangles,
};
pub use difference::{Difference, differences};
pub use distance::{DistanceError, DistanceOptions, signed_distance};
pub use inertia::ShellInertia;
pub use light::Light;
pub use lighting::{Lighting, Shown};
pub use live::{LiveMap, LiveSettings, MeshChunk, Moved, NextView, Unseen, UnseenPatch};
pub use marching_cubes::marching_cubes;
pub use mesh::TriangleMesh;
pub use normals::vertex_normals;
pub use outline::hull_2d;
pub use raster::{Paint, RenderItem, Rendered, render};
pub use sample::sample_surface;
pub use simplify::simplify;
pub use texture::Texture;
pub use tsdf::TsdfVolume;
pub use tsdf_view::{PixelRole, TsdfView};
pub use visibility::{FreeSpaceRule, at_least, views_through, visibility_grid};
pub use weld::edge_defects;
pub use weld::is_watertight;
pub use weld::{drop_unused_vertices, merged_mesh, welded_mesh};
