//! Messages about joints to and from controllers: ros2_control, `trajectory_msgs`, `std_msgs`.

use serde::{Deserialize, Serialize};

use super::{Header, Time};

/// `trajectory_msgs/msg/JointTrajectoryPoint`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrajectoryPoint {
    /// rad or m; empty where there are none.
    pub positions: Vec<f64>,
    /// rad/s or m/s; empty where there are none.
    pub velocities: Vec<f64>,
    /// rad/s^2 or m/s^2; empty where there are none.
    pub accelerations: Vec<f64>,
    /// N m or N; empty where there are none.
    pub effort: Vec<f64>,
    /// When it is to be reached.
    pub time_from_start: Time,
}

/// `trajectory_msgs/msg/JointTrajectory`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointTrajectory {
    /// When it begins; 0 for at once.
    pub header: Header,
    /// Names of the joints.
    pub joint_names: Vec<String>,
    /// Where the joints are to go.
    pub points: Vec<TrajectoryPoint>,
}

/// The front of `control_msgs/msg/JointTrajectoryControllerState`: the rest differs between releases.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ControllerStateFront {
    /// When the controller ran.
    pub header: Header,
    /// Names of the joints.
    pub joint_names: Vec<String>,
    /// Where the joints are to be.
    pub reference: TrajectoryPoint,
    /// Where they are.
    pub feedback: TrajectoryPoint,
}

/// `control_msgs/msg/InterfaceValue`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct InterfaceValue {
    /// `position`, `velocity`, `effort` and others.
    pub interface_names: Vec<String>,
    /// Their values.
    pub values: Vec<f64>,
}

/// `control_msgs/msg/DynamicJointState`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DynamicJointState {
    /// When the joints were measured.
    pub header: Header,
    /// Names of the joints.
    pub joint_names: Vec<String>,
    /// Interface names and values of each joint.
    pub interface_values: Vec<InterfaceValue>,
}

/// `std_msgs/msg/MultiArrayDimension`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ArrayDimension {
    /// Name.
    pub label: String,
    /// Number of elements.
    pub size: u32,
    /// Elements from one to the next.
    pub stride: u32,
}

/// `std_msgs/msg/Float64MultiArray`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Float64MultiArray {
    /// Dimensions.
    pub dimensions: Vec<ArrayDimension>,
    /// Elements before the first.
    pub data_offset: u32,
    /// The elements.
    pub data: Vec<f64>,
}
