//! Two surfaces and a motion between them: where samples are moved to, at what cost, and how the motion is
//! refined.

pub(crate) mod point_to_plane;
pub(crate) mod recent;
pub(crate) mod reprojection;
pub(crate) mod surface_pair;
pub(crate) mod unexplained;
