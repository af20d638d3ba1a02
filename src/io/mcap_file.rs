//! Reads MCAP files front to back, without their index, and salvages damaged ones chunk by chunk.
//!
//! A file is a magic, then records of one opcode byte, an 8-byte length and a body; chunks contain compressed
//! records of the same form. The largest record bounds the memory. A chunk with a broken checksum or
//! compression is skipped as a whole, because a message in it may be silently wrong; a file cut in the middle
//! of a chunk gives the records before the cut.

use std::{
    collections::BTreeMap,
    io::{ErrorKind, Read, Seek, SeekFrom},
};

use mcap::records::op;

use super::{
    expansion::{Expansion, ExpansionError, unpack},
    mcap_record::{
        ChannelRecord, ChunkRecord, MessageRecord, RecordError, SchemaRecord, TAIL, summary_start,
    },
    ros1msg::{ROS1, ROS1_BROKEN, Ros1Layout},
};

use common::note::{Note, NoteCode};

/// Largest record and largest decompressed chunk, bytes.
pub const RECORD_LIMIT: u64 = 256 << 20;
/// Largest number of damaged chunks whose reason is kept.
const REASONS: usize = 20;

/// Why a file, or a chunk of it, is not read further.
#[derive(Debug, thiserror::Error)]
enum McapDamage {
    #[error("the file is empty")]
    Empty,
    #[error("it does not begin as an MCAP file")]
    NoMcap,
    #[error("the file ends without its end mark (not closed by the recorder, or cut)")]
    NoEnd,
    #[error("the file ends in the middle of a record")]
    CutFile,
    #[error("it ends in the middle of a record")]
    CutChunk,
    #[error("a record claims {0} bytes, more than the limit of {RECORD_LIMIT}")]
    LongRecord(u64),
    #[error(transparent)]
    Record(#[from] RecordError),
    #[error(transparent)]
    Read(#[from] std::io::Error),
    #[error("its header is broken ({0})")]
    ChunkHeader(RecordError),
    #[error("it is longer than its record")]
    LongChunk,
    #[error("it claims {0} bytes, more than the limit of {RECORD_LIMIT}")]
    LargeChunk(u64),
    #[error(transparent)]
    Expansion(#[from] ExpansionError),
    #[error("its compression `{0}` is not known")]
    Compression(String),
    #[error("its compression is broken ({0})")]
    Unpack(std::io::Error),
    #[error("it holds {has} bytes instead of {expected}")]
    Size { has: usize, expected: u64 },
    #[error("its checksum is {has:08x} instead of {expected:08x}")]
    Checksum { has: u32, expected: u32 },
}

/// A message stream within a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Topic name.
    pub topic: String,
    /// `cdr` for ROS 2.
    pub message_encoding: String,
    /// Schema, by its id.
    schema_id: u16,
}

/// Channels and schemas by id, as far as they are known.
#[derive(Clone, Debug, Default)]
pub struct Channels {
    channels: BTreeMap<u16, Channel>,
    schemas: BTreeMap<u16, Schema>,
}

/// A type of messages.
#[derive(Clone, Debug)]
struct Schema {
    type_name: String,
    /// Whether the definition is one of ROS 2.
    is_ros2: bool,
    /// Layout of the messages of ROS 1; none without a definition that can be read.
    ros1: Option<Ros1Layout>,
}

impl Schema {
    fn of(record: SchemaRecord) -> Self {
        let is_ros1 = record.encoding == "ros1msg";
        let layout = || Ros1Layout::parse(&record.name, &record.definition).ok();
        Self {
            is_ros2: ["ros2msg", "ros2idl"].contains(&record.encoding.as_str()),
            ros1: is_ros1.then(layout).flatten(),
            type_name: record.name,
        }
    }
}

impl Channels {
    fn type_name(&self, channel: &Channel) -> &str {
        self.schemas.get(&channel.schema_id).map_or("", |s| s.type_name.as_str())
    }

    /// Encoding of a channel's messages; CDR where the channel says nothing and its type is one of ROS 2.
    fn encoding<'a>(&self, channel: &'a Channel) -> &'a str {
        let is_ros2 = self.schemas.get(&channel.schema_id).is_some_and(|s| s.is_ros2);
        if channel.message_encoding.is_empty() && is_ros2 { "cdr" } else { &channel.message_encoding }
    }

    /// A message of a ROS 1 channel as CDR; `None` where it does not fit its definition.
    fn cdr(&self, channel: &Channel, data: &[u8]) -> Option<Vec<u8>> {
        self.schemas.get(&channel.schema_id)?.ros1.as_ref()?.cdr(data).ok()
    }

    /// Learns from the body of a schema or channel record.
    fn learn(&mut self, opcode: u8, body: &[u8]) -> Result<(), RecordError> {
        // Both come again in further chunks and in the summary. The specification wants repetitions to be
        // identical, so the last one may replace the first.
        if opcode == op::SCHEMA {
            let schema = SchemaRecord::read(body)?;
            self.schemas.insert(schema.id, Schema::of(schema));
        } else {
            let c = ChannelRecord::read(body)?;
            self.channels.insert(
                c.id,
                Channel { topic: c.topic, message_encoding: c.message_encoding, schema_id: c.schema_id },
            );
        }
        Ok(())
    }
}

/// One message as it is in the file.
#[derive(Clone, Copy, Debug)]
pub struct RawMessage<'a> {
    /// Topic name.
    pub topic: &'a str,
    /// Type, e.g. `sensor_msgs/msg/Image`; empty if the file does not say.
    pub type_name: &'a str,
    /// `cdr` for ROS 2, and for ROS 1 where a message fits its definition.
    pub message_encoding: &'a str,
    /// When it was recorded, nanoseconds.
    pub log_time_nanos: u64,
    /// When it was sent, nanoseconds.
    #[cfg_attr(not(test), allow(dead_code, reason = "the conformance sets name it"))]
    pub publish_time_nanos: u64,
    /// Sequence number given by the sender; 0 without one.
    #[cfg_attr(not(test), allow(dead_code, reason = "the conformance sets name it"))]
    pub sequence: u32,
    /// Payload with its CDR header.
    pub data: &'a [u8],
}

/// How a file was read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FileReport {
    /// Messages handed out.
    pub messages: u64,
    /// Chunks seen.
    pub chunks: u64,
    /// Chunks left out, each with its number (from 1) and, for the first ones, the reason.
    pub bad_chunks: Vec<(u64, String)>,
    /// Messages with an unknown channel.
    pub orphans: u64,
    /// Why reading stopped before the end.
    pub stopped: Option<String>,
}

impl FileReport {
    pub(super) fn bad_chunk(&mut self, number: u64, why: &impl std::fmt::Display) {
        let why = if self.bad_chunks.len() < REASONS { why.to_string() } else { String::new() };
        self.bad_chunks.push((number, why));
    }

    /// The same report, for a file whose reading stopped early.
    pub(super) fn stopped_by(mut self, why: &impl std::fmt::Display) -> Self {
        self.stopped = Some(why.to_string());
        self
    }

    /// Whether everything was read.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.bad_chunks.is_empty() && self.orphans == 0 && self.stopped.is_none()
    }

    /// A note on the damage in the named file; `None` if it is whole.
    #[must_use]
    pub fn damage(&self, name: &str) -> Option<Note> {
        if self.is_whole() {
            return None;
        }
        let mut parts = Vec::new();
        if let Some(why) = &self.stopped {
            parts.push(format!("reading stopped early: {why}"));
        }
        if let Some((number, why)) = self.bad_chunks.first() {
            let n = self.bad_chunks.len();
            parts.push(format!(
                "{n} of {} chunks left out as damaged (first: chunk {number}, {why})",
                self.chunks
            ));
        }
        if self.orphans > 0 {
            parts.push(format!("{} messages left out, as their topic is not known", self.orphans));
        }
        let text = format!("`{name}` is damaged: {}; {} messages were read", parts.join("; "), self.messages);
        Some(Note::new(NoteCode::RecordingDamaged, text))
    }
}

/// A record: its opcode and body.
struct RawRecord {
    opcode: u8,
    body: Vec<u8>,
    /// Whether the source ended before the body did.
    cut: bool,
}

/// Reads the next record; `Ok(None)` at a clean end.
fn next_record(source: &mut impl Read) -> Result<Option<RawRecord>, McapDamage> {
    let mut front = [0; 9];
    match read_up_to(source, &mut front)? {
        0 => return Ok(None),
        9 => {}
        _ => return Err(McapDamage::CutFile),
    }
    let opcode = front[0];
    let length = front[1..].iter().rev().fold(0u64, |n, b| n << 8 | u64::from(*b));
    // The length is claimed by the file: it is checked before anything is read.
    if length > RECORD_LIMIT {
        return Err(McapDamage::LongRecord(length));
    }
    // Grows with the bytes read; a capacity of `length` would be allocated for a cut file, too.
    let mut body = Vec::new();
    source.by_ref().take(length).read_to_end(&mut body)?;
    let cut = (body.len() as u64) < length;
    Ok(Some(RawRecord { opcode, body, cut }))
}

/// Fills as much of the buffer as the source gives.
fn read_up_to(source: &mut impl Read, buffer: &mut [u8]) -> std::io::Result<usize> {
    let mut filled = 0;
    while filled < buffer.len() {
        match source.read(&mut buffer[filled..]) {
            Ok(0) => break,
            Ok(n) => filled += n,
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(filled)
}

/// Channels repeated in the summary at the end of a file, so losing the chunk in which they are first
/// mentioned loses no other chunk. Best effort: a file without a valid footer gives none. The source is left
/// at its start.
///
/// # Errors
/// An I/O error from seeking back to the start.
pub fn summary_channels(source: &mut (impl Read + Seek)) -> std::io::Result<Channels> {
    let channels = summary(source).unwrap_or_default();
    source.rewind()?;
    Ok(channels)
}

fn summary(source: &mut (impl Read + Seek)) -> Option<Channels> {
    let tail_at = source.seek(SeekFrom::End(-(TAIL as i64))).ok()?;
    let mut tail = [0; TAIL as usize];
    source.read_exact(&mut tail).ok()?;
    let start = summary_start(&tail, tail_at + TAIL)?;
    source.seek(SeekFrom::Start(start)).ok()?;
    let mut section = source.by_ref().take(tail_at - start);
    let mut channels = Channels::default();
    while let Ok(Some(record)) = next_record(&mut section) {
        if matches!(record.opcode, op::SCHEMA | op::CHANNEL) {
            channels.learn(record.opcode, &record.body).ok()?;
        }
    }
    Some(channels)
}

/// Reads all messages in file order. `channels` contains the known channels and learns further ones; chunks
/// unpack within the budget of `expansion`.
///
/// # Errors
/// The visitor's error. Damage is not an error: it is in the report.
pub fn read_messages<R: Read, E>(
    mut source: R,
    channels: &mut Channels,
    expansion: &mut Expansion,
    visit: &mut dyn FnMut(&RawMessage) -> Result<(), E>,
) -> Result<FileReport, E> {
    let mut report = FileReport::default();
    let mut magic = [0; 8];
    match read_up_to(&mut source, &mut magic) {
        Ok(8) if magic == *mcap::MAGIC => {}
        Ok(0) => return Ok(report.stopped_by(&McapDamage::Empty)),
        Ok(_) => return Ok(report.stopped_by(&McapDamage::NoMcap)),
        Err(error) => return Ok(report.stopped_by(&error)),
    }
    loop {
        let record = match next_record(&mut source) {
            Ok(Some(record)) => record,
            Ok(None) => return Ok(report.stopped_by(&McapDamage::NoEnd)),
            // Nothing marks the beginning of a record: after a broken length everything is lost.
            Err(why) => return Ok(report.stopped_by(&why)),
        };
        match record.opcode {
            // The following summary only repeats.
            op::DATA_END | op::FOOTER => return Ok(report),
            op::CHUNK => read_chunk(&record, channels, expansion, &mut report, visit)?,
            // Half a schema, channel or message is of no use; half a chunk may hold whole messages.
            _ if record.cut => {}
            opcode => {
                if let Err(why) = read_flat(opcode, &record.body, channels, &mut report, visit)? {
                    return Ok(report.stopped_by(&why));
                }
            }
        }
        if record.cut {
            return Ok(report.stopped_by(&McapDamage::CutFile));
        }
    }
}

/// A record outside a chunk or in a decompressed one. The inner error is damage.
fn read_flat<E>(
    opcode: u8,
    body: &[u8],
    channels: &mut Channels,
    report: &mut FileReport,
    visit: &mut dyn FnMut(&RawMessage) -> Result<(), E>,
) -> Result<Result<(), RecordError>, E> {
    match opcode {
        op::SCHEMA | op::CHANNEL => Ok(channels.learn(opcode, body)),
        op::MESSAGE => {
            let message = match MessageRecord::read(body) {
                Ok(message) => message,
                Err(why) => return Ok(Err(why)),
            };
            // Its channel stood in a skipped chunk, and no summary repeats it.
            let Some(channel) = channels.channels.get(&message.channel_id) else {
                report.orphans += 1;
                return Ok(Ok(()));
            };
            report.messages += 1;
            let mut raw = RawMessage {
                topic: &channel.topic,
                type_name: channels.type_name(channel),
                message_encoding: channels.encoding(channel),
                log_time_nanos: message.log_time,
                publish_time_nanos: message.publish_time,
                sequence: message.sequence,
                data: message.data,
            };
            let cdr;
            if raw.message_encoding == ROS1 {
                raw.message_encoding = ROS1_BROKEN;
                cdr = channels.cdr(channel, message.data);
                if let Some(cdr) = &cdr {
                    raw.message_encoding = "cdr";
                    raw.data = cdr;
                }
            }
            visit(&raw)?;
            Ok(Ok(()))
        }
        // Indexes, statistics, attachments, and opcodes of later versions: a reader has to skip them.
        _ => Ok(Ok(())),
    }
}

fn read_chunk<E>(
    record: &RawRecord,
    channels: &mut Channels,
    expansion: &mut Expansion,
    report: &mut FileReport,
    visit: &mut dyn FnMut(&RawMessage) -> Result<(), E>,
) -> Result<(), E> {
    report.chunks += 1;
    let number = report.chunks;
    // A bad chunk loses its own messages, and channels mentioned only in it.
    let content = match chunk_content(record, expansion) {
        Ok(content) => content,
        Err(why) => {
            report.bad_chunk(number, &why);
            return Ok(());
        }
    };
    let mut source = content.as_slice();
    loop {
        let why = match next_record(&mut source) {
            Ok(None) => return Ok(()),
            Ok(Some(inner)) if !inner.cut => {
                match read_flat(inner.opcode, &inner.body, channels, report, visit)? {
                    Ok(()) => continue,
                    Err(why) => why.into(),
                }
            }
            // A cut file is reported once, by the caller.
            _ if record.cut => return Ok(()),
            Ok(Some(_)) => McapDamage::CutChunk,
            Err(why) => why,
        };
        report.bad_chunk(number, &why);
        return Ok(());
    }
}

/// The records of a chunk, decompressed and with their checksum verified; of a chunk that was cut, what there
/// is.
fn chunk_content(record: &RawRecord, expansion: &mut Expansion) -> Result<Vec<u8>, McapDamage> {
    let header = ChunkRecord::read(&record.body).map_err(McapDamage::ChunkHeader)?;
    let data = match usize::try_from(header.compressed_size) {
        Ok(n) if n <= header.data.len() => &header.data[..n],
        _ if record.cut => header.data,
        _ => return Err(McapDamage::LongChunk),
    };
    if header.uncompressed_size > RECORD_LIMIT {
        return Err(McapDamage::LargeChunk(header.uncompressed_size));
    }
    // Uncompressed data cannot be larger than the file.
    if !header.compression.is_empty() {
        expansion.take(data.len() as u64, header.uncompressed_size)?;
    }
    let mut content = Vec::new();
    let unpacked = match header.compression.as_str() {
        "" => {
            content.extend_from_slice(data);
            Ok(())
        }
        "zstd" => unpack(zstd::Decoder::new(data), header.uncompressed_size, &mut content)
            .map_err(McapDamage::Unpack),
        "lz4" => unpack(lz4::Decoder::new(data), header.uncompressed_size, &mut content)
            .map_err(McapDamage::Unpack),
        other => Err(McapDamage::Compression(other.to_owned())),
    };
    // The checksum is that of the whole chunk; of half a chunk only the records' form can be checked.
    if record.cut {
        return Ok(content);
    }
    unpacked?;
    if content.len() as u64 != header.uncompressed_size {
        return Err(McapDamage::Size { has: content.len(), expected: header.uncompressed_size });
    }
    let crc = crc32fast::hash(&content);
    // 0 means no checksum. rosbag2 records so by default, so damage may pass: the later decoders check sizes
    // and numbers themselves.
    if header.uncompressed_crc != 0 && crc != header.uncompressed_crc {
        return Err(McapDamage::Checksum { has: crc, expected: header.uncompressed_crc });
    }
    Ok(content)
}

#[cfg(test)]
mod tests {
    use std::{convert::Infallible, io::Cursor};

    use super::*;

    const COUNT: usize = 21;

    fn file(compression: Option<mcap::Compression>) -> Vec<u8> {
        let mut buffer = Cursor::new(Vec::new());
        let options =
            mcap::WriteOptions::new().compression(compression).chunk_size(Some(4000)).profile("ros2");
        let mut writer = options.create(&mut buffer).unwrap();
        let schema = writer.add_schema("std_msgs/msg/String", "ros2msg", b"string data").unwrap();
        let channel = writer.add_channel(schema, "/a", "cdr", &BTreeMap::new()).unwrap();
        for i in 0..COUNT {
            let header = mcap::records::MessageHeader {
                channel_id: channel,
                sequence: i as u32,
                log_time: i as u64,
                publish_time: 0,
            };
            let data: Vec<u8> = (0..1500u32)
                .map(|k| (k.wrapping_mul(2_654_435_761).wrapping_add(i as u32) >> 13) as u8)
                .collect();
            writer.write_to_known_channel(&header, &data).unwrap();
        }
        writer.finish().unwrap();
        drop(writer);
        buffer.into_inner()
    }

    fn read(bytes: &[u8]) -> (Vec<u64>, FileReport) {
        let mut source = Cursor::new(bytes);
        let mut channels = summary_channels(&mut source).unwrap();
        let mut times = Vec::new();
        let mut expansion = Expansion::of(bytes.len() as u64);
        let report = read_messages::<_, Infallible>(source, &mut channels, &mut expansion, &mut |m| {
            assert_eq!((m.topic, m.type_name, m.data.len()), ("/a", "std_msgs/msg/String", 1500));
            times.push(m.log_time_nanos);
            Ok(())
        })
        .unwrap();
        (times, report)
    }

    fn kinds() -> [Option<mcap::Compression>; 3] {
        [None, Some(mcap::Compression::Zstd), Some(mcap::Compression::Lz4)]
    }

    #[test]
    fn a_whole_file_is_read_in_order() {
        for kind in kinds() {
            let (times, report) = read(&file(kind));
            assert_eq!(times, (0..COUNT as u64).collect::<Vec<_>>());
            assert!(report.is_whole() && report.chunks > 3, "{report:?}");
            assert_eq!(report.damage("x"), None);
        }
    }

    #[test]
    fn without_its_end_everything_is_read_and_said() {
        for kind in kinds() {
            let bytes = file(kind);
            let end =
                bytes.windows(9).rposition(|w| w[0] == op::DATA_END && w[1..] == 4u64.to_le_bytes()).unwrap();
            let (times, report) = read(&bytes[..end]);
            assert_eq!(times.len(), COUNT);
            assert!(report.damage("x").unwrap().text.contains("without its end mark"));
        }
    }

    #[test]
    fn a_cut_file_gives_what_came_before() {
        for kind in kinds() {
            let bytes = file(kind);
            let mut before = 0;
            for share in [1, 3, 5, 7] {
                let (times, report) = read(&bytes[..bytes.len() * share / 10]);
                assert_eq!(times, (0..times.len() as u64).collect::<Vec<_>>());
                assert!(times.len() >= before && times.len() < COUNT, "{} {before}", times.len());
                assert!(report.stopped.is_some() && report.bad_chunks.is_empty(), "{report:?}");
                before = times.len();
            }
            assert!(before > COUNT / 3);
        }
    }

    #[test]
    fn flipped_bytes_cost_one_chunk_wherever_they_are() {
        for kind in kinds() {
            let whole = file(kind);
            // The first chunk, which also names the channel, and one in the middle.
            for place in [900, whole.len() / 2] {
                let mut bytes = whole.clone();
                bytes[place] ^= 0x55;
                bytes[place + 1] ^= 0x55;
                let (times, report) = read(&bytes);
                assert_eq!(report.bad_chunks.len(), 1, "{report:?}");
                assert!(times.len() >= COUNT - 4 && times.len() < COUNT, "{}", times.len());
                assert_eq!((report.orphans, &report.stopped), (0, &None));
            }
        }
    }

    #[test]
    fn nonsense_is_reported_without_allocation() {
        assert!(read(b"").1.stopped.unwrap().contains("empty"));
        assert!(read(b"hello, world").1.stopped.unwrap().contains("MCAP"));
        assert!(read(mcap::MAGIC).1.stopped.is_some());
        let huge = [mcap::MAGIC, &[op::MESSAGE], &(1u64 << 62).to_le_bytes()[..]].concat();
        assert!(read(&huge).1.stopped.unwrap().contains("limit"));
        let mut chunk = [0u8; 48];
        chunk[16..24].copy_from_slice(&(1u64 << 40).to_le_bytes());
        let bomb = [mcap::MAGIC, &[op::CHUNK], &48u64.to_le_bytes()[..], &chunk].concat();
        assert!(read(&bomb).1.bad_chunks[0].1.contains("limit"));
        let schema = [&7u16.to_le_bytes()[..], &u32::MAX.to_le_bytes(), b"short"].concat();
        let schema = [mcap::MAGIC, &[op::SCHEMA], &(schema.len() as u64).to_le_bytes()[..], &schema].concat();
        assert!(read(&schema).1.stopped.unwrap().contains("a field of 4294967295 bytes"));
    }

    #[test]
    fn chunks_that_unpack_to_far_more_than_they_hold_are_left_out_and_the_rest_is_read() {
        let whole = file(Some(mcap::Compression::Zstd));
        let zeros = zstd::bulk::compress(&vec![0; 64 << 20], 1).unwrap();
        let mut chunk =
            [&[0; 16][..], &(64u64 << 20).to_le_bytes(), &[0; 4], &4u32.to_le_bytes(), b"zstd"].concat();
        chunk.extend((zeros.len() as u64).to_le_bytes());
        chunk.extend(&zeros);
        let record = [&[op::CHUNK][..], &(chunk.len() as u64).to_le_bytes(), &chunk].concat();
        let header = 8 + 9 + u64::from_le_bytes(*whole[9..].first_chunk().unwrap()) as usize;
        let bytes = [&whole[..header], &record.repeat(1000), &whole[header..]].concat();
        let begun = std::time::Instant::now();
        let (times, report) = read(&bytes);
        assert!(begun.elapsed().as_secs() < 3, "{:?}", begun.elapsed());
        assert_eq!((times.len(), report.bad_chunks.len()), (COUNT, 1000));
        assert!(report.damage("x").unwrap().text.contains("would unpack to 67108864, more than the limit"));
    }
}
