//! Recordings made for tests: a box with a smaller box beside it on a floor, ray-cast from a ring of cameras,
//! written as rosbag2 folders in any of the supported encodings, or broken on purpose.

#![allow(dead_code, reason = "every test binary uses its own part of this")]
#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use std::{
    collections::BTreeMap,
    fs::File,
    io::{BufWriter, Cursor},
    path::Path,
};

use geometry::{Intrinsics, Pose};
use image::{DynamicImage, ImageBuffer, ImageFormat};
use io::{
    ros2msg::{
        CameraInfo, CompressedImage, Header, Image, Odometry, PoseStamped, TfMessage, Time, Transform,
        TransformStamped, encode,
    },
    rvl,
};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use serde::Serialize;

/// Camera of the made recordings.
pub const CAMERA: Intrinsics =
    Intrinsics { width: 120, height: 90, fx: 100.0, fy: 101.0, cx: 60.3, cy: 44.2 };
/// Stamp of the first image, nanoseconds.
pub const START: i64 = 1_760_000_000_000_000_000;
/// Time between images, nanoseconds.
pub const PERIOD: i64 = 200_000_000;
/// Frames per state.
pub const COUNT: usize = 10;
pub const COLOR: &str = "/camera/camera/color/image_raw";
pub const COLOR_INFO: &str = "/camera/camera/color/camera_info";
pub const DEPTH: &str = "/camera/camera/aligned_depth_to_color/image_raw";
pub const DEPTH_INFO: &str = "/camera/camera/aligned_depth_to_color/camera_info";
pub const MASK: &str = "/object_mask";
pub const OPTICAL: &str = "camera_color_optical_frame";

/// One rendered view.
#[derive(Clone)]
pub struct Rendered {
    pub world_from_camera: Pose,
    pub rgb: Vec<[u8; 3]>,
    /// Millimeters; 0 = unknown.
    pub depth_mm: Vec<u16>,
    pub mask: Vec<bool>,
}

/// The two boxes of a state: the second one slides by 6 cm along x.
pub fn boxes(state: usize) -> [[Point3<f64>; 2]; 2] {
    let slide = 0.06 * state as f64;
    [
        [Point3::new(-0.1, -0.1, 0.0), Point3::new(0.1, 0.1, 0.15)],
        [Point3::new(0.1 + slide - 0.02, -0.05, 0.05), Point3::new(0.14 + slide, 0.05, 0.12)],
    ]
}

/// Pose of camera number `i` of a state: on an arc, looking at the boxes.
pub fn camera_pose(state: usize, i: f64) -> Pose {
    let angle = -0.9 + 0.2 * i + 0.07 * state as f64;
    let eye = Point3::new(0.75 * angle.cos(), 0.75 * angle.sin(), 0.45 + 0.02 * i);
    Pose::face_towards(&eye, &Point3::new(0.02, 0.0, 0.06), &-Vector3::z())
}

/// Ray-casts a view: no noise, depth to the nearest millimeter.
pub fn render(state: usize, i: usize) -> Rendered {
    let world_from_camera = camera_pose(state, i as f64);
    let pixels = CAMERA.width * CAMERA.height;
    let mut view = Rendered {
        world_from_camera,
        rgb: vec![[0; 3]; pixels],
        depth_mm: vec![0; pixels],
        mask: vec![false; pixels],
    };
    let origin = Point3::from(world_from_camera.translation.vector);
    for p in 0..pixels {
        let ray =
            world_from_camera.rotation * CAMERA.ray_at((p % CAMERA.width) as f64, (p / CAMERA.width) as f64);
        let floor = (ray.z < 0.0).then(|| -origin.z / ray.z).filter(|d| *d < 5.0);
        let hits = boxes(state).map(|b| hit(&origin, &ray, &b));
        let object = hits.into_iter().flatten().fold(f64::INFINITY, f64::min);
        let depth = floor.unwrap_or(f64::INFINITY).min(object);
        if depth.is_finite() {
            let q = origin + ray * depth;
            let wave = |k: f64| (127.0 + 100.0 * (40.0 * (q.x + k * q.y + 0.7 * q.z)).sin()) as u8;
            view.rgb[p] = [wave(0.3), wave(-0.8), if object <= depth { 200 } else { 40 }];
            view.depth_mm[p] = (depth * 1000.0).round() as u16;
            view.mask[p] = object <= depth;
        }
    }
    view
}

fn hit(origin: &Point3<f64>, ray: &Vector3<f64>, [lower, upper]: &[Point3<f64>; 2]) -> Option<f64> {
    let (mut near, mut far) = (0.0f64, f64::INFINITY);
    for k in 0..3 {
        let (a, b) = ((lower[k] - origin[k]) / ray[k], (upper[k] - origin[k]) / ray[k]);
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    (near <= far && near > 0.0).then_some(near)
}

#[derive(Clone, Copy, PartialEq, Debug)]
pub enum ColorKind {
    None,
    Rgb8,
    Bgra8Padded,
    Rgb16,
    Jpeg,
    Png,
}

#[derive(Clone, Copy, PartialEq, Debug)]
pub enum DepthKind {
    None,
    Raw16,
    Raw16BigEndian,
    RawFloat,
    CompressedPng,
    CompressedRvl,
    /// All zero.
    Empty,
}

#[derive(Clone, Copy, PartialEq, Debug)]
pub enum PoseKind {
    None,
    /// /tf beside the image stamps, /tf_static for the optical frame.
    Tf,
    /// Stops in the middle.
    TfHalf,
    TfNan,
    /// Only /tf_static.
    Static,
    PoseStamped,
    /// Of camera_link.
    Odometry,
}

/// How a recording is written.
#[derive(Clone)]
pub struct Options {
    pub color: ColorKind,
    pub depth: DepthKind,
    pub poses: PoseKind,
    pub info: bool,
    pub depth_info: bool,
    pub mask: bool,
    pub compression: Option<mcap::Compression>,
    pub chunk_bytes: u64,
    pub distortion: (&'static str, Vec<f64>),
    /// Added to the stamps of depth, nanoseconds.
    pub depth_delay: i64,
    /// From this image on the size is halved.
    pub shrink_from: usize,
    /// Width that the depth camera_info claims.
    pub depth_info_width: u32,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            color: ColorKind::Rgb8,
            depth: DepthKind::Raw16,
            poses: PoseKind::Tf,
            info: true,
            depth_info: true,
            mask: true,
            compression: Some(mcap::Compression::Zstd),
            chunk_bytes: 100_000,
            distortion: ("plumb_bob", vec![0.0; 5]),
            depth_delay: 300_000,
            shrink_from: usize::MAX,
            depth_info_width: CAMERA.width as u32,
        }
    }
}

/// Writes messages into an MCAP file.
pub struct BagWriter {
    writer: mcap::Writer<BufWriter<File>>,
    channels: BTreeMap<String, u16>,
    pub count: usize,
}

impl BagWriter {
    /// `chunk_bytes` 0: no chunks, hence no checksums.
    pub fn create(path: &Path, compression: Option<mcap::Compression>, chunk_bytes: u64) -> Self {
        let options = mcap::WriteOptions::new()
            .profile("ros2")
            .compression(compression)
            .chunk_size(Some(chunk_bytes))
            .use_chunks(chunk_bytes > 0);
        let writer = options.create(BufWriter::new(File::create(path).unwrap())).unwrap();
        Self { writer, channels: BTreeMap::new(), count: 0 }
    }

    /// Writes a message of ROS 2; `type_name` like `sensor_msgs/msg/Image`.
    pub fn message(&mut self, topic: &str, type_name: &str, log_nanos: i64, message: &impl Serialize) {
        self.bytes(topic, type_name, "cdr", log_nanos, &encode(message).unwrap());
    }

    /// Writes any payload.
    pub fn bytes(&mut self, topic: &str, type_name: &str, encoding: &str, log_nanos: i64, data: &[u8]) {
        let writer = &mut self.writer;
        let channel_id = *self.channels.entry(topic.to_owned()).or_insert_with(|| {
            let schema = writer.add_schema(type_name, "ros2msg", b"").unwrap();
            writer.add_channel(schema, topic, encoding, &BTreeMap::new()).unwrap()
        });
        let time = log_nanos as u64;
        let header =
            mcap::records::MessageHeader { channel_id, sequence: 0, log_time: time, publish_time: time };
        self.writer.write_to_known_channel(&header, data).unwrap();
        self.count += 1;
    }

    pub fn finish(mut self) {
        self.writer.finish().unwrap();
    }
}

/// Writes a `metadata.yaml` that names the files.
pub fn write_metadata(folder: &Path, files: &[&str], compression_mode: &str) {
    let list: String = files.iter().map(|f| format!("    - {f}\n")).collect();
    let format = if compression_mode.is_empty() { "" } else { "zstd" };
    let text = format!(
        "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n  compression_format: \
         '{format}'\n  \
         compression_mode: '{compression_mode}'\n  relative_file_paths:\n{list}"
    );
    std::fs::write(folder.join("metadata.yaml"), text).unwrap();
}

/// Writes a rosbag2 folder of one state.
pub fn write_state(folder: &Path, state: usize, options: &Options) {
    std::fs::create_dir_all(folder).unwrap();
    let name = format!("{}.mcap", folder.file_name().unwrap().to_string_lossy());
    let mut writer = BagWriter::create(&folder.join(&name), options.compression, options.chunk_bytes);
    add_state(&mut writer, state, START, options);
    writer.finish();
    write_metadata(folder, &[&name], "");
}

/// Writes a folder with `state0` and `state1`.
pub fn write_states(folder: &Path, options: &Options) {
    for state in 0..2 {
        write_state(&folder.join(format!("state{state}")), state, options);
    }
}

/// Adds the messages of a state that begins at a stamp.
pub fn add_state(writer: &mut BagWriter, state: usize, start: i64, options: &Options) {
    add_static(writer, start, options);
    for i in 0..COUNT {
        let view = render(state, i);
        let stamp = start + i as i64 * PERIOD;
        add_poses(writer, state, i, stamp, options);
        if options.info {
            writer.message(
                COLOR_INFO,
                "sensor_msgs/msg/CameraInfo",
                stamp,
                &info(stamp, options, CAMERA.width as u32),
            );
        }
        if options.depth_info {
            let late = stamp + options.depth_delay;
            writer.message(
                DEPTH_INFO,
                "sensor_msgs/msg/CameraInfo",
                stamp,
                &info(late, options, options.depth_info_width),
            );
        }
        add_color(writer, &view, stamp, options, i >= options.shrink_from);
        add_depth(writer, &view, stamp + options.depth_delay, stamp, options);
        if options.mask {
            let data = view.mask.iter().map(|m| u8::from(*m) * 255).collect();
            writer.message(
                MASK,
                "sensor_msgs/msg/Image",
                stamp,
                &raw(stamp + 600_000, "mono8", CAMERA.width, CAMERA.height, 1, data),
            );
        }
    }
}

pub fn header(stamp: i64, frame: &str) -> Header {
    Header { stamp: Time::from_nanos(stamp), frame_id: frame.into() }
}

pub fn info(stamp: i64, options: &Options, width: u32) -> CameraInfo {
    let k = CAMERA;
    CameraInfo {
        header: header(stamp, OPTICAL),
        height: k.height as u32,
        width,
        distortion_model: options.distortion.0.into(),
        d: options.distortion.1.clone(),
        k: [k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0],
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: [k.fx, 0.0, k.cx, 0.0, 0.0, k.fy, k.cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        ..CameraInfo::default()
    }
}

fn raw(stamp: i64, encoding: &str, width: usize, height: usize, bytes: usize, data: Vec<u8>) -> Image {
    let step = (data.len() / height).max(width * bytes) as u32;
    Image {
        header: header(stamp, OPTICAL),
        height: height as u32,
        width: width as u32,
        encoding: encoding.into(),
        is_bigendian: 0,
        step,
        data,
    }
}

fn compressed(stamp: i64, format: &str, data: Vec<u8>) -> CompressedImage {
    CompressedImage { header: header(stamp, OPTICAL), format: format.into(), data }
}

/// The optical frame in camera_link (REP-103).
pub fn link_from_optical() -> Pose {
    Pose::from_parts(
        Vector3::new(0.0, 0.015, 0.0).into(),
        UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(0.5, -0.5, 0.5, -0.5)),
    )
}

fn transform(stamp: i64, parent: &str, child: &str, pose: &Pose) -> TfMessage {
    let transform = Transform::from_pose(pose);
    TfMessage {
        transforms: vec![TransformStamped {
            header: header(stamp, parent),
            child_frame_id: child.into(),
            transform,
        }],
    }
}

fn add_static(writer: &mut BagWriter, start: i64, options: &Options) {
    if options.poses != PoseKind::None {
        let message = transform(start, "camera_link", OPTICAL, &link_from_optical());
        writer.message("/tf_static", "tf2_msgs/msg/TFMessage", start - PERIOD / 2, &message);
    }
}

fn add_poses(writer: &mut BagWriter, state: usize, i: usize, stamp: i64, options: &Options) {
    // Beside the stamp on either side, so that the pose at the stamp needs interpolation.
    for offset in [-1_000_000i64, 1_000_000] {
        let optical = camera_pose(state, i as f64 + offset as f64 / PERIOD as f64);
        let link = optical * link_from_optical().inverse();
        let (at, type_tf) = (stamp + offset, "tf2_msgs/msg/TFMessage");
        match options.poses {
            PoseKind::None | PoseKind::Static => {}
            PoseKind::TfHalf if i >= COUNT / 2 => {}
            PoseKind::Tf | PoseKind::TfHalf => {
                writer.message("/tf", type_tf, at, &transform(at, "world", "camera_link", &link))
            }
            PoseKind::TfNan => {
                let mut message = transform(at, "world", "camera_link", &link);
                message.transforms[0].transform.translation.x = f64::NAN;
                writer.message("/tf", type_tf, at, &message);
            }
            PoseKind::PoseStamped => {
                let message =
                    PoseStamped { header: header(at, "world"), pose: Transform::from_pose(&optical) };
                writer.message("/camera_pose", "geometry_msgs/msg/PoseStamped", at, &message);
            }
            PoseKind::Odometry => {
                let message = Odometry {
                    header: header(at, "world"),
                    child_frame_id: "camera_link".into(),
                    pose: Transform::from_pose(&link),
                };
                writer.message("/odom", "nav_msgs/msg/Odometry", at, &message);
            }
        }
    }
}

fn file(image: DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

pub fn rgb_image(view: &Rendered) -> DynamicImage {
    let data = view.rgb.iter().flatten().copied().collect();
    DynamicImage::ImageRgb8(ImageBuffer::from_raw(CAMERA.width as u32, CAMERA.height as u32, data).unwrap())
}

pub fn depth_png(view: &Rendered) -> Vec<u8> {
    let image =
        ImageBuffer::from_raw(CAMERA.width as u32, CAMERA.height as u32, view.depth_mm.clone()).unwrap();
    file(DynamicImage::ImageLuma16(image), ImageFormat::Png)
}

fn add_color(writer: &mut BagWriter, view: &Rendered, stamp: i64, options: &Options, shrink: bool) {
    let (w, h) = (CAMERA.width, CAMERA.height);
    let bytes = || view.rgb.iter().flatten().copied().collect::<Vec<u8>>();
    let (image, jpeg) = ("sensor_msgs/msg/Image", format!("{COLOR}/compressed"));
    match options.color {
        ColorKind::None => {}
        ColorKind::Rgb8 if shrink => {
            let half = bytes().into_iter().take(w * h / 4 * 3).collect();
            writer.message(COLOR, image, stamp, &raw(stamp, "rgb8", w / 2, h / 2, 3, half));
        }
        ColorKind::Rgb8 => writer.message(COLOR, image, stamp, &raw(stamp, "rgb8", w, h, 3, bytes())),
        ColorKind::Bgra8Padded => {
            let row = |row: &[[u8; 3]]| {
                row.iter().flat_map(|p| [p[2], p[1], p[0], 9]).chain([77; 12]).collect::<Vec<_>>()
            };
            let data = view.rgb.chunks(w).flat_map(row).collect();
            writer.message(COLOR, image, stamp, &raw(stamp, "bgra8", w, h, 4, data));
        }
        ColorKind::Rgb16 => {
            writer.message(COLOR, image, stamp, &raw(stamp, "rgb16", w, h, 6, vec![0; w * h * 6]))
        }
        ColorKind::Jpeg | ColorKind::Png => {
            let (format, name) = if options.color == ColorKind::Jpeg {
                (ImageFormat::Jpeg, "rgb8; jpeg compressed bgr8")
            } else {
                (ImageFormat::Png, "png")
            };
            let mut picture = rgb_image(view);
            if shrink {
                picture = picture.crop_imm(0, 0, w as u32 / 2, h as u32 / 2);
            }
            writer.message(
                &jpeg,
                "sensor_msgs/msg/CompressedImage",
                stamp,
                &compressed(stamp, name, file(picture, format)),
            );
        }
    }
}

fn add_depth(writer: &mut BagWriter, view: &Rendered, stamp: i64, log: i64, options: &Options) {
    let (w, h) = (CAMERA.width, CAMERA.height);
    let image = "sensor_msgs/msg/Image";
    let little = |values: &[u16]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let topic = format!("{DEPTH}/compressedDepth");
    let front = [0u8; 12];
    match options.depth {
        DepthKind::None => {}
        DepthKind::Raw16 => {
            writer.message(DEPTH, image, log, &raw(stamp, "16UC1", w, h, 2, little(&view.depth_mm)))
        }
        DepthKind::Empty => {
            writer.message(DEPTH, image, log, &raw(stamp, "16UC1", w, h, 2, vec![0; w * h * 2]))
        }
        DepthKind::Raw16BigEndian => {
            let mut message =
                raw(stamp, "mono16", w, h, 2, view.depth_mm.iter().flat_map(|v| v.to_be_bytes()).collect());
            message.is_bigendian = 1;
            writer.message(DEPTH, image, log, &message);
        }
        DepthKind::RawFloat => {
            let meters = |v: &u16| if *v == 0 { f32::NAN } else { f32::from(*v) / 1000.0 };
            let data = view.depth_mm.iter().flat_map(|v| meters(v).to_le_bytes()).collect();
            writer.message(DEPTH, image, log, &raw(stamp, "32FC1", w, h, 4, data));
        }
        DepthKind::CompressedPng => {
            let data = [&front[..], &depth_png(view)].concat();
            writer.message(
                &topic,
                "sensor_msgs/msg/CompressedImage",
                log,
                &compressed(stamp, "16UC1; compressedDepth png", data),
            );
        }
        DepthKind::CompressedRvl => {
            let code = rvl::encode(&view.depth_mm);
            let data = [&front[..], &(w as u32).to_le_bytes(), &(h as u32).to_le_bytes(), &code].concat();
            writer.message(
                &topic,
                "sensor_msgs/msg/CompressedImage",
                log,
                &compressed(stamp, "16UC1; compressedDepth rvl", data),
            );
        }
    }
}

/// Writes the keyframe dataset layout (docs/method.md 2.1).
pub fn write_keyframes(folder: &Path) {
    use std::fmt::Write as _;
    for part in ["color_segmented", "depth_filtered", "mask"] {
        std::fs::create_dir_all(folder.join(part)).unwrap();
    }
    let k = CAMERA;
    std::fs::write(folder.join("cam_K.txt"), format!("{} 0 {}\n0 {} {}\n0 0 1\n", k.fx, k.cx, k.fy, k.cy))
        .unwrap();
    let mut yaml = String::new();
    for (state, i) in (0..2).flat_map(|s| (0..COUNT).map(move |i| (s, i))) {
        let (view, id) = (render(state, i), format!("{state}_{i:04}"));
        rgb_image(&view).save(folder.join(format!("color_segmented/{id}.png"))).unwrap();
        std::fs::write(folder.join(format!("depth_filtered/{id}.png")), depth_png(&view)).unwrap();
        let mask = view.mask.iter().map(|m| u8::from(*m) * 255).collect();
        image::GrayImage::from_raw(k.width as u32, k.height as u32, mask)
            .unwrap()
            .save(folder.join(format!("mask/{id}.png")))
            .unwrap();
        let numbers: Vec<String> = opengl(&view.world_from_camera).iter().map(f64::to_string).collect();
        write!(yaml, "frame_{id}:\n  cam_in_ob: [{}]\n  time: {state}\n", numbers.join(", ")).unwrap();
    }
    std::fs::write(folder.join("init_keyframes.yml"), yaml).unwrap();
}

/// Row-major camera-to-world matrix in OpenGL axes.
pub fn opengl(world_from_camera: &Pose) -> Vec<f64> {
    let flip = nalgebra::Matrix4::from_diagonal(&nalgebra::Vector4::new(1.0, -1.0, -1.0, 1.0));
    (world_from_camera.to_homogeneous() * flip).transpose().iter().copied().collect()
}

/// Writes the start/end dataset layout (docs/method.md 2.1), with depth if asked for.
pub fn write_start_end(folder: &Path, with_depth: bool) {
    for (state, name) in ["start", "end"].iter().enumerate() {
        let part = folder.join(name);
        std::fs::create_dir_all(part.join("train")).unwrap();
        let k = CAMERA;
        let mut cameras = serde_json::Map::new();
        // Pixel centers at half integers.
        cameras.insert(
            "K".into(),
            serde_json::json!([[k.fx, 0.0, k.cx + 0.5], [0.0, k.fy, k.cy + 0.5], [0.0, 0.0, 1.0]]),
        );
        for i in 0..COUNT {
            let view = render(state, i);
            let m = opengl(&view.world_from_camera);
            cameras.insert(format!("{i:04}"), serde_json::json!(m.chunks(4).collect::<Vec<_>>()));
            let data = view
                .rgb
                .iter()
                .zip(&view.mask)
                .flat_map(|(c, m)| [c[0], c[1], c[2], u8::from(*m) * 255])
                .collect();
            let picture = image::RgbaImage::from_raw(k.width as u32, k.height as u32, data).unwrap();
            picture.save(part.join(format!("train/{i:04}.png"))).unwrap();
            if with_depth {
                std::fs::create_dir_all(part.join("depth")).unwrap();
                std::fs::write(part.join(format!("depth/{i:04}.png")), depth_png(&view)).unwrap();
            }
        }
        std::fs::write(part.join("camera_train.json"), serde_json::to_string(&cameras).unwrap()).unwrap();
    }
}
