//! Motions as `truth.json` holds them.

use geometry::Pose;

/// The homogeneous matrix of a motion, by rows.
pub(super) fn rows(pose: &Pose) -> [[f64; 4]; 4] {
    pose.to_homogeneous().transpose().into()
}
