//! Pure geometry: cameras, rigid motions, screw axes, node-aligned grids.

mod bounds;
pub mod bytes;
mod camera;
mod grid;
mod nearest;
mod rigid_fit;
mod screw;

pub use bounds::{SceneBox, all_about, bounding_box};
pub use camera::Intrinsics;
pub use grid::Grid3;
pub use nearest::NearestPoints;
pub use rigid_fit::rigid_fit;
pub use screw::{Screw, exp_so3, line_distance_m, log_so3, rotation_angle_rad, shift_and_turn, skew};

/// A rigid motion or a frame transform; name it `target_from_source`.
pub type Pose = nalgebra::Isometry3<f64>;
