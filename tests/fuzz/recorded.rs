//! Small recordings as lists of MCAP records, and their files: chunks, checksums and summary are right
//! whatever the records hold.

use std::io::Write as _;

use geometry::Pose;
use image::{DynamicImage, ImageFormat};
use io::ros2msg::{
    CameraInfo, CompressedImage, Header, Image, JointState, Odometry, PoseStamped, TfMessage, Time,
    Transform, TransformStamped, Vector3, WrenchStamped, encode,
};
use io::rvl;
use serde::Serialize;

use super::mutate::Parts;

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const HEADER: u8 = 0x01;
const FOOTER: u8 = 0x02;
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const DATA_END: u8 = 0x0f;
/// Size of the images.
pub const SIZE: (u32, u32) = (16, 12);
/// Stamp of the first image, nanoseconds.
pub const START: i64 = 1_760_000_000_000_000_000;

/// Words of bags.
pub const WORDS: [&str; 30] = [
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/CameraInfo",
    "tf2_msgs/msg/TFMessage",
    "geometry_msgs/msg/PoseStamped",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/String",
    "cdr",
    "ros1",
    "ros2msg",
    "zstd",
    "lz4",
    "rgb8",
    "bgr8",
    "rgba8",
    "mono8",
    "mono16",
    "8UC1",
    "8UC3",
    "16UC1",
    "32FC1",
    "; compressedDepth png",
    "; compressedDepth rvl",
    "jpeg",
    "plumb_bob",
    "rational_polynomial",
    "equidistant",
    "/mask",
    "/depth/",
];

/// A recording that grows by records. The first piece says how the file is made: compression, records in a
/// chunk, whether it has a summary.
pub struct Records {
    parts: Parts,
    topics: Vec<String>,
}

impl Records {
    /// `compression`: 0 none, 1 zstd, 2 lz4, 3 no chunks.
    pub fn new(compression: u8, records_in_a_chunk: u8) -> Self {
        let header = [&[HEADER][..], &text("ros2"), &text("fuzz")].concat();
        Self { parts: vec![vec![compression, records_in_a_chunk, 1], header], topics: Vec::new() }
    }

    pub fn message(&mut self, topic: &str, kind: &str, nanos: i64, message: &impl Serialize) {
        self.bytes(topic, kind, nanos, &encode(message).unwrap());
    }

    pub fn bytes(&mut self, topic: &str, kind: &str, nanos: i64, data: &[u8]) {
        let known = self.topics.iter().position(|t| t == topic);
        let id = known.unwrap_or(self.topics.len()) as u16 + 1;
        if known.is_none() {
            self.topics.push(topic.to_owned());
            let number = id.to_le_bytes();
            self.parts.push([&[SCHEMA][..], &number, &text(kind), &text("ros2msg"), &text("")].concat());
            self.parts.push([&[CHANNEL][..], &number, &number, &text(topic), &text("cdr"), &[0; 4]].concat());
        }
        let time = (nanos as u64).to_le_bytes();
        self.parts.push([&[MESSAGE][..], &id.to_le_bytes(), &[0; 4], &time, &time, data].concat());
    }

    pub fn parts(self) -> Parts {
        self.parts
    }
}

fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

fn record(part: &[u8]) -> Vec<u8> {
    let (opcode, body) = part.split_first().unwrap_or((&MESSAGE, &[]));
    [&[*opcode][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

/// The file of a list of records.
pub fn bag(parts: &[Vec<u8>]) -> Vec<u8> {
    let Some((control, records)) = parts.split_first() else { return MAGIC.to_vec() };
    let control = |k: usize| control.get(k).copied().unwrap_or_default();
    let (compression, in_a_chunk) = (control(0) % 4, usize::from(control(1)).max(1));
    let is_head = |part: &&Vec<u8>| part.first() == Some(&HEADER);
    let mut file = MAGIC.to_vec();
    records.iter().take(1).filter(is_head).for_each(|part| file.extend(record(part)));
    let rest: Vec<&Vec<u8>> =
        records.iter().skip(usize::from(records.first().is_some_and(|p| is_head(&p)))).collect();
    for group in rest.chunks(in_a_chunk) {
        let content: Vec<u8> = group.iter().flat_map(|part| record(part)).collect();
        match compression {
            3 => file.extend(content),
            kind => file.extend(record(&chunk(&content, kind))),
        }
    }
    file.extend(record(&[&[DATA_END][..], &[0; 4]].concat()));
    let summary = file.len() as u64;
    let told = |part: &&&Vec<u8>| matches!(part.first(), Some(&(SCHEMA | CHANNEL)));
    if control(2) & 1 == 1 {
        rest.iter().filter(told).for_each(|part| file.extend(record(part)));
    }
    let start = if control(2) & 1 == 1 { summary } else { 0 };
    file.extend(record(&[&[FOOTER][..], &start.to_le_bytes(), &[0; 12]].concat()));
    file.extend(MAGIC);
    file
}

fn chunk(content: &[u8], compression: u8) -> Vec<u8> {
    let (name, packed) = match compression {
        1 => ("zstd", zstd::encode_all(content, 1).unwrap()),
        2 => {
            let mut encoder = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
            encoder.write_all(content).unwrap();
            let (packed, end) = encoder.finish();
            end.unwrap();
            ("lz4", packed)
        }
        _ => ("", content.to_vec()),
    };
    let (size, crc) = ((content.len() as u64).to_le_bytes(), crc32fast::hash(content).to_le_bytes());
    [&[CHUNK][..], &[0; 16], &size, &crc, &text(name), &(packed.len() as u64).to_le_bytes(), &packed].concat()
}

pub fn header(nanos: i64, frame: &str) -> Header {
    Header { stamp: Time::from_nanos(nanos), frame_id: frame.into() }
}

pub fn camera_info(nanos: i64, distortion: &str) -> CameraInfo {
    let (fx, cx, cy) = (14.0, 7.5, 5.5);
    CameraInfo {
        header: header(nanos, "optical"),
        width: SIZE.0,
        height: SIZE.1,
        distortion_model: distortion.into(),
        d: vec![0.1, -0.02, 0.001, 0.0, 0.0],
        k: [fx, 0.0, cx, 0.0, fx, cy, 0.0, 0.0, 1.0],
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: [fx, 0.0, cx, 0.0, 0.0, fx, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        ..CameraInfo::default()
    }
}

pub fn image(nanos: i64, encoding: &str, bytes: usize, pixel: impl Fn(usize) -> Vec<u8>) -> Image {
    let (width, height) = SIZE;
    let data = (0..(width * height) as usize).flat_map(pixel).collect();
    let step = width * bytes as u32;
    Image {
        header: header(nanos, "optical"),
        height,
        width,
        encoding: encoding.into(),
        is_bigendian: 0,
        step,
        data,
    }
}

/// Millimeters of a pixel: a box before a wall.
pub fn millimeters(pixel: usize) -> u16 {
    let (x, y) = (pixel % SIZE.0 as usize, pixel / SIZE.0 as usize);
    if (4..12).contains(&x) && (3..9).contains(&y) { 700 + 3 * x as u16 } else { 1200 + y as u16 }
}

pub fn picture(format: ImageFormat, depth: bool) -> Vec<u8> {
    picture_of(SIZE, format, depth)
}

pub fn picture_of((width, height): (u32, u32), format: ImageFormat, depth: bool) -> Vec<u8> {
    let count = (width * height) as usize;
    let picture: DynamicImage = match depth {
        true => image::ImageBuffer::<image::Luma<u16>, _>::from_raw(
            width,
            height,
            (0..count).map(millimeters).collect(),
        )
        .unwrap()
        .into(),
        false => image::RgbImage::from_raw(width, height, (0..3 * count).map(|k| (k * 7) as u8).collect())
            .unwrap()
            .into(),
    };
    let mut file = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut file, format).unwrap();
    file.into_inner()
}

/// `compressedDepth` of the depth, by PNG or RVL.
pub fn compressed_depth(by_rvl: bool) -> Vec<u8> {
    let pixels: Vec<u16> = (0..(SIZE.0 * SIZE.1) as usize).map(millimeters).collect();
    let code = match by_rvl {
        true => [&SIZE.0.to_le_bytes()[..], &SIZE.1.to_le_bytes(), &rvl::encode(&pixels)].concat(),
        false => picture(ImageFormat::Png, true),
    };
    [&[0; 4][..], &100f32.to_le_bytes(), &1f32.to_le_bytes(), &code].concat()
}

pub fn compressed(nanos: i64, format: &str, data: Vec<u8>) -> CompressedImage {
    CompressedImage { header: header(nanos, "optical"), format: format.into(), data }
}

pub fn pose(k: i64) -> Pose {
    let k = k as f64;
    Pose::translation(0.01 * k, 0.0, 1.0) * Pose::rotation(nalgebra::Vector3::new(0.0, 0.02 * k, 0.3))
}

pub fn transform(nanos: i64, parent: &str, child: &str, pose: &Pose) -> TfMessage {
    let transform = Transform::from_pose(pose);
    TfMessage {
        transforms: vec![TransformStamped {
            header: header(nanos, parent),
            child_frame_id: child.into(),
            transform,
        }],
    }
}

/// How images and poses of a recording are written.
#[derive(Clone, Copy, PartialEq)]
pub enum Style {
    Raw,
    Png,
    Rvl,
}

/// A recording of some views.
pub fn frames(style: Style, compression: u8, views: i64) -> Parts {
    let mut bag = Records::new(compression, 5);
    bag.message(
        "/tf_static",
        "tf2_msgs/msg/TFMessage",
        START,
        &transform(START, "link", "optical", &Pose::translation(0.0, 0.01, 0.0)),
    );
    for k in 0..=views {
        let at = START + k * 100_000_000;
        let (pose, head) = (pose(k), header(at, "world"));
        let given = Transform::from_pose(&pose);
        match style {
            Style::Raw => {
                bag.message("/tf", "tf2_msgs/msg/TFMessage", at, &transform(at, "world", "link", &pose))
            }
            Style::Png => bag.message(
                "/pose",
                "geometry_msgs/msg/PoseStamped",
                at,
                &PoseStamped { header: head, pose: given },
            ),
            Style::Rvl => {
                let message = Odometry { header: head, child_frame_id: "link".into(), pose: given };
                bag.message("/odom", "nav_msgs/msg/Odometry", at, &message);
            }
        }
        if k == views {
            break;
        }
        bag.message("/color/camera_info", "sensor_msgs/msg/CameraInfo", at, &camera_info(at, "plumb_bob"));
        match style {
            Style::Raw => {
                let color = image(at, "rgb8", 3, |p| vec![p as u8, 80, 200]);
                bag.message("/color/image_raw", "sensor_msgs/msg/Image", at, &color);
                let depth = image(at + 1000, "16UC1", 2, |p| millimeters(p).to_le_bytes().to_vec());
                bag.message("/aligned_depth/image_raw", "sensor_msgs/msg/Image", at, &depth);
                let mask = image(at + 2000, "mono8", 1, |p| vec![u8::from(millimeters(p) < 1000)]);
                bag.message("/object/mask", "sensor_msgs/msg/Image", at, &mask);
            }
            Style::Png | Style::Rvl => {
                let kind = "sensor_msgs/msg/CompressedImage";
                let (format, name) =
                    if style == Style::Png { (ImageFormat::Png, "png") } else { (ImageFormat::Jpeg, "jpeg") };
                bag.message(
                    "/color/image_raw/compressed",
                    kind,
                    at,
                    &compressed(at, name, picture(format, false)),
                );
                let by_rvl = style == Style::Rvl;
                let format = if by_rvl { "16UC1; compressedDepth rvl" } else { "16UC1; compressedDepth png" };
                bag.message(
                    "/aligned_depth/image_raw/compressedDepth",
                    kind,
                    at,
                    &compressed(at, format, compressed_depth(by_rvl)),
                );
            }
        }
    }
    bag.parts()
}

/// A recording of a door's joint, its wrench and its pose.
pub fn joint_log(compression: u8, samples: i64) -> Parts {
    let mut bag = Records::new(compression, 40);
    for k in 0..samples {
        let (at, angle) = (START + k * 10_000_000, 0.4 + 0.3 * (0.07 * k as f64).sin());
        let effort = (0.11 * k as f64).cos();
        let state = JointState {
            header: header(at, ""),
            name: vec!["hinge".into(), "slide".into()],
            position: vec![angle, 0.1 * angle],
            velocity: Vec::new(),
            effort: vec![effort, 1.0],
        };
        bag.message("/joint_states", "sensor_msgs/msg/JointState", at, &state);
        if k % 5 == 0 {
            let wrench = WrenchStamped {
                header: header(at, "handle"),
                force: Vector3::from([0.0, effort, 0.1]),
                torque: Vector3::default(),
            };
            bag.message("/wrench", "geometry_msgs/msg/WrenchStamped", at, &wrench);
            let turned = Pose::rotation(nalgebra::Vector3::new(0.0, 0.0, angle));
            bag.message("/tf", "tf2_msgs/msg/TFMessage", at, &transform(at, "base", "door", &turned));
            let given = PoseStamped { header: header(at, "base"), pose: Transform::from_pose(&turned) };
            bag.message("/door_pose", "geometry_msgs/msg/PoseStamped", at, &given);
        }
    }
    bag.parts()
}
