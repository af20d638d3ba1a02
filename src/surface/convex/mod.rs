//! Convex solids for collision: a surface becomes slabs and patches that a simulator can hold things with.

mod hull;

mod raster;
mod rectangles;
mod shell;
mod solid;

pub use hull::convex_hull;
pub use shell::{ConvexConfig, Hidden, convex_shell};
pub use solid::{ConvexSolid, Plane};
