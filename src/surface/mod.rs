//! Surfaces: meshes, marching cubes, TSDF fusion, distance fields, visibility, rendering, shell inertia.

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
mod edt;
mod inertia;
mod light;
mod lighting;
mod live;
mod marching_cubes;
mod mesh;
mod normals;
mod outline;
mod overlay;
mod patches;
mod pseudonormal;
mod raster;
mod rows;
mod sample;
#[cfg(test)]
pub(crate) mod shapes;
mod simplify;
mod texture;
mod triangle;
mod tsdf;
mod tsdf_view;
mod visibility;
mod weld;

pub use atlas::{Atlas, unwrap};
pub use bake::{BakeView, bake, shown};
pub use borders::{DepthView, Mended, Readings, mend_borders};
pub use closest::MeshDistance;
pub use color_field::{ColorField, ColorSample};
pub use components::keep_components;
pub use config::{SurfaceConfig, SurfaceSource};
pub use convex::{ConvexConfig, ConvexSolid, Hidden, Plane, SolidFit, Walls, convex_hull, few_triangles};
pub use difference::{Difference, differences};
pub use distance::{DistanceOptions, signed_distance};
pub use inertia::ShellInertia;
pub use light::Light;
pub use lighting::{Lighting, Shown};
pub use live::{LiveMap, LiveSettings, MeshChunk, Moved, NextView, Unseen, UnseenPatch};
pub use marching_cubes::marching_cubes;
pub use mesh::TriangleMesh;
pub use normals::vertex_normals;
pub use raster::{Paint, RenderItem, Rendered, render};
pub use sample::sample_surface;
pub use simplify::simplify;
pub use texture::Texture;
pub use tsdf::TsdfVolume;
pub use tsdf_view::{PixelRole, TsdfView, object_roles, object_views};
pub use visibility::{FreeSpaceRule, free_space_grid, visibility_grid};
#[cfg(test)]
pub use weld::edge_defects;
#[cfg(test)]
pub use weld::is_watertight;
pub use weld::{drop_unused_vertices, merge, weld};
