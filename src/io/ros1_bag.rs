//! Reads `.bag` files of ROS 1 (format 2.0, <https://wiki.ros.org/Bags/Format/2.0>) front to back, without
//! their index, so bags that were not closed are read, too.
//!
//! A record is a header of `name=value` fields and its data, each behind its length. Messages lie in
//! chunks, with the connection records that give their topics and types. A damaged chunk is left out as a
//! whole.

use std::{
    borrow::Cow,
    collections::BTreeMap,
    io::{Read, Seek, SeekFrom},
};

use super::{
    expansion::{Expansion, ExpansionError, unpack},
    mcap_file::{FileReport, RECORD_LIMIT, RawMessage},
    ros1msg::{ROS1_BROKEN, Ros1Layout, ros2_type_name},
};

/// The first bytes of a file.
pub const ROS1_BAG: &[u8] = b"#ROSBAG V2.0\n";
/// Longest header of a record, bytes; those of connections hold a topic, those of others some numbers.
const HEADER_LIMIT: u64 = 1 << 20;
/// Most connections of a bag.
const MAX_CONNECTIONS: usize = 100_000;

/// Opcodes of records.
mod op {
    pub const MESSAGE: u8 = 0x02;
    pub const BAG_HEADER: u8 = 0x03;
    pub const CHUNK: u8 = 0x05;
    pub const CONNECTION: u8 = 0x07;
}

/// Why a file, or a chunk of it, is not read further.
#[derive(Debug, thiserror::Error)]
enum BagDamage {
    #[error("it ends in the middle of a record")]
    Cut,
    #[error("a record claims {0} bytes, more than the limit of {RECORD_LIMIT}")]
    LongRecord(u64),
    #[error("the header of a record is broken")]
    Header,
    #[error("it is encrypted; decrypt it first")]
    Encrypted,
    #[error("it has more than {MAX_CONNECTIONS} connections")]
    Connections,
    #[error(transparent)]
    Read(#[from] std::io::Error),
    #[error(transparent)]
    Expansion(#[from] ExpansionError),
    #[error("its compression `{0}` is not known")]
    Compression(String),
    #[error("its compression is broken ({0})")]
    Unpack(std::io::Error),
    #[error("it holds {has} bytes instead of {expected}")]
    Size { has: usize, expected: u64 },
}

/// The messages of one publisher.
struct Connection {
    topic: String,
    type_name: String,
    layout: Option<Ros1Layout>,
}

/// Connections by id.
#[derive(Default)]
struct Connections {
    known: BTreeMap<u32, Connection>,
}

impl Connections {
    /// Learns from a connection record.
    fn learn(&mut self, record: &BagRecord) -> Result<(), BagDamage> {
        let id = record.number(b"conn", 4)? as u32;
        if self.known.contains_key(&id) {
            return Ok(());
        }
        if self.known.len() >= MAX_CONNECTIONS {
            return Err(BagDamage::Connections);
        }
        let fields = fields(&record.data)?;
        let text = |name: &[u8]| fields.get(name).map(|v| String::from_utf8_lossy(v).into_owned());
        let type_name = text(b"type").ok_or(BagDamage::Header)?;
        let definition = text(b"message_definition").unwrap_or_default();
        // The topic as it was recorded stands in the record's header, that of the publisher in its data.
        let topic = record.header.get(&b"topic"[..]).ok_or(BagDamage::Header)?;
        let connection = Connection {
            topic: String::from_utf8_lossy(topic).into_owned(),
            layout: Ros1Layout::parse(&type_name, &definition).ok(),
            type_name: ros2_type_name(&type_name).into_owned(),
        };
        self.known.insert(id, connection);
        Ok(())
    }
}

/// A record: the fields of its header, and its data.
struct BagRecord {
    header: BTreeMap<Vec<u8>, Vec<u8>>,
    data: Vec<u8>,
    /// Whether the source ended before the data did.
    is_cut: bool,
}

impl BagRecord {
    fn opcode(&self) -> Result<u8, BagDamage> {
        Ok(self.number(b"op", 1)? as u8)
    }

    /// A little-endian number in the header.
    fn number(&self, name: &[u8], bytes: usize) -> Result<u64, BagDamage> {
        let value = self.header.get(name).filter(|v| v.len() == bytes).ok_or(BagDamage::Header)?;
        Ok(value.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b)))
    }

    /// When it was recorded, nanoseconds: seconds in the lower, nanoseconds in the upper half.
    fn time_nanos(&self) -> Result<u64, BagDamage> {
        let time = self.number(b"time", 8)?;
        Ok((time & u64::from(u32::MAX)) * 1_000_000_000 + (time >> 32))
    }
}

/// The fields `name=value` of a header, each behind its length.
fn fields(mut bytes: &[u8]) -> Result<BTreeMap<Vec<u8>, Vec<u8>>, BagDamage> {
    let mut found = BTreeMap::new();
    while !bytes.is_empty() {
        let (length, rest) = bytes.split_first_chunk::<4>().ok_or(BagDamage::Header)?;
        let (field, rest) =
            rest.split_at_checked(u32::from_le_bytes(*length) as usize).ok_or(BagDamage::Header)?;
        let end = field.iter().position(|b| *b == b'=').ok_or(BagDamage::Header)?;
        found.insert(field[..end].to_vec(), field[end + 1..].to_vec());
        bytes = rest;
    }
    Ok(found)
}

/// A block behind its length; `None` at a clean end. The second value says whether it is cut.
fn block(source: &mut impl Read, limit: u64) -> Result<Option<(Vec<u8>, bool)>, BagDamage> {
    let mut length = Vec::new();
    source.by_ref().take(4).read_to_end(&mut length)?;
    let length = match length[..] {
        [] => return Ok(None),
        [a, b, c, d] => u64::from(u32::from_le_bytes([a, b, c, d])),
        _ => return Err(BagDamage::Cut),
    };
    // The length is claimed by the file: it is checked before anything is read, and reserves nothing.
    if length > limit {
        return Err(BagDamage::LongRecord(length));
    }
    let mut bytes = Vec::new();
    source.by_ref().take(length).read_to_end(&mut bytes)?;
    let is_cut = (bytes.len() as u64) < length;
    Ok(Some((bytes, is_cut)))
}

/// Reads the next record; `Ok(None)` at a clean end.
fn next_record(source: &mut impl Read) -> Result<Option<BagRecord>, BagDamage> {
    let header = match block(source, HEADER_LIMIT)? {
        None => return Ok(None),
        Some((_, true)) => return Err(BagDamage::Cut),
        Some((bytes, false)) => fields(&bytes)?,
    };
    let (data, is_cut) = block(source, RECORD_LIMIT)?.ok_or(BagDamage::Cut)?;
    Ok(Some(BagRecord { header, data, is_cut }))
}

/// Reads all messages in file order; chunks unpack within the budget of `expansion`.
///
/// # Errors
/// The visitor's error. Damage is not an error: it is in the report.
pub fn read_ros1_bag<R: Read + Seek, E>(
    mut source: R,
    expansion: &mut Expansion,
    visit: &mut dyn FnMut(&RawMessage) -> Result<(), E>,
) -> Result<FileReport, E> {
    let mut reader =
        BagReading { connections: indexed_connections(&mut source), report: FileReport::default(), visit };
    if let Err(error) = source.seek(SeekFrom::Start(ROS1_BAG.len() as u64)) {
        return Ok(reader.report.stopped_by(&error));
    }
    loop {
        let record = match next_record(&mut source) {
            Ok(Some(record)) => record,
            Ok(None) => return Ok(reader.report),
            // Nothing marks the beginning of a record: after a broken length everything is lost.
            Err(why) => return Ok(reader.report.stopped_by(&why)),
        };
        let is_chunk = matches!(record.opcode(), Ok(op::CHUNK));
        let read = if is_chunk { reader.chunk(&record, expansion)? } else { reader.flat(&record)? };
        if let Err(why) = read {
            return Ok(reader.report.stopped_by(&why));
        }
        if record.is_cut {
            return Ok(reader.report.stopped_by(&BagDamage::Cut));
        }
    }
}

/// Connections repeated at the end of a closed bag, so a lost chunk loses no other. Best effort: a bag that
/// was not closed gives none.
fn indexed_connections(source: &mut (impl Read + Seek)) -> Connections {
    let mut connections = Connections::default();
    // What cannot be read here is found and reported by the reading from the front.
    let _ = read_index(source, &mut connections);
    connections
}

fn read_index(source: &mut (impl Read + Seek), connections: &mut Connections) -> Result<(), BagDamage> {
    source.seek(SeekFrom::Start(ROS1_BAG.len() as u64))?;
    let header = next_record(source)?.ok_or(BagDamage::Cut)?;
    let at = header.number(b"index_pos", 8)?;
    // 0 in a bag that was not closed.
    if at == 0 {
        return Ok(());
    }
    source.seek(SeekFrom::Start(at))?;
    while let Some(record) = next_record(source)? {
        if record.opcode()? == op::CONNECTION && !record.is_cut {
            connections.learn(&record)?;
        }
    }
    Ok(())
}

/// What is known while a bag is read.
struct BagReading<'a, E> {
    connections: Connections,
    report: FileReport,
    visit: &'a mut dyn FnMut(&RawMessage) -> Result<(), E>,
}

impl<E> BagReading<'_, E> {
    /// A record outside a chunk or in an unpacked one. The inner error is damage.
    fn flat(&mut self, record: &BagRecord) -> Result<Result<(), BagDamage>, E> {
        // Half a connection or message is of no use.
        if record.is_cut {
            return Ok(Ok(()));
        }
        match record.opcode() {
            Ok(op::BAG_HEADER) => match record.header.get(&b"encryptor"[..]) {
                Some(name) if !name.is_empty() => Ok(Err(BagDamage::Encrypted)),
                _ => Ok(Ok(())),
            },
            Ok(op::CONNECTION) => Ok(self.connections.learn(record)),
            Ok(op::MESSAGE) => self.message(record),
            // Indexes, and opcodes of later versions.
            Ok(_) => Ok(Ok(())),
            Err(why) => Ok(Err(why)),
        }
    }

    fn message(&mut self, record: &BagRecord) -> Result<Result<(), BagDamage>, E> {
        let (id, time) = match (record.number(b"conn", 4), record.time_nanos()) {
            (Ok(id), Ok(time)) => (id as u32, time),
            (Err(why), _) | (_, Err(why)) => return Ok(Err(why)),
        };
        let Some(connection) = self.connections.known.get(&id) else {
            self.report.orphans += 1;
            return Ok(Ok(()));
        };
        self.report.messages += 1;
        let cdr = connection.layout.as_ref().and_then(|layout| layout.cdr(&record.data).ok());
        (self.visit)(&RawMessage {
            topic: &connection.topic,
            type_name: &connection.type_name,
            message_encoding: if cdr.is_some() { "cdr" } else { ROS1_BROKEN },
            log_time_nanos: time,
            publish_time_nanos: time,
            sequence: 0,
            data: cdr.as_deref().unwrap_or(&record.data),
        })?;
        Ok(Ok(()))
    }

    /// The records of a chunk. A bad one loses its own messages, and connections that stand in it alone.
    fn chunk(&mut self, record: &BagRecord, expansion: &mut Expansion) -> Result<Result<(), BagDamage>, E> {
        self.report.chunks += 1;
        let number = self.report.chunks;
        let content = match chunk_content(record, expansion) {
            Ok(content) => content,
            Err(why) => {
                self.report.bad_chunk(number, &why);
                return Ok(Ok(()));
            }
        };
        let mut source = &content[..];
        loop {
            let why = match next_record(&mut source) {
                Ok(None) => return Ok(Ok(())),
                Ok(Some(inner)) if !inner.is_cut => match self.flat(&inner)? {
                    Ok(()) => continue,
                    Err(why) => why,
                },
                // A cut file is reported once, by the caller.
                _ if record.is_cut => return Ok(Ok(())),
                Ok(Some(_)) => BagDamage::Cut,
                Err(why) => why,
            };
            self.report.bad_chunk(number, &why);
            return Ok(Ok(()));
        }
    }
}

/// The records of a chunk, unpacked; of a chunk that was cut, what there is.
fn chunk_content<'a>(record: &'a BagRecord, expansion: &mut Expansion) -> Result<Cow<'a, [u8]>, BagDamage> {
    let size = record.number(b"size", 4)?;
    let compression = record.header.get(&b"compression"[..]).ok_or(BagDamage::Header)?;
    if compression == b"none" {
        return Ok(Cow::Borrowed(&record.data));
    }
    if size > RECORD_LIMIT {
        return Err(BagDamage::LongRecord(size));
    }
    expansion.take(record.data.len() as u64, size)?;
    let mut content = Vec::new();
    let unpacked = match &compression[..] {
        b"lz4" => unpack(lz4::Decoder::new(&record.data[..]), size, &mut content),
        b"bz2" => unpack(Ok(bzip2::read::BzDecoder::new(&record.data[..])), size, &mut content),
        other => return Err(BagDamage::Compression(String::from_utf8_lossy(other).into_owned())),
    };
    if record.is_cut {
        return Ok(Cow::Owned(content));
    }
    unpacked.map_err(BagDamage::Unpack)?;
    if content.len() as u64 != size {
        return Err(BagDamage::Size { has: content.len(), expected: size });
    }
    Ok(Cow::Owned(content))
}

#[cfg(test)]
#[path = "ros1_bag_tests.rs"]
mod tests;
