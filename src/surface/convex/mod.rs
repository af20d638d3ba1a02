//! Convex solids for collision in a simulator, from a surface.

mod cover;
mod fit;
mod flats;
mod hidden;
mod hull;
mod pieces;
mod quality;
mod raster;
mod rays;
mod rectangles;
mod sample_columns;
mod settings;
mod shell;
mod solid;

pub use hull::convex_hull;
pub use quality::SolidFit;
pub use settings::{ConvexConfig, Hidden, MIN_THICKNESS_M};
pub use shell::{Walls, few_triangles};
pub use solid::{ConvexSolid, Plane};
