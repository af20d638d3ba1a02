//! A synthetic recording as a rosbag2 folder, with the topics of a RealSense driver.

use std::path::Path;

use nalgebra::{Quaternion, Translation3, UnitQuaternion};

use super::{
    bag_writer::BagWriter,
    image_files::{depth_png, jpeg},
    offered_qos::OfferedQos,
    ros2msg::{
        CameraInfo, CompressedImage, Header, Image, TfMessage, Time, Transform, TransformStamped,
        definitions::RosMessage, encode, imu::Imu,
    },
    synth_error::SynthError,
};
use geometry::{Intrinsics, Pose};
use synth::{ImuReading, SynthFrame, SynthState, optical_from_imu};

const COLOR: &str = "/camera/camera/color/image_raw/compressed";
const COLOR_INFO: &str = "/camera/camera/color/camera_info";
const DEPTH: &str = "/camera/camera/aligned_depth_to_color/image_raw/compressedDepth";
const DEPTH_INFO: &str = "/camera/camera/aligned_depth_to_color/camera_info";
const MASK: &str = "/object_mask";
const OPTICAL: &str = "camera_color_optical_frame";
const LINK: &str = "camera_link";
const ACCEL: &str = "/camera/camera/accel/sample";
const ACCEL_FRAME: &str = "camera_accel_frame";
const WORLD: &str = "world";
/// Quality of the JPEG files, percent.
const JPEG_QUALITY: u8 = 92;
/// Stamp of the first view of state 0, nanoseconds since the epoch.
const START_NANOS: i64 = 1_760_000_000_000_000_000;
/// Time between the starts of the states, nanoseconds.
const STATE_NANOS: i64 = 600_000_000_000;
/// Depth and masks are logged a little later than the color of the same view, nanoseconds.
const LATER_NANOS: i64 = 300_000;
/// The static transform is logged this long before the first view, nanoseconds.
const STATIC_NANOS: i64 = 100_000_000;

/// Writes the bag of a state into a new folder.
///
/// # Errors
/// If an image cannot be compressed or the disk refuses.
pub(super) fn synth_bag(folder: &Path, state: usize, recording: &SynthState) -> Result<(), SynthError> {
    let start = START_NANOS + state as i64 * STATE_NANOS;
    let link_from_optical = link_from_optical();
    let mut bag = BagWriter::create(folder)?;
    if recording.is_posed {
        let mount = transform(start - STATIC_NANOS, LINK, OPTICAL, &link_from_optical);
        put(&mut bag, "/tf_static", start - STATIC_NANOS, &mount)?;
    }
    if !recording.imu.is_empty() {
        let mount =
            transform(start - STATIC_NANOS, LINK, ACCEL_FRAME, &(link_from_optical * optical_from_imu()));
        put(&mut bag, "/tf_static", start - STATIC_NANOS, &mount)?;
    }
    let mut readings = recording.imu.iter().peekable();
    for (i, frame) in recording.frames.iter().enumerate() {
        let stamp = start + i as i64 * recording.period_nanos;
        let [before, after] =
            [&frame.reported[0], &frame.reported[1]].map(|p| p * link_from_optical.inverse());
        // In the order of time, as a recorder receives them.
        while let Some(reading) = readings.next_if(|r| start + r.after_nanos <= stamp) {
            put(&mut bag, ACCEL, start + reading.after_nanos, &accel(start, reading))?;
        }
        // A pose on either side of the frame's stamp: a reader interpolates and never extrapolates.
        let at = stamp - SynthFrame::POSE_OFFSET_NANOS;
        if recording.is_posed {
            put(&mut bag, "/tf", at, &transform(at, WORLD, LINK, &before))?;
        }
        let info = camera_info(stamp, &recording.intrinsics);
        put(&mut bag, COLOR_INFO, stamp, &info)?;
        put(&mut bag, DEPTH_INFO, stamp, &info)?;
        put_images(&mut bag, stamp, &recording.intrinsics, frame)?;
        let at = stamp + SynthFrame::POSE_OFFSET_NANOS;
        if recording.is_posed {
            put(&mut bag, "/tf", at, &transform(at, WORLD, LINK, &after))?;
        }
    }
    for reading in readings {
        put(&mut bag, ACCEL, start + reading.after_nanos, &accel(start, reading))?;
    }
    bag.finish()?;
    Ok(())
}

/// A message with only an acceleration: covariances of -1 mark orientation and angular velocity as missing.
fn accel(start: i64, reading: &ImuReading) -> Imu {
    let nothing = [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    Imu {
        header: header(start + reading.after_nanos, ACCEL_FRAME),
        orientation_covariance: nothing,
        angular_velocity_covariance: nothing,
        linear_acceleration: <[f64; 3]>::from(reading.acceleration).into(),
        ..Imu::default()
    }
}

fn put<M: RosMessage>(
    bag: &mut BagWriter,
    topic: &str,
    log_nanos: i64,
    message: &M,
) -> Result<(), SynthError> {
    let qos = OfferedQos { reliable: true, latched: topic == "/tf_static", depth: 10 };
    Ok(bag.write(topic, M::TYPE, qos, log_nanos, &encode(message)?)?)
}

fn put_images(bag: &mut BagWriter, stamp: i64, k: &Intrinsics, frame: &SynthFrame) -> Result<(), SynthError> {
    let width = k.width as u32;
    let height = k.height as u32;
    let color = CompressedImage {
        header: header(stamp, OPTICAL),
        // As compressed_image_transport writes it: encoding of the source, codec, encoding in the JPEG.
        format: "rgb8; jpeg compressed bgr8".into(),
        data: jpeg(k, &frame.rgb, JPEG_QUALITY)?,
    };
    put(bag, COLOR, stamp, &color)?;
    // compressedDepth: 12 bytes of quantization, unused for 16UC1, then the PNG.
    let data = [&[0; 12], depth_png(k, &frame.depth_mm)?.as_slice()].concat();
    let depth =
        CompressedImage { header: header(stamp, OPTICAL), format: "16UC1; compressedDepth png".into(), data };
    // Logged later under the same stamp: a reader must pair by stamp, not by recording time.
    put(bag, DEPTH, stamp + LATER_NANOS, &depth)?;
    let Some(mask) = &frame.mask else { return Ok(()) };
    let mask = Image {
        header: header(stamp, OPTICAL),
        height,
        width,
        encoding: "mono8".into(),
        is_bigendian: 0,
        step: width,
        data: mask.iter().map(|m| u8::from(*m) * 255).collect(),
    };
    put(bag, MASK, stamp + 2 * LATER_NANOS, &mask)
}

fn header(stamp_nanos: i64, frame: &str) -> Header {
    Header { stamp: Time::from_nanos(stamp_nanos), frame_id: frame.into() }
}

fn transform(stamp_nanos: i64, parent: &str, child: &str, parent_from_child: &Pose) -> TfMessage {
    let transform = Transform::from_pose(parent_from_child);
    TfMessage {
        transforms: vec![TransformStamped {
            header: header(stamp_nanos, parent),
            child_frame_id: child.into(),
            transform,
        }],
    }
}

/// The optical frame in the camera's body (REP 103): x forward, y left, z up.
fn link_from_optical() -> Pose {
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(0.5, -0.5, 0.5, -0.5));
    Pose::from_parts(Translation3::new(0.0, 0.015, 0.0), turn)
}

fn camera_info(stamp_nanos: i64, k: &Intrinsics) -> CameraInfo {
    CameraInfo {
        header: header(stamp_nanos, OPTICAL),
        height: k.height as u32,
        width: k.width as u32,
        distortion_model: "plumb_bob".into(),
        // plumb_bob has five coefficients, also where they are zero.
        d: vec![0.0; 5],
        k: [k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0],
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: [k.fx, 0.0, k.cx, 0.0, 0.0, k.fy, k.cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        ..CameraInfo::default()
    }
}
