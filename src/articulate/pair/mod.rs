//! Two surfaces and a motion between them: where samples reproject, what that costs, and the motion refined.

pub mod point_to_plane;
pub mod recent;
pub mod reprojection;
pub mod surface_pair;
pub mod unexplained;
