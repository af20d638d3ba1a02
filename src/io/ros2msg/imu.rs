//! `sensor_msgs/msg/Imu`.

use serde::{Deserialize, Serialize};

use super::{Header, Quaternion, Vector3};

/// Accelerations larger than this do not occur in a hand-held camera, m/s².
/// derived: 16 g, the largest range of the sensors in depth cameras
const MOST: f64 = 160.0;

/// `sensor_msgs/msg/Imu`. A covariance beginning with -1 stands for a missing reading.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Imu {
    /// Stamp and the frame of the readings.
    pub header: Header,
    /// Orientation.
    pub orientation: Quaternion,
    /// Its covariance, row-major 3x3.
    pub orientation_covariance: [f64; 9],
    /// Angular velocity, rad/s.
    pub angular_velocity: Vector3,
    /// Its covariance.
    pub angular_velocity_covariance: [f64; 9],
    /// Specific force, m/s²: acceleration minus gravity; at rest it points upwards.
    pub linear_acceleration: Vector3,
    /// Its covariance.
    pub linear_acceleration_covariance: [f64; 9],
}

impl Imu {
    /// The measured acceleration, m/s²; `None` if there is none: drivers fill the messages of their
    /// gyroscopes with zeros.
    #[must_use]
    pub fn acceleration(&self) -> Option<nalgebra::Vector3<f64>> {
        let a = self.linear_acceleration;
        let read = self.linear_acceleration_covariance[0] != -1.0
            && [a.x, a.y, a.z] != [0.0; 3]
            // False for NaN, too.
            && [a.x, a.y, a.z].iter().all(|v| v.abs() <= MOST);
        read.then(|| nalgebra::Vector3::new(a.x, a.y, a.z))
    }
}
