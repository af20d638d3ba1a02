//! The ROS 2 messages of recordings, as serde structs in CDR field order, and their decoding.
//!
//! A payload is a 4-byte encapsulation header followed by plain CDR (XCDR1), in either byte order. The
//! decoder's output is still untrusted: see [`crate::image_codec`] and the crate `capture` for the checks of
//! its meaning.

pub mod definitions;
pub mod diagnostic;
pub mod gap;
pub mod imu;
pub mod joints;
pub mod markers;
pub mod odometry;
pub mod point_cloud;
pub mod status;
pub mod text;

use byteorder::{BigEndian, LittleEndian};
use serde::{Deserialize, Serialize, de::DeserializeOwned};

/// Longest accepted name (frame, encoding) in a message, bytes.
pub const MAX_NAME: usize = 256;

/// Why a payload could not be decoded.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum DecodeError {
    /// It is too short for the header.
    #[error("the payload has {0} bytes, no room for a CDR header")]
    Short(usize),
    /// It has another representation.
    #[error("CDR representation {0} ({name}) is not plain CDR", name = representation_name(*.0))]
    Representation(u8),
    /// The body does not fit the type.
    #[error("{0}")]
    Body(String),
}

fn representation_name(id: u8) -> &'static str {
    match id {
        2 | 3 => "parameter list",
        6..=11 => "XCDR2",
        _ => "unknown",
    }
}

/// Decodes a message with its 4-byte encapsulation header. Bytes after the message are ignored, so a
/// struct may stand for the front of a longer message.
///
/// # Errors
/// [`DecodeError`]; XCDR2 and parameter lists are refused.
pub fn decode<T: DeserializeOwned>(payload: &[u8]) -> Result<T, DecodeError> {
    // The second byte gives the representation; the options after it have no meaning in XCDR1.
    let [_, id, _, _, body @ ..] = payload else { return Err(DecodeError::Short(payload.len())) };
    match id {
        0 => cdr_encoding::from_bytes::<T, BigEndian>(body),
        1 => cdr_encoding::from_bytes::<T, LittleEndian>(body),
        other => return Err(DecodeError::Representation(*other)),
    }
    .map(|(message, _)| message)
    .map_err(|e| DecodeError::Body(e.to_string()))
}

/// Encodes a message as little-endian CDR with its header, as bags hold it.
///
/// # Errors
/// [`DecodeError::Body`] where serde cannot express the value.
pub fn encode<T: Serialize>(message: &T) -> Result<Vec<u8>, DecodeError> {
    let body =
        cdr_encoding::to_vec::<T, LittleEndian>(message).map_err(|e| DecodeError::Body(e.to_string()))?;
    // CDR_LE, no options.
    Ok([&[0, 1, 0, 0], body.as_slice()].concat())
}

/// `builtin_interfaces/msg/Time`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Time {
    /// Seconds since the epoch.
    pub sec: i32,
    /// Nanoseconds, below one billion.
    pub nanosec: u32,
}

impl Time {
    /// Nanoseconds since the epoch; `None` for an invalid stamp.
    #[must_use]
    pub fn nanos(&self) -> Option<i64> {
        (self.sec >= 0 && self.nanosec < 1_000_000_000)
            .then(|| i64::from(self.sec) * 1_000_000_000 + i64::from(self.nanosec))
    }

    /// The stamp of a number of nanoseconds since the epoch.
    #[must_use]
    pub fn from_nanos(nanos: i64) -> Self {
        Self { sec: (nanos / 1_000_000_000) as i32, nanosec: (nanos % 1_000_000_000) as u32 }
    }
}

/// `std_msgs/msg/Header`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// When the data was taken.
    pub stamp: Time,
    /// The frame it is given in.
    pub frame_id: String,
}

impl Header {
    /// Stamp in nanoseconds and frame name; `None` if one of them cannot be used.
    #[must_use]
    pub fn checked(&self) -> Option<(i64, String)> {
        let frame = self.frame_id.trim_start_matches('/');
        // The name comes from a file or the network and is copied into messages about it.
        (frame.len() <= MAX_NAME).then_some(())?;
        Some((self.stamp.nanos()?, frame.to_owned()))
    }
}

/// `sensor_msgs/msg/Image`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Image {
    /// Stamp and optical frame.
    pub header: Header,
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// Pixel format, e.g. `rgb8`.
    pub encoding: String,
    /// Byte order of multi-byte pixels.
    pub is_bigendian: u8,
    /// Bytes per row.
    pub step: u32,
    /// Rows of `step` bytes.
    // As one block: element by element a color image takes 100 times as long (2.9 ms instead of 0.03 ms).
    #[serde(with = "serde_bytes")]
    pub data: Vec<u8>,
}

/// An [`Image`] up to its data.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ImageFront {
    /// Stamp and optical frame.
    pub header: Header,
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// Pixel format.
    pub encoding: String,
}

/// `sensor_msgs/msg/CompressedImage`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CompressedImage {
    /// Stamp and optical frame.
    pub header: Header,
    /// E.g. `jpeg`, `rgb8; jpeg compressed bgr8`, `16UC1; compressedDepth png`.
    pub format: String,
    /// The compressed image.
    #[serde(with = "serde_bytes")]
    pub data: Vec<u8>,
}

/// A [`CompressedImage`] up to its data.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CompressedFront {
    /// Stamp and optical frame.
    pub header: Header,
    /// Format.
    pub format: String,
}

/// `sensor_msgs/msg/RegionOfInterest`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RegionOfInterest {
    /// Left column.
    pub x_offset: u32,
    /// Top row.
    pub y_offset: u32,
    /// Rows; 0 = all.
    pub height: u32,
    /// Columns; 0 = all.
    pub width: u32,
    /// Unused here.
    pub do_rectify: bool,
}

/// `sensor_msgs/msg/CameraInfo`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraInfo {
    /// Stamp and optical frame.
    pub header: Header,
    /// Rows of the calibrated image.
    pub height: u32,
    /// Columns of the calibrated image.
    pub width: u32,
    /// `plumb_bob`, `rational_polynomial`, ...
    pub distortion_model: String,
    /// Distortion coefficients.
    pub d: Vec<f64>,
    /// Camera matrix of the raw image, row-major 3x3.
    pub k: [f64; 9],
    /// Rectification, row-major 3x3.
    pub r: [f64; 9],
    /// Projection of the rectified image, row-major 3x4.
    pub p: [f64; 12],
    /// Columns combined into one; 0 and 1 = none.
    pub binning_x: u32,
    /// Rows combined into one; 0 and 1 = none.
    pub binning_y: u32,
    /// The kept part of the image.
    pub roi: RegionOfInterest,
}

/// `geometry_msgs/msg/Vector3` and `Point`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Vector3 {
    /// x, meters.
    pub x: f64,
    /// y, meters.
    pub y: f64,
    /// z, meters.
    pub z: f64,
}

impl From<[f64; 3]> for Vector3 {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

/// `geometry_msgs/msg/Quaternion`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    /// x.
    pub x: f64,
    /// y.
    pub y: f64,
    /// z.
    pub z: f64,
    /// Scalar part.
    pub w: f64,
}

impl Default for Quaternion {
    fn default() -> Self {
        // geometry_msgs defines this default; all zeros are no rotation.
        Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

/// `geometry_msgs/msg/Transform` and `Pose`: both are a position and a rotation, child in parent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Transform {
    /// Position of the child in the parent frame.
    pub translation: Vector3,
    /// Rotation of the child in the parent frame.
    pub rotation: Quaternion,
}

impl Transform {
    /// `parent_from_child`; `None` if a number is not finite, a coordinate exceeds 1e6 m or the quaternion's
    /// length differs from 1 by more than 1 %.
    #[must_use]
    pub fn checked(&self) -> Option<geometry::Pose> {
        let t = self.translation;
        let q = self.rotation;
        // False for NaN, too.
        if ![t.x, t.y, t.z].iter().all(|v| v.abs() <= 1e6) {
            return None;
        }
        let q = nalgebra::Quaternion::new(q.w, q.x, q.y, q.z);
        // Publishers round; all zeros, the value of an unfilled message, are refused.
        let unit = (q.norm() - 1.0).abs();
        if unit.is_nan() || unit > 0.01 {
            return None;
        }
        Some(geometry::Pose::from_parts(
            nalgebra::Translation3::new(t.x, t.y, t.z),
            nalgebra::UnitQuaternion::from_quaternion(q),
        ))
    }

    /// The message of a pose.
    #[must_use]
    pub fn from_pose(pose: &geometry::Pose) -> Self {
        let t = pose.translation.vector;
        let q = pose.rotation;
        Self {
            translation: Vector3 { x: t.x, y: t.y, z: t.z },
            rotation: Quaternion { x: q.i, y: q.j, z: q.k, w: q.w },
        }
    }
}

/// `geometry_msgs/msg/TransformStamped`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TransformStamped {
    /// Stamp and parent frame.
    pub header: Header,
    /// Child frame.
    pub child_frame_id: String,
    /// `parent_from_child`.
    pub transform: Transform,
}

/// `tf2_msgs/msg/TFMessage`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TfMessage {
    /// Its transforms.
    pub transforms: Vec<TransformStamped>,
}

/// `geometry_msgs/msg/PoseStamped`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PoseStamped {
    /// Stamp and the frame the pose is given in.
    pub header: Header,
    /// The pose.
    pub pose: Transform,
}

/// `geometry_msgs/msg/WrenchStamped`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WrenchStamped {
    /// Stamp and the frame the wrench is given in.
    pub header: Header,
    /// Force, N.
    pub force: Vector3,
    /// Moment, N m.
    pub torque: Vector3,
}

/// `nav_msgs/msg/Odometry` up to its pose; covariance and twist are not read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Odometry {
    /// Stamp and the frame the pose is given in.
    pub header: Header,
    /// The posed frame.
    pub child_frame_id: String,
    /// The pose.
    pub pose: Transform,
}

/// `sensor_msgs/msg/JointState`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointState {
    /// When the joints were measured.
    pub header: Header,
    /// Names of the joints.
    pub name: Vec<String>,
    /// Positions, rad or m; empty where there are none.
    pub position: Vec<f64>,
    /// Velocities, rad/s or m/s; empty where there are none.
    pub velocity: Vec<f64>,
    /// Efforts, N m or N; empty where there are none.
    pub effort: Vec<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image() -> Image {
        let header = Header { stamp: Time { sec: 3, nanosec: 5 }, frame_id: "cam".into() };
        Image {
            header,
            height: 2,
            width: 1,
            encoding: "rgb8".into(),
            is_bigendian: 0,
            step: 3,
            data: vec![1, 2, 3, 4, 5, 6],
        }
    }

    /// Bytes written down by hand from the CDR rules: 4-byte alignment after the header, strings with their
    /// NUL.
    const IMAGE_BYTES: &[u8] = &[
        0, 1, 0, 0, 3, 0, 0, 0, 5, 0, 0, 0, 4, 0, 0, 0, b'c', b'a', b'm', 0, 2, 0, 0, 0, 1, 0, 0, 0, 5, 0, 0,
        0, b'r', b'g', b'b', b'8', 0, 0, 0, 0, 3, 0, 0, 0, 6, 0, 0, 0, 1, 2, 3, 4, 5, 6,
    ];

    #[test]
    fn an_image_has_the_bytes_of_the_standard() {
        assert_eq!(encode(&image()).unwrap(), IMAGE_BYTES);
        assert_eq!(decode::<Image>(IMAGE_BYTES).unwrap(), image());
        assert_eq!(decode::<ImageFront>(IMAGE_BYTES).unwrap().encoding, "rgb8");
    }

    #[test]
    fn big_endian_is_read() {
        let big = [0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0, 5, 0, 0, 0, 4, b'c', b'a', b'm', 0];
        assert_eq!(decode::<Header>(&big).unwrap(), image().header);
    }

    #[test]
    fn other_representations_are_refused_by_name() {
        let mut bytes = IMAGE_BYTES.to_vec();
        bytes[1] = 7;
        assert!(decode::<Image>(&bytes).unwrap_err().to_string().contains("XCDR2"));
        assert_eq!(decode::<Image>(&bytes[..3]), Err(DecodeError::Short(3)));
        assert!(matches!(decode::<Image>(&IMAGE_BYTES[..40]), Err(DecodeError::Body(_))));
    }

    #[test]
    fn lengths_beyond_the_payload_are_refused() {
        let mut bytes = IMAGE_BYTES.to_vec();
        bytes[44..48].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(matches!(decode::<Image>(&bytes), Err(DecodeError::Body(_))));
    }

    #[test]
    fn a_transform_must_be_one() {
        let pose = geometry::Pose::translation(1.0, -2.0, 3.0);
        let good = Transform::from_pose(&pose);
        assert_eq!(good.checked().unwrap(), pose);
        let mut bad = good;
        bad.rotation.w = 0.5;
        assert_eq!(bad.checked(), None);
        bad = good;
        bad.translation.y = f64::NAN;
        assert_eq!(bad.checked(), None);
        bad = good;
        bad.rotation.x = f64::NAN;
        assert_eq!(bad.checked(), None);
    }

    #[test]
    fn stamps_must_be_stamps() {
        assert_eq!(Time { sec: 2, nanosec: 5 }.nanos(), Some(2_000_000_005));
        assert_eq!(Time { sec: -1, nanosec: 5 }.nanos(), None);
        assert_eq!(Time { sec: 1, nanosec: 1_000_000_000 }.nanos(), None);
        assert_eq!(Time::from_nanos(2_000_000_005), Time { sec: 2, nanosec: 5 });
    }
}
