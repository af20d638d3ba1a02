//! artitwin: RGB-D recordings of an articulated object in two states in, a simulator-ready digital twin out.
//!
//! Data flows one way:
//!
//! ```text
//! io (bag, dataset)  ->  capture (frames per state)  ->  field (one neural TSDF per state)
//!     ->  surface (mesh, distance field, visibility)  ->  articulate (parts, motions, joints)
//!     ->  model (links, joints, evidence)  ->  export (URDF, report)  ->  io (atomic run folder)
//! ```
//!
//! Conventions: SI units and radians; a transform `target_from_source` maps source coordinates to target
//! coordinates; cameras are optical frames (x right, y down, z forward); integer pixel coordinates are pixel
//! centres; depth is z-depth in metres and 0 means unknown; signed distances are negative inside.

pub mod articulate;
pub mod capture;
pub mod cli;
pub mod config;
pub mod evaluate;
pub mod export;
pub mod field;
mod files;
pub mod gap;
pub mod geometry;
pub mod io;
mod limits;
pub mod model;
#[cfg(feature = "node")]
pub mod node;
pub mod run;
pub mod surface;
pub mod synth;
