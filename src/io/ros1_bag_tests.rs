use std::{convert::Infallible, io::Cursor, io::Write as _};

use super::*;
use crate::ros2msg::{JointState, decode};

const DEFINITION: &str = "Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n\
    float64[] effort\n\
    ================================================================================\nMSG: std_msgs/Header\n\
    uint32 seq\ntime stamp\nstring frame_id\n";
/// Messages of a chunk, and chunks of a bag.
const COUNTS: [u32; 2] = [10, 4];

fn field(name: &str, value: &[u8]) -> Vec<u8> {
    let length = (name.len() + 1 + value.len()) as u32;
    [&length.to_le_bytes()[..], name.as_bytes(), b"=", value].concat()
}

fn block_of(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

fn record(header: &[Vec<u8>], data: &[u8]) -> Vec<u8> {
    [block_of(&header.concat()), block_of(data)].concat()
}

fn connection() -> Vec<u8> {
    let data = [
        field("topic", b"/joint_states"),
        field("type", b"sensor_msgs/JointState"),
        field("md5sum", b"3066dcd76a6cfaef579bd0f34173e9fd"),
        field("message_definition", DEFINITION.as_bytes()),
    ];
    record(&[field("op", &[7]), field("conn", &[0; 4]), field("topic", b"/joint_states")], &data.concat())
}

fn message(number: u32) -> Vec<u8> {
    let text = |s: &str| block_of(s.as_bytes());
    let body = [
        [number, 10 + number, 500].map(u32::to_le_bytes).concat(),
        text("base"),
        1u32.to_le_bytes().to_vec(),
        text("hinge"),
        1u32.to_le_bytes().to_vec(),
        f64::from(number).to_le_bytes().to_vec(),
        vec![0; 8],
    ];
    let time = [10 + number, 700].map(u32::to_le_bytes).concat();
    record(&[field("op", &[2]), field("conn", &[0; 4]), field("time", &time)], &body.concat())
}

fn packed(content: &[u8], compression: &str) -> Vec<u8> {
    match compression {
        "lz4" => {
            let mut encoder = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
            encoder.write_all(content).unwrap();
            encoder.finish().0
        }
        "bz2" => {
            let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
            encoder.write_all(content).unwrap();
            encoder.finish().unwrap()
        }
        _ => content.to_vec(),
    }
}

/// A bag; the connection stands in the first chunk, and in the index where it is closed.
fn bag(compression: &str, is_closed: bool) -> Vec<u8> {
    let mut chunks = Vec::new();
    for chunk in 0..COUNTS[1] {
        let mut content = if chunk == 0 { connection() } else { Vec::new() };
        for i in 0..COUNTS[0] {
            content.extend(message(chunk * COUNTS[0] + i));
        }
        let size = (content.len() as u32).to_le_bytes();
        let header = [field("op", &[5]), field("compression", compression.as_bytes()), field("size", &size)];
        chunks.extend(record(&header, &packed(&content, compression)));
    }
    let front = |index: u64| {
        let header = [
            field("op", &[3]),
            field("index_pos", &index.to_le_bytes()),
            field("conn_count", &[1, 0, 0, 0]),
            field("chunk_count", &COUNTS[1].to_le_bytes()),
        ];
        [ROS1_BAG.to_vec(), record(&header, &[b' '; 100])].concat()
    };
    let index = (front(0).len() + chunks.len()) as u64;
    if is_closed { [front(index), chunks, connection()].concat() } else { [front(0), chunks].concat() }
}

fn read(bytes: &[u8]) -> (Vec<f64>, FileReport) {
    let mut positions = Vec::new();
    let mut expansion = Expansion::of(bytes.len() as u64);
    let report = read_ros1_bag::<_, Infallible>(Cursor::new(bytes), &mut expansion, &mut |m| {
        assert_eq!(
            (m.topic, m.type_name, m.message_encoding),
            ("/joint_states", "sensor_msgs/msg/JointState", "cdr")
        );
        let state: JointState = decode(m.data).unwrap();
        let seconds = 10 + state.position[0] as u64;
        assert_eq!(m.log_time_nanos, seconds * 1_000_000_000 + 700);
        assert_eq!(state.header.stamp.nanos(), Some((seconds * 1_000_000_000 + 500) as i64));
        positions.push(state.position[0]);
        Ok(())
    })
    .unwrap();
    (positions, report)
}

fn all() -> Vec<f64> {
    (0..COUNTS[0] * COUNTS[1]).map(f64::from).collect()
}

#[test]
fn bags_of_every_compression_are_read_closed_or_not() {
    for compression in ["none", "lz4", "bz2"] {
        for is_closed in [true, false] {
            let (positions, report) = read(&bag(compression, is_closed));
            assert_eq!(positions, all(), "{compression}");
            assert!(report.is_whole() && report.chunks == u64::from(COUNTS[1]), "{report:?}");
        }
    }
}

#[test]
fn a_cut_bag_gives_what_came_before_and_a_damaged_chunk_its_neighbors() {
    for compression in ["none", "lz4", "bz2"] {
        let bytes = bag(compression, false);
        for share in [3, 6, 9] {
            let (positions, report) = read(&bytes[..bytes.len() * share / 10]);
            assert_eq!(positions, all()[..positions.len()]);
            assert!(report.stopped.is_some() && positions.len() < all().len(), "{report:?}");
        }
    }
    // The first chunk, with the connection: the index repeats it.
    let mut bytes = bag("lz4", true);
    let at = bytes.windows(4).position(|w| w == [0x04, 0x22, 0x4d, 0x18]).unwrap();
    bytes[at..at + 40].fill(0xa5);
    let (positions, report) = read(&bytes);
    assert_eq!(positions, all()[COUNTS[0] as usize..]);
    assert_eq!((report.bad_chunks.len(), report.orphans), (1, 0), "{report:?}");
}

#[test]
fn what_a_bag_claims_reserves_nothing() {
    let header = [field("op", &[5]), field("compression", b"bz2"), field("size", &u32::MAX.to_le_bytes())];
    let huge = [bag("none", false), record(&header, b"BZh9")].concat();
    let (positions, report) = read(&huge);
    assert_eq!((positions.len(), report.bad_chunks.len()), (all().len(), 1));
    let claimed = [&bag("none", false)[..], &u32::MAX.to_le_bytes()].concat();
    assert!(read(&claimed).1.stopped.unwrap().contains("more than the limit"));
    for cut in 0..200 {
        read(&bag("none", true)[..ROS1_BAG.len() + cut]);
    }
}
