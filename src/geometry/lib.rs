//! Pure geometry: cameras, rigid motions, screw axes, node-aligned grids.
//!
//! ```
//! use geometry::{Pose, Screw};
//! use nalgebra::{UnitQuaternion, Vector3};
//!
//! // A door turns by 0.5 rad about an upright hinge through (1, 0, 0).
//! let hinge = Vector3::new(1.0, 0.0, 0.0);
//! let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.5);
//! let screw = Screw::of_motion(&Pose::from_parts((hinge - turn * hinge).into(), turn)).ok_or("no motion")?;
//! assert!((screw.angle_rad - 0.5).abs() < 1e-12);
//! assert!((screw.point.coords - hinge).norm() < 1e-12);
//! # Ok::<(), &str>(())
//! ```

mod bilinear;
mod bounds;
pub mod bytes;
mod camera;
mod grid;
mod nearest;
mod rigid_fit;
mod screw;

pub use bilinear::bilinear;
pub use bounds::{SceneBox, all_about, bounding_box, box_corners, lattice_directions};
pub use camera::Intrinsics;
pub use grid::Grid3;
pub use nearest::NearestPoints;
pub use rigid_fit::rigid_fit;
pub use screw::{
    AxisMotion, Screw, exp_so3, line_distance_m, log_so3, normals_of, rotation_angle_rad, shift_and_turn,
};

/// A rigid motion or a frame transform; name it `target_from_source`.
pub type Pose = nalgebra::Isometry3<f64>;
