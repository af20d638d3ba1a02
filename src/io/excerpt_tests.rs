//! An excerpt gives the messages of the needed topics as the whole does, however the file was written and
//! wherever it is damaged.

use std::{collections::BTreeMap, convert::Infallible, io::Cursor};

use proptest::prelude::*;

use super::*;
use crate::io::{
    is_whole_mcap,
    ros2msg::{CameraInfo, Header, Image, Time, encode},
};

/// What the bags of these tests hold, in the order of their channels.
const TOPICS: [(&str, &str, &str); 7] = [
    ("/camera/color/image_raw", "sensor_msgs/msg/Image", "rgb8"),
    ("/camera/depth/image_raw", "sensor_msgs/msg/Image", "16UC1"),
    ("/camera/color/camera_info", INFO_TYPE, ""),
    ("/tf", "tf2_msgs/msg/TFMessage", ""),
    ("/camera/infra/image_raw", "sensor_msgs/msg/Image", "mono8"),
    ("/points", "sensor_msgs/msg/PointCloud2", ""),
    ("/joint_states", "sensor_msgs/msg/JointState", ""),
];
/// Nanoseconds; messages come one a second.
const SECOND: u64 = 1_000_000_000;
const NEEDED: [&str; 4] = [TOPICS[0].0, TOPICS[1].0, TOPICS[2].0, TOPICS[3].0];

struct Bytes(Vec<u8>);

impl Ranges for Bytes {
    fn size(&self) -> u64 {
        self.0.len() as u64
    }

    fn range(&self, start: u64, count: u64) -> io::Result<Vec<u8>> {
        let range = start as usize..(start + count) as usize;
        self.0.get(range).map(<[u8]>::to_vec).ok_or_else(|| io::ErrorKind::UnexpectedEof.into())
    }
}

/// How a file is written.
#[derive(Clone, Copy, Debug)]
struct Writing {
    compression: u8,
    chunk_bytes: u64,
    has_summary: bool,
    has_message_indexes: bool,
    has_summary_crc: bool,
    has_chunk_crcs: bool,
}

fn noise(i: usize, count: usize) -> Vec<u8> {
    (0..count as u32).map(|k| (k.wrapping_mul(2_654_435_761).wrapping_add(i as u32) >> 13) as u8).collect()
}

fn payload(topic: usize, i: usize, bytes: usize) -> Vec<u8> {
    let (_, kind, encoding) = TOPICS[topic];
    let header = Header { stamp: Time { sec: i as i32, nanosec: 0 }, frame_id: "camera".into() };
    match kind {
        "sensor_msgs/msg/Image" => {
            let data = noise(i, bytes);
            encode(&Image {
                header,
                height: 1,
                width: bytes as u32,
                encoding: encoding.into(),
                is_bigendian: 0,
                step: bytes as u32,
                data,
            })
            .unwrap()
        }
        INFO_TYPE => encode(&CameraInfo { header, width: 4, height: 3, ..CameraInfo::default() }).unwrap(),
        _ => noise(i, bytes),
    }
}

fn file(messages: &[(usize, usize)], writing: Writing) -> Vec<u8> {
    let mut buffer = Cursor::new(Vec::new());
    let compression =
        [None, Some(mcap::Compression::Zstd), Some(mcap::Compression::Lz4)][usize::from(writing.compression)];
    let options = mcap::WriteOptions::new()
        .compression(compression)
        .chunk_size(Some(writing.chunk_bytes))
        .emit_summary_records(writing.has_summary)
        .emit_message_indexes(writing.has_message_indexes)
        .calculate_summary_section_crc(writing.has_summary_crc)
        .calculate_chunk_crcs(writing.has_chunk_crcs)
        .profile("ros2");
    let mut writer = options.create(&mut buffer).unwrap();
    let mut channels = Vec::new();
    for (topic, kind, _) in TOPICS {
        let schema = writer.add_schema(kind, "ros2msg", b"").unwrap();
        channels.push(writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap());
    }
    for (i, &(topic, bytes)) in messages.iter().enumerate() {
        let header = mcap::records::MessageHeader {
            channel_id: channels[topic],
            sequence: i as u32,
            log_time: SECOND * (1000 + i as u64),
            publish_time: 0,
        };
        writer.write_to_known_channel(&header, &payload(topic, i, bytes)).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    buffer.into_inner()
}

/// The excerpt of a file, as bytes.
fn excerpted(bytes: &[u8], config: &CaptureConfig) -> Vec<u8> {
    let source = Bytes(bytes.to_vec());
    let plans = excerpts(&[Remembered::of(&source)], Wanted::Views(config)).unwrap();
    let piece = |p: &Piece| match p {
        Piece::Stored(range) => bytes[range.start as usize..range.end as usize].to_vec(),
        Piece::Made(made) => made.clone(),
    };
    let part: Vec<u8> = plans[0].iter().flat_map(piece).collect();
    // As a fetch does where an index leads elsewhere than to its messages.
    let is_excerpt = plans[0].len() > 1;
    if is_excerpt && !is_whole_mcap(&part[..]).unwrap() { bytes.to_vec() } else { part }
}

/// Messages of the needed topics, and whether reading ended before its end.
fn messages(bytes: &[u8]) -> (Vec<(String, u64, Vec<u8>)>, bool) {
    let mut source = Cursor::new(bytes);
    let mut channels = crate::io::mcap_file::summary_channels(&mut source).unwrap();
    let mut found = Vec::new();
    let mut expansion = Expansion::of(bytes.len() as u64);
    let report = read_messages::<_, Infallible>(source, &mut channels, &mut expansion, &mut |m| {
        if NEEDED.contains(&m.topic) {
            found.push((m.topic.to_owned(), m.log_time_nanos, m.data.to_vec()));
        }
        Ok(())
    });
    (found, report.unwrap().stopped.is_some())
}

fn any_writing() -> impl Strategy<Value = Writing> {
    (0..3u8, 200..6000u64, any::<bool>(), any::<bool>(), any::<bool>(), any::<bool>()).prop_map(|w| Writing {
        compression: w.0,
        chunk_bytes: w.1,
        has_summary: w.2,
        has_message_indexes: w.3,
        has_summary_crc: w.4,
        has_chunk_crcs: w.5,
    })
}

fn any_messages() -> impl Strategy<Value = Vec<(usize, usize)>> {
    proptest::collection::vec((0..TOPICS.len(), 1..1500usize), 0..60)
}

const WRITING: Writing = Writing {
    compression: 0,
    chunk_bytes: 1000,
    has_summary: true,
    has_message_indexes: true,
    has_summary_crc: true,
    has_chunk_crcs: true,
};

/// Messages in turn, and large ones of topics that nobody needs.
fn in_turn(count: usize) -> Vec<(usize, usize)> {
    (0..count).map(|i| (i % TOPICS.len(), if i % TOPICS.len() > 3 { 4000 } else { 1200 })).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn the_needed_messages_are_those_of_the_whole(list in any_messages(), writing in any_writing()) {
        let whole = file(&list, writing);
        let part = excerpted(&whole, &CaptureConfig::default());
        prop_assert!(part.len() <= whole.len());
        prop_assert_eq!(messages(&part), messages(&whole));
    }

    #[test]
    fn damage_anywhere_costs_no_more_than_in_the_whole(
        list in any_messages(),
        writing in any_writing(),
        place in 0.0..1.0f64,
        flip in 1..256usize,
        cut in any::<bool>()
    ) {
        let mut bytes = file(&list, Writing { has_summary: true, has_summary_crc: true, ..writing });
        let at = (place * bytes.len() as f64) as usize;
        if cut {
            bytes.truncate(at);
        } else {
            bytes[at] ^= flip as u8;
        }
        let part = excerpted(&bytes, &CaptureConfig::default());
        let (found, _) = messages(&part);
        let (expected, _) = messages(&bytes);
        // A length that is damaged between chunks ends the reading of the whole, not that of the excerpt.
        let is_start = found.iter().take(expected.len()).eq(expected.iter());
        prop_assert!(is_start && found.len() >= expected.len(), "{} of {}", found.len(), expected.len());
    }
}

#[test]
fn chunks_of_other_topics_are_left_out() {
    for compression in 0..3 {
        let whole = file(&in_turn(70), Writing { compression, ..WRITING });
        let part = excerpted(&whole, &CaptureConfig::default());
        // Of 10 rounds 12,000 of 16,800 bytes are of three topics that are not read.
        assert!(part.len() < whole.len() / 2, "{} of {}", part.len(), whole.len());
        assert_eq!(messages(&part), messages(&whole));
        assert_eq!(messages(&part).0.len(), 40);
    }
}

#[test]
fn of_a_chunk_without_compression_and_checksum_single_messages_are_taken() {
    // All topics in each chunk.
    let list: Vec<_> = in_turn(70);
    let writing = Writing { chunk_bytes: 60_000, has_chunk_crcs: false, ..WRITING };
    let whole = file(&list, writing);
    let part = excerpted(&whole, &CaptureConfig::default());
    assert!(part.len() < whole.len() / 2, "{} of {}", part.len(), whole.len());
    assert_eq!(messages(&part), messages(&whole));
    // A checksum is of the whole chunk.
    let checked = file(&list, Writing { has_chunk_crcs: true, ..writing });
    assert_eq!(excerpted(&checked, &CaptureConfig::default()), checked);
}

#[test]
fn a_split_is_counted_from_the_first_message_of_all() {
    let mut list = in_turn(70);
    list.insert(0, (5, 4000));
    list.push((5, 4000));
    let whole = file(&list, WRITING);
    let first = |bytes: &[u8]| {
        let mut times = Vec::new();
        let (mut expansion, mut source) = (Expansion::of(bytes.len() as u64), Cursor::new(bytes));
        let mut channels = crate::io::mcap_file::summary_channels(&mut source).unwrap();
        read_messages::<_, Infallible>(source, &mut channels, &mut expansion, &mut |m| {
            times.push(m.log_time_nanos);
            Ok(())
        })
        .unwrap();
        (times[0], times[times.len() - 1])
    };
    let split = CaptureConfig { split_secs: vec![1.0], ..CaptureConfig::default() };
    assert_eq!(first(&excerpted(&whole, &split)), first(&whole));
    assert!(first(&excerpted(&whole, &CaptureConfig::default())).0 > 1000 * SECOND);
    assert!(excerpted(&whole, &split).len() < whole.len() / 2);
}

#[test]
fn images_between_two_states_are_left_out() {
    let whole = file(&in_turn(140), WRITING);
    let config = CaptureConfig { split_secs: vec![20.0, 120.0], ..CaptureConfig::default() };
    let part = excerpted(&whole, &config);
    // Of 4,000 bytes of a round 2,400 are images, and of 140 s 98 lie between.
    assert!(part.len() * 10 < excerpted(&whole, &CaptureConfig::default()).len() * 7);
    let kept = |bytes: &[u8]| {
        let is_kept = |(topic, nanos, _): &(String, u64, Vec<u8>)| {
            let seconds = nanos / SECOND - 1000;
            !topic.contains("image") || seconds <= 20 || seconds >= 120
        };
        messages(bytes).0.into_iter().filter(is_kept).collect::<Vec<_>>()
    };
    assert_eq!(kept(&part), kept(&whole));
}

#[test]
fn what_cannot_be_chosen_is_read_whole() {
    let whole = file(&in_turn(70), WRITING);
    let excerpt_of = |wanted: Wanted| {
        let source = Bytes(whole.clone());
        stored_bytes(&excerpts(&[Remembered::of(&source)], wanted).unwrap()[0])
    };
    let mut config = CaptureConfig::default();
    config.topics.depth = Some("/nope".into());
    assert_eq!(excerpt_of(Wanted::Views(&config)), whole.len() as u64);
    let streams = Streams::default();
    assert!(excerpt_of(Wanted::Joints(&streams)) < whole.len() as u64 / 2);
    let named = Streams { poses: vec![("/nope".into(), "lid".into())], ..Streams::default() };
    assert_eq!(excerpt_of(Wanted::Joints(&named)), whole.len() as u64);
    // Without color no choice can be made, and the refusal lists all topics.
    let gray: Vec<_> = in_turn(70).into_iter().filter(|m| m.0 != 0).collect();
    let gray = file(&gray, WRITING);
    assert_eq!(excerpted(&gray, &CaptureConfig::default()), gray);
}
