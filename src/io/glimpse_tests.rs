//! What a glimpse says is what the bag holds, however it was written; damage makes it say less.

use std::{collections::BTreeMap, fs, io::Cursor};

use proptest::prelude::*;

use super::*;
use crate::ros2msg::{Header, Image, Time, encode};

/// What the bags of these tests hold, in turn.
const TOPICS: [(&str, &str, &str); 5] = [
    ("/camera/color/image_raw", "sensor_msgs/msg/Image", "rgb8"),
    ("/camera/depth/image_raw", "sensor_msgs/msg/Image", "16UC1"),
    ("/camera/color/camera_info", INFO_TYPE, ""),
    ("/points", "sensor_msgs/msg/PointCloud2", ""),
    ("/joint_states", "sensor_msgs/msg/JointState", ""),
];
const ROUNDS: usize = 12;

fn payload(topic: usize, i: usize) -> Vec<u8> {
    let (_, kind, encoding) = TOPICS[topic];
    let header = Header { stamp: Time { sec: i as i32, nanosec: 0 }, frame_id: "camera".into() };
    match kind {
        "sensor_msgs/msg/Image" => encode(&Image {
            header,
            height: 3,
            width: 40,
            encoding: encoding.into(),
            is_bigendian: 0,
            step: 120,
            data: vec![i as u8; 360],
        })
        .unwrap(),
        INFO_TYPE => encode(&CameraInfo { header, width: 40, height: 3, ..CameraInfo::default() }).unwrap(),
        _ => vec![i as u8; 500],
    }
}

/// A file with chunks of so many bytes.
fn file(compression: Option<mcap::Compression>, chunk_bytes: u64, has_summary: bool) -> Vec<u8> {
    let mut buffer = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new()
        .compression(compression)
        .chunk_size(Some(chunk_bytes))
        .emit_summary_records(has_summary)
        .profile("ros2");
    let mut writer = options.create(&mut buffer).unwrap();
    let mut channels = Vec::new();
    for (topic, kind, _) in TOPICS {
        let schema = writer.add_schema(kind, "ros2msg", b"").unwrap();
        channels.push(writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap());
    }
    for i in 0..ROUNDS * TOPICS.len() {
        let topic = i % TOPICS.len();
        let header = mcap::records::MessageHeader {
            channel_id: channels[topic],
            sequence: i as u32,
            log_time: i as u64,
            publish_time: 0,
        };
        writer.write_to_known_channel(&header, &payload(topic, i)).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    buffer.into_inner()
}

/// What a glimpse says of a file: views, and messages about joints.
fn seen(bytes: &[u8]) -> (Vec<Glimpse>, u64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("box.mcap");
    fs::write(&path, bytes).unwrap();
    let views = glimpse_views(std::slice::from_ref(&path), &CaptureConfig::default()).unwrap_or_default();
    (views, count_joint_messages(&path, &Streams::default()).unwrap_or_default())
}

const WHOLE: Glimpse = Glimpse { frames: Some(ROUNDS as u64), size: Some((40, 3)) };

#[test]
fn views_and_joints_are_counted() {
    for compression in [None, Some(mcap::Compression::Zstd), Some(mcap::Compression::Lz4)] {
        for chunk_bytes in [300, 3000, 1 << 20] {
            assert_eq!(seen(&file(compression, chunk_bytes, true)), (vec![WHOLE], ROUNDS as u64));
            assert_eq!(seen(&file(compression, chunk_bytes, false)), (vec![Glimpse::default()], 0));
        }
    }
}

#[test]
fn the_ends_of_a_file_suffice() {
    let whole = file(None, 3000, true);
    let mut ends = whole.clone();
    // The second chunk and all behind it up to the summary.
    ends[9000..whole.len() - 6000].fill(0);
    assert_eq!(seen(&ends), seen(&whole));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn damage_makes_it_say_less_or_nothing(place in 0.0..1.0f64, flip in 1..256usize, cut in any::<bool>()) {
        let mut bytes = file(Some(mcap::Compression::Lz4), 3000, true);
        let at = (place * bytes.len() as f64) as usize;
        if cut {
            bytes.truncate(at);
        } else {
            bytes[at] ^= flip as u8;
        }
        let (views, joints) = seen(&bytes);
        prop_assert!(views.len() <= 1 && joints <= ROUNDS as u64);
        // A damaged chunk may give another size, never another count.
        prop_assert!(views.iter().all(|v| v.frames.is_none_or(|n| n == ROUNDS as u64)));
    }
}
