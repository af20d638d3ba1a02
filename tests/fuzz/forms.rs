//! Other forms of recordings: bags of ROS 1, folders of images.

use gap::record::tracks::Streams;
use image::ImageFormat;
use io::{inspect, read_joint_log};

use super::{
    engine::{BYTES, Scratch, Target, plain, whole},
    recorded::picture_of,
};

/// Size of the images: they are read with every input.
const SMALL: (u32, u32) = (4, 3);
const DEFINITION: &str = "Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n\
    float64[] effort\n\
    ===\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";

fn field(name: &str, value: &[u8]) -> Vec<u8> {
    [&((name.len() + 1 + value.len()) as u32).to_le_bytes()[..], name.as_bytes(), b"=", value].concat()
}

fn counted(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

fn record(header: &[Vec<u8>], data: &[u8]) -> Vec<u8> {
    [counted(&header.concat()), counted(data)].concat()
}

/// Records of a ROS 1 bag: a connection, and joint states.
fn ros1_records() -> Vec<Vec<u8>> {
    let data = [
        field("topic", b"/joint_states"),
        field("type", b"sensor_msgs/JointState"),
        field("message_definition", DEFINITION.as_bytes()),
    ];
    let header = [field("op", &[7]), field("conn", &[0; 4]), field("topic", b"/joint_states")];
    let mut records = vec![record(&header, &data.concat())];
    for i in 1..20u32 {
        let stamp = [i, 0].map(u32::to_le_bytes).concat();
        let body = [
            [i, i, 0].map(u32::to_le_bytes).concat(),
            counted(b"base"),
            1u32.to_le_bytes().to_vec(),
            counted(b"hinge"),
            1u32.to_le_bytes().to_vec(),
            f64::from(i).to_le_bytes().to_vec(),
            vec![0; 8],
        ];
        let header = [field("op", &[2]), field("conn", &[0; 4]), field("time", &stamp)];
        records.push(record(&header, &body.concat()));
    }
    records
}

fn ros1_bag(records: &[Vec<u8>]) -> Vec<u8> {
    let content = records.concat();
    let front = record(&[field("op", &[3]), field("index_pos", &[0; 8])], &[]);
    let size = (content.len() as u32).to_le_bytes();
    let chunk = record(&[field("op", &[5]), field("compression", b"none"), field("size", &size)], &content);
    [&b"#ROSBAG V2.0\n"[..], &front, &chunk].concat()
}

const WORDS: [&str; 8] = ["op=", "conn=", "bz2", "lz4", "uint8[] x\n", "Header h\n", "string", "index_pos="];

fn has_joints(path: &std::path::Path) -> bool {
    read_joint_log(path, &Streams::default())
        .is_ok_and(|run| run.joints.iter().all(|j| j.position.len() == j.time_s.len()))
}

/// Bytes of a file: lengths, headers, definitions.
#[test]
fn ros1_bytes() {
    let name = "forms::ros1_bytes";
    let scratch = Scratch::new(name);
    let seeds = whole([ros1_bag(&ros1_records())]);
    let target = Target { name, seeds, words: &WORDS, assemble: plain, bytes: BYTES };
    target.run(|input| has_joints(&scratch.put("run.bag", input)));
}

/// Records in a whole chunk.
#[test]
fn ros1_messages() {
    let name = "forms::ros1_messages";
    let scratch = Scratch::new(name);
    let seeds = vec![ros1_records()];
    let target = Target { name, seeds, words: &WORDS, assemble: ros1_bag, bytes: BYTES };
    target.run(|input| has_joints(&scratch.put("run.bag", input)));
}

/// A folder with a color and a depth image.
fn folder(name: &str) -> Scratch {
    let scratch = Scratch::new(name);
    scratch.put("rgb/0.png", picture_of(SMALL, ImageFormat::Png, false));
    scratch.put("depth/0.png", picture_of(SMALL, ImageFormat::Png, true));
    scratch
}

fn opens(scratch: &Scratch) -> bool {
    inspect(&scratch.0).is_ok_and(|found| found.recordings.iter().any(|r| r.views > 0))
}

/// `transforms.json`.
#[test]
fn transforms() {
    let name = "forms::transforms";
    let scratch = folder(name);
    let text = r#"{"w": 4, "h": 3, "fl_x": 5.0, "cx": 2.0, "cy": 1.5, "applied_scale": 1.0, "frames": [
        {"file_path": "rgb/0.png", "depth_file_path": "depth/0.png",
        "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,1],[0,0,0,1]]}]}"#;
    let words = ["1e300", "-1", "\"k1\": ", "../", "null", "[", "{", "OPENCV_FISHEYE", "camera_angle_x"];
    let target = Target { name, seeds: whole([text]), words: &words, assemble: plain, bytes: BYTES };
    target.run(|input| {
        scratch.put("transforms.json", input);
        opens(&scratch)
    });
}

/// `rgb.txt`, which stands for all lists of numbers and names.
#[test]
fn lists() {
    let name = "forms::lists";
    let scratch = folder(name);
    scratch.put("depth.txt", "1.0 depth/0.png\n");
    scratch.put("cam_K.txt", "5 0 2 0 5 1 0 0 1");
    let words = ["../", "/", "#", "\n", "1e300", "nan", ","];
    let target =
        Target { name, seeds: whole(["1.0 rgb/0.png\n# x\n"]), words: &words, assemble: plain, bytes: BYTES };
    target.run(|input| {
        scratch.put("rgb.txt", input);
        opens(&scratch)
    });
}
