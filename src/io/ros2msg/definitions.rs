//! Names, definitions and hashes (REP-2016) of the message types, as rosidl makes them.

use super::{CameraInfo, CompressedImage, Image, JointState, PoseStamped, TfMessage};
use super::{
    diagnostic::DiagnosticArray,
    gap::GapReport,
    imu::Imu,
    markers::MarkerArray,
    odometry::FullOdometry,
    point_cloud::PointCloud2,
    status::CollectionStatus,
    text::{Clock, Text},
};

/// A message sent under its ROS type.
pub trait RosMessage: serde::Serialize + serde::de::DeserializeOwned + Send + Sync + 'static {
    /// Its type, e.g. `sensor_msgs/msg/Image`.
    const TYPE: &'static str;
}

/// Description of a type in a bag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Definition {
    /// `sensor_msgs/msg/Image`.
    pub type_name: &'static str,
    /// `RIHS01_` and 64 hexadecimal digits.
    pub hash: &'static str,
    /// The definition, followed by those of all needed types (`ros2msg`).
    pub text: &'static str,
}

/// The first line of a definition file is the hash.
macro_rules! definitions {
    ($($message:ty, $package:literal, $name:literal;)*) => {
        $(impl RosMessage for $message {
            const TYPE: &'static str = concat!($package, "/msg/", $name);
        })*
        // Built in, as a bag contains the definition of each of its types, and no ROS installation is needed.
        const FILES: &[(&str, &str)] =
            &[$((<$message>::TYPE, include_str!(concat!("definitions/", $package, "-", $name, ".msg")))),*];
    };
}

definitions! {
    Image, "sensor_msgs", "Image";
    CompressedImage, "sensor_msgs", "CompressedImage";
    CameraInfo, "sensor_msgs", "CameraInfo";
    Imu, "sensor_msgs", "Imu";
    JointState, "sensor_msgs", "JointState";
    PointCloud2, "sensor_msgs", "PointCloud2";
    TfMessage, "tf2_msgs", "TFMessage";
    PoseStamped, "geometry_msgs", "PoseStamped";
    FullOdometry, "nav_msgs", "Odometry";
    MarkerArray, "visualization_msgs", "MarkerArray";
    DiagnosticArray, "diagnostic_msgs", "DiagnosticArray";
    Clock, "rosgraph_msgs", "Clock";
    Text, "std_msgs", "String";
    CollectionStatus, "artitwin_msgs", "CollectionStatus";
    GapReport, "artitwin_msgs", "GapReport";
}

/// All known types.
pub fn definitions() -> impl Iterator<Item = Definition> {
    FILES.iter().filter_map(|(type_name, file)| {
        let (hash, text) = file.split_once('\n')?;
        Some(Definition { type_name, hash, text })
    })
}

/// The definition of a type.
#[must_use]
pub fn definition(type_name: &str) -> Option<Definition> {
    definitions().find(|d| d.type_name == type_name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_has_a_hash_and_a_definition() {
        assert_eq!(definitions().count(), FILES.len());
        for d in definitions() {
            let digits = d.hash.strip_prefix("RIHS01_").unwrap();
            assert!(digits.len() == 64 && digits.bytes().all(|b| b.is_ascii_hexdigit()), "{}", d.type_name);
            assert!(d.text.ends_with('\n') && !d.text.contains("RIHS01"), "{}", d.type_name);
        }
        assert_eq!(definition("std_msgs/msg/String").unwrap().text, "string data\n");
        assert_eq!(definition("std_msgs/msg/Nothing"), None);
    }
}
