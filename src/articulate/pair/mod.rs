//! Two surfaces and a motion between them: where samples reproject, at what cost, and the motion refined.

pub(crate) mod point_to_plane;
pub(crate) mod recent;
pub(crate) mod reprojection;
pub(crate) mod surface_pair;
pub(crate) mod unexplained;
