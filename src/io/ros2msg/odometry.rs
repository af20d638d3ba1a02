//! `nav_msgs/msg/Odometry` in full, as it is received and written; of a bag only its front is read.

use serde::{Deserialize, Serialize};

use super::{Header, Transform, Vector3};

/// A covariance, row-major 6x6.
// Nested, because serde has no arrays of more than 32 elements; CDR lays both out alike.
pub type Covariance = [[f64; 6]; 6];

/// `nav_msgs/msg/Odometry`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FullOdometry {
    /// Stamp and the frame the pose is given in.
    pub header: Header,
    /// The posed frame.
    pub child_frame_id: String,
    /// The pose.
    pub pose: Transform,
    /// Its covariance: position, rotation.
    pub pose_covariance: Covariance,
    /// Velocity in the child frame, m/s and rad/s.
    pub twist: [Vector3; 2],
    /// Its covariance.
    pub twist_covariance: Covariance,
}
