//! Recordings that other projects test their readers with, read record by record: the conformance set of MCAP
//! (MIT) and the bags of rosbag2's tests (Apache-2.0). They lie in `tests/conformance`, packed (`tar --zstd
//! -tf`), each with its licence.

use std::{
    collections::BTreeMap,
    convert::Infallible,
    fs,
    io::{Cursor, Read as _},
    path::{Path, PathBuf},
};

use serde_json::Value;

use super::{
    bag::Bag,
    expansion::Expansion,
    inspect,
    mcap_file::{Channels, RawMessage, read_messages, summary_channels},
    read_joint_log,
};
use capture::CaptureError;
use gap::record::tracks::Streams;

/// Files of a packed folder, by path.
pub(super) fn files(name: &str) -> BTreeMap<String, Vec<u8>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/conformance").join(name);
    let mut tar = Vec::new();
    zstd::Decoder::new(fs::File::open(path).unwrap()).unwrap().read_to_end(&mut tar).unwrap();
    let text =
        |bytes: &[u8]| String::from_utf8(bytes.iter().copied().take_while(|b| *b != 0).collect()).unwrap();
    let mut found = BTreeMap::new();
    let mut at = 0;
    // Headers of 512 bytes: name, size in octal digits, kind, folder; contents in blocks of 512.
    while tar[at] != 0 {
        let header = &tar[at..at + 512];
        let size = usize::from_str_radix(text(&header[124..136]).trim(), 8).unwrap();
        let folder = text(&header[345..500]);
        let name = text(&header[..100]);
        if header[156] == b'0' {
            let path = if folder.is_empty() { name } else { format!("{folder}/{name}") };
            found.insert(path, tar[at + 512..at + 512 + size].to_vec());
        }
        at += 512 + size.next_multiple_of(512);
    }
    found
}

/// What a reader hands out of one message.
#[derive(Clone, Debug, PartialEq)]
struct Record {
    topic: String,
    type_name: String,
    encoding: String,
    sequence: u32,
    log_time: u64,
    publish_time: u64,
    data: Vec<u8>,
}

impl Record {
    fn of(m: &RawMessage) -> Self {
        let topic = m.topic.to_owned();
        let type_name = m.type_name.to_owned();
        let encoding = m.message_encoding.to_owned();
        let log_time = m.log_time_nanos;
        let publish_time = m.publish_time_nanos;
        Self {
            topic,
            type_name,
            encoding,
            sequence: m.sequence,
            log_time,
            publish_time,
            data: m.data.to_vec(),
        }
    }
}

/// The messages that the description beside a file of MCAP's set says are in it.
fn described(json: &[u8]) -> Vec<Record> {
    let json: Value = serde_json::from_slice(json).unwrap();
    let mut schemas = BTreeMap::new();
    let mut channels = BTreeMap::new();
    let mut messages = Vec::new();
    for record in json["records"].as_array().unwrap() {
        let fields = record["fields"].as_array().unwrap();
        let field = |name: &str| fields.iter().find(|f| f[0] == name).unwrap()[1].clone();
        let text = |name: &str| field(name).as_str().unwrap().to_owned();
        match record["type"].as_str().unwrap() {
            "Schema" => _ = schemas.insert(text("id"), text("name")),
            "Channel" => {
                _ = channels.insert(text("id"), (text("topic"), text("message_encoding"), text("schema_id")))
            }
            "Message" => {
                let (topic, encoding, schema) = channels[&text("channel_id")].clone();
                let byte = |b: &Value| b.as_str().unwrap().parse().unwrap();
                messages.push(Record {
                    topic,
                    type_name: schemas.get(&schema).cloned().unwrap_or_default(),
                    encoding,
                    sequence: text("sequence").parse().unwrap(),
                    log_time: text("log_time").parse().unwrap(),
                    publish_time: text("publish_time").parse().unwrap(),
                    data: field("data").as_array().unwrap().iter().map(byte).collect(),
                });
            }
            _ => {}
        }
    }
    messages
}

#[test]
fn every_file_of_mcaps_conformance_set_gives_its_records() {
    let files = files("mcap.tar.zst");
    let mut read = 0;
    let mut all = 0;
    for (name, bytes) in files.iter().filter(|(name, _)| name.ends_with(".mcap")) {
        let expected = described(&files[&name.replace(".mcap", ".json")]);
        // With what the summary says beforehand, and without.
        for known in [false, true] {
            let mut source = Cursor::new(bytes.as_slice());
            let mut channels =
                if known { summary_channels(&mut source).unwrap() } else { Channels::default() };
            let mut records = Vec::new();
            let mut expansion = Expansion::of(bytes.len() as u64);
            let report = read_messages::<_, Infallible>(source, &mut channels, &mut expansion, &mut |m| {
                records.push(Record::of(m));
                Ok(())
            });
            let report = report.unwrap();
            assert!(report.is_whole(), "{name}: {report:?}");
            assert_eq!(records, expected, "{name}");
            assert_eq!(report.messages, expected.len() as u64, "{name}");
        }
        (read, all) = (read + 1, all + expected.len());
    }
    assert_eq!((read, all), (416, MESSAGES));
}

/// Bags of rosbag2's tests: CRC-32 over topic, times, sequence and data of every message in the order of the
/// files; messages by topic and type. Counted once by the package `mcap` of PyPI.
#[rustfmt::skip]
const BAGS: &[(&str, u32, &[(&str, &str, usize)])] = &[
    ("rosbag2_cpp/test/rosbag2_cpp/bags/only_services.mcap", 0xb5f3d32c, &[
        ("/add_two_ints/_service_event", "example_interfaces/srv/AddTwoInts_Event", 12),
    ]),
    ("rosbag2_cpp/test/rosbag2_cpp/bags/only_topics.mcap", 0x258b5def, &[
        ("/parameter_events", "rcl_interfaces/msg/ParameterEvent", 7),
    ]),
    ("rosbag2_cpp/test/rosbag2_cpp/bags/topics_and_services.mcap", 0x39e48960, &[
        ("/add_two_ints/_service_event", "example_interfaces/srv/AddTwoInts_Event", 6),
        ("/parameter_events", "rcl_interfaces/msg/ParameterEvent", 7),
    ]),
    ("rosbag2_py/test/resources/mcap/convert_a", 0x35b801a7, &[
        ("a_empty", "test_msgs/msg/Empty", 100),
        ("b_basictypes", "test_msgs/msg/BasicTypes", 50),
    ]),
    ("rosbag2_py/test/resources/mcap/convert_b", 0x8d51617e, &[
        ("a_empty", "test_msgs/msg/Empty", 25),
        ("c_strings", "test_msgs/msg/Strings", 50),
    ]),
    ("rosbag2_py/test/resources/mcap/reindex_test_bags/multiple_files", 0xd456f3f1, &[
        ("/chatter", "std_msgs/msg/String", 3177),
    ]),
    ("rosbag2_py/test/resources/mcap/talker", 0xb3e82c28, &[
        ("/rosout", "rcl_interfaces/msg/Log", 10),
        ("/topic", "std_msgs/msg/String", 10),
    ]),
    ("rosbag2_py/test/resources/mcap/wbag", 0x84fc2735, &[
        ("AAA", "std_msgs/msg/String", 804),
        ("BBB", "std_msgs/msg/String", 742),
        ("CCC", "std_msgs/msg/String", 742),
        ("DDD", "std_msgs/msg/String", 753),
        ("EEE", "std_msgs/msg/String", 804),
        ("FFF", "std_msgs/msg/String", 772),
        ("GGG", "std_msgs/msg/String", 731),
        ("HHH", "std_msgs/msg/String", 726),
    ]),
    ("rosbag2_tests/resources/mcap/bag_with_topics_and_service_events", 0xbfa16828, &[
        ("/test_service1/_service_event", "test_msgs/srv/BasicTypes_Event", 4),
        ("/test_service2/_service_event", "test_msgs/srv/BasicTypes_Event", 4),
        ("/test_topic1", "test_msgs/msg/Strings", 1),
        ("/test_topic2", "test_msgs/msg/Strings", 1),
    ]),
    ("rosbag2_tests/resources/mcap/cdr_test", 0xe7466543, &[
        ("/array_topic", "test_msgs/msg/Arrays", 4),
        ("/test_topic", "test_msgs/msg/BasicTypes", 3),
    ]),
    ("rosbag2_tests/resources/mcap/wrong_rmw_test", 0xe7466543, &[
        ("/array_topic", "test_msgs/msg/Arrays", 4),
        ("/test_topic", "test_msgs/msg/BasicTypes", 3),
    ]),
];
/// Messages of MCAP's set, counted likewise.
const MESSAGES: usize = 1768;

/// rosbag2's bags, unpacked; they go away with the value.
struct Unpacked(PathBuf);

impl Unpacked {
    fn new(name: &str) -> Self {
        let root = std::env::temp_dir().join(format!("artitwin-rosbag2-{name}-{}", std::process::id()));
        for (path, bytes) in files("rosbag2.tar.zst") {
            let path = root.join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        }
        Self(root)
    }

    fn at(&self, path: &str) -> PathBuf {
        self.0.join("rosbag2").join(path)
    }
}

impl Drop for Unpacked {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.0).ok();
    }
}

#[test]
fn the_bags_of_rosbag2s_tests_give_their_records() {
    let bags = Unpacked::new("records");
    for (path, crc, topics) in BAGS {
        let bag = Bag::open(&bags.at(path)).unwrap();
        let mut counts = BTreeMap::<(String, String), usize>::new();
        let mut hash = crc32fast::Hasher::new();
        let reports = bag.read(&mut |m| {
            *counts.entry((m.topic.to_owned(), m.type_name.to_owned())).or_default() += 1;
            hash.update(m.topic.as_bytes());
            hash.update(&m.log_time_nanos.to_le_bytes());
            hash.update(&m.publish_time_nanos.to_le_bytes());
            hash.update(&m.sequence.to_le_bytes());
            hash.update(m.data);
            Ok(())
        });
        assert!(reports.unwrap().iter().all(|(_, r)| r.is_whole()), "{path}");
        let expected: BTreeMap<_, _> =
            topics.iter().map(|(t, n, count)| (((*t).to_owned(), (*n).to_owned()), *count)).collect();
        assert_eq!(counts, expected, "{path}");
        assert_eq!(hash.finalize(), *crc, "{path}");
    }
}

#[test]
fn odd_bags_are_said_to_be() {
    let bags = Unpacked::new("odd");
    let split =
        Bag::open(&bags.at("rosbag2_py/test/resources/mcap/reindex_test_bags/multiple_files")).unwrap();
    assert_eq!(split.files.len(), 3);
    assert!(split.warnings[0].text.contains("has no metadata.yaml"), "{:?}", split.warnings);
    let wrong = bags.at("rosbag2_tests/resources/mcap/wrong_rmw_test");
    let seen = inspect(&wrong).unwrap();
    let warnings: String = seen.recordings[0].warnings.iter().map(|w| format!("{w}\n")).collect();
    assert!(warnings.contains("4 of 4 messages on /array_topic could not be decoded"), "{warnings}");
    assert!(warnings.contains("message encoding `wrong_format` is not cdr"), "{warnings}");
    let refused = read_joint_log(&wrong, &Streams::default()).unwrap_err().to_string();
    assert!(
        refused.contains("/test_topic (test_msgs/msg/BasicTypes, encoded as `wrong_format`, not cdr)"),
        "{refused}"
    );
    let empty = Bag::open(&bags.at("rosbag2_tests/resources/empty_dir")).unwrap_err().to_string();
    assert!(empty.contains("holds no .mcap file"), "{empty}");
    for path in [
        "rosbag2_cpp/test/rosbag2_cpp/bags/topics_and_services.db3",
        "rosbag2_tests/resources/sqlite3/cdr_test",
        "rosbag2_tests/resources/sqlite3/cdr_test/cdr_test_0.db3",
        "rosbag2_tests/resources/sqlite3/wrong_rmw_test",
        "rosbag2_tests/resources/sqlite3/bag_with_topics_and_service_events",
    ] {
        let path = bags.at(path);
        let refused = [
            Bag::open(&path).unwrap_err(),
            read_joint_log(&path, &Streams::default()).unwrap_err(),
            inspect(&path).unwrap_err(),
        ];
        assert!(refused.iter().all(|e| matches!(e, CaptureError::Sqlite { .. })), "{refused:?}");
    }
}
