//! Reads the records of an MCAP file in place: no length in them leads beyond their bytes, and none causes an
//! allocation.

use mcap::records::op;

use super::ros1msg::ros2_type_name;

/// Length of the end of a file, bytes: footer record (9 + 20) and magic.
pub const TAIL: u64 = 9 + 20 + 8;
/// Largest supported summary section, bytes: 500,000 chunks.
const SUMMARY_LIMIT: u64 = 64 << 20;
/// Longest name of a topic, type or compression, bytes; ROS takes 255.
const MAX_NAME: usize = 4096;

/// Why a record cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RecordError {
    /// A length leads beyond the record.
    #[error("a record names a field of {count} bytes and has {has}")]
    Field {
        /// The length.
        count: usize,
        /// The rest of the record.
        has: usize,
    },
    /// A name of so many bytes.
    #[error("a record holds a name of {0} bytes; {MAX_NAME} are the limit")]
    Name(usize),
    /// A name in other bytes than text.
    #[error("a record holds a name that is no text ({0})")]
    NotText(#[from] std::str::Utf8Error),
}

/// Fields from the front of a record.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn bytes(&mut self, count: usize) -> Result<&'a [u8], RecordError> {
        let (front, rest) =
            self.0.split_at_checked(count).ok_or(RecordError::Field { count, has: self.0.len() })?;
        self.0 = rest;
        Ok(front)
    }

    fn number(&mut self, bytes: usize) -> Result<u64, RecordError> {
        // MCAP is little-endian throughout.
        Ok(self.bytes(bytes)?.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b)))
    }

    fn id(&mut self) -> Result<u16, RecordError> {
        Ok(self.number(2)? as u16)
    }

    /// Bytes behind their length.
    fn counted(&mut self) -> Result<&'a [u8], RecordError> {
        let count = self.number(4)? as usize;
        self.bytes(count)
    }

    fn text(&mut self) -> Result<String, RecordError> {
        let bytes = self.counted()?;
        if bytes.len() > MAX_NAME {
            return Err(RecordError::Name(bytes.len()));
        }
        Ok(std::str::from_utf8(bytes)?.to_owned())
    }
}

/// Longest definition of a type that is kept, bytes; those of ROS have less than 10,000.
const MAX_DEFINITION: usize = 1 << 20;

/// A schema: a type and its definition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SchemaRecord {
    /// Its id.
    pub id: u16,
    /// Name of the type as ROS 2 has it.
    pub name: String,
    /// Form of the definition: `ros2msg`, `ros2idl`, `ros1msg`, ...
    pub encoding: String,
    /// The definition; empty where it is too long or no text.
    pub definition: String,
}

impl SchemaRecord {
    /// Reads the body of a schema record.
    ///
    /// # Errors
    /// [`RecordError`]: the damaged part.
    pub fn read(body: &[u8]) -> Result<Self, RecordError> {
        let mut fields = Fields(body);
        let id = fields.id()?;
        let name = ros2_type_name(&fields.text()?).into_owned();
        let encoding = fields.text()?;
        let definition = fields.counted()?;
        let text = if definition.len() <= MAX_DEFINITION { definition } else { &[] };
        let definition = String::from_utf8(text.to_vec()).unwrap_or_default();
        Ok(Self { id, name, encoding, definition })
    }
}

/// The needed fields of a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChannelRecord {
    /// Its id.
    pub id: u16,
    /// Schema of its messages.
    pub schema_id: u16,
    /// Topic name.
    pub topic: String,
    /// `cdr` for ROS 2.
    pub message_encoding: String,
}

impl ChannelRecord {
    /// Reads the body of a channel record.
    ///
    /// # Errors
    /// [`RecordError`]: the damaged part.
    pub fn read(body: &[u8]) -> Result<Self, RecordError> {
        let mut fields = Fields(body);
        let id = fields.id()?;
        let schema_id = fields.id()?;
        let channel = Self { id, schema_id, topic: fields.text()?, message_encoding: fields.text()? };
        // The metadata must be whole.
        fields.counted()?;
        Ok(channel)
    }
}

/// A message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageRecord<'a> {
    /// Its channel.
    pub channel_id: u16,
    /// Sequence number given by the sender; 0 without one.
    pub sequence: u32,
    /// When it was recorded, nanoseconds.
    pub log_time: u64,
    /// When it was sent, nanoseconds.
    pub publish_time: u64,
    /// Payload.
    pub data: &'a [u8],
}

impl<'a> MessageRecord<'a> {
    /// Reads the body of a message record.
    ///
    /// # Errors
    /// [`RecordError`]: the damaged part.
    pub fn read(body: &'a [u8]) -> Result<Self, RecordError> {
        let mut fields = Fields(body);
        let channel_id = fields.id()?;
        let sequence = fields.number(4)? as u32;
        let log_time = fields.number(8)?;
        let publish_time = fields.number(8)?;
        Ok(Self { channel_id, sequence, log_time, publish_time, data: fields.0 })
    }
}

/// The needed fields at the front of a chunk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChunkRecord<'a> {
    /// Bytes of its records.
    pub uncompressed_size: u64,
    /// Their checksum; 0 = none.
    pub uncompressed_crc: u32,
    /// Name of the compression; empty = none.
    pub compression: String,
    /// Bytes of its compressed records.
    pub compressed_size: u64,
    /// The available bytes of the records.
    pub data: &'a [u8],
}

impl<'a> ChunkRecord<'a> {
    /// Reads the body of a chunk record. It may be cut within its records.
    ///
    /// # Errors
    /// [`RecordError`]: the damaged part.
    pub fn read(body: &'a [u8]) -> Result<Self, RecordError> {
        let mut fields = Fields(body);
        // First and last log time of the chunk: the messages carry their own.
        fields.bytes(16)?;
        let uncompressed_size = fields.number(8)?;
        let uncompressed_crc = fields.number(4)? as u32;
        let compression = fields.text()?;
        let compressed_size = fields.number(8)?;
        Ok(Self { uncompressed_size, uncompressed_crc, compression, compressed_size, data: fields.0 })
    }
}

/// A chunk by the summary.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChunkIndexRecord {
    /// Where its record begins in the file.
    pub start: u64,
    /// Bytes of its record, opcode and length included.
    pub bytes: u64,
    /// Channels of its messages; none where the writer indexed no messages.
    pub channels: Vec<u16>,
    /// Bytes of the message indexes behind it.
    pub index_bytes: u64,
}

impl ChunkIndexRecord {
    /// Reads the body of a chunk index record.
    ///
    /// # Errors
    /// [`RecordError`]: the damaged part.
    pub fn read(body: &[u8]) -> Result<Self, RecordError> {
        let mut fields = Fields(body);
        // Recording times of the first and last message.
        fields.bytes(16)?;
        let start = fields.number(8)?;
        let bytes = fields.number(8)?;
        let mut offsets = Fields(fields.counted()?);
        let mut channels = Vec::new();
        while !offsets.0.is_empty() {
            channels.push(offsets.id()?);
            offsets.bytes(8)?;
        }
        Ok(Self { start, bytes, channels, index_bytes: fields.number(8)? })
    }
}

/// Counts of the summary.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StatisticsRecord {
    /// Chunks of the file.
    pub chunks: u64,
    /// Messages of each channel.
    pub messages: Vec<(u16, u64)>,
}

impl StatisticsRecord {
    /// Reads the body of a statistics record.
    ///
    /// # Errors
    /// [`RecordError`]: the damaged part.
    pub fn read(body: &[u8]) -> Result<Self, RecordError> {
        let mut fields = Fields(body);
        // Messages, schemas, channels, attachments, metadata.
        fields.bytes(8 + 2 + 4 + 4 + 4)?;
        let chunks = fields.number(4)?;
        fields.bytes(16)?;
        let mut counts = Fields(fields.counted()?);
        let mut messages = Vec::new();
        while !counts.0.is_empty() {
            messages.push((counts.id()?, counts.number(8)?));
        }
        Ok(Self { chunks, messages })
    }
}

/// Where the summary begins, by the last bytes of a file of this size.
pub fn summary_start(end: &[u8], size: u64) -> Option<u64> {
    let tail = &end[end.len().checked_sub(TAIL as usize)?..];
    if tail[0] != op::FOOTER || tail[1..9] != 20u64.to_le_bytes() || tail[29..] != *mcap::MAGIC {
        return None;
    }
    let start = Fields(&tail[9..29]).number(8).ok()?;
    // 0 stands for no checksum.
    (start > 8 && start < size - TAIL && size - TAIL - start <= SUMMARY_LIMIT).then_some(start)
}

/// Checksum of a summary and of the footer before it, by the body of the footer; 0 = none.
///
/// # Errors
/// [`RecordError`]: the damaged part.
pub fn summary_crc(footer: &[u8]) -> Result<u32, RecordError> {
    let mut fields = Fields(footer);
    fields.bytes(16)?;
    Ok(fields.number(4)? as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(of: &str) -> Vec<u8> {
        [&(of.len() as u32).to_le_bytes()[..], of.as_bytes()].concat()
    }

    #[test]
    fn records_are_read() {
        let schema =
            [&[7, 0][..], &text("std_msgs/msg/String"), &text("ros2msg"), &text("string data")].concat();
        let expected = SchemaRecord {
            id: 7,
            name: "std_msgs/msg/String".into(),
            encoding: "ros2msg".into(),
            definition: "string data".into(),
        };
        assert_eq!(SchemaRecord::read(&schema), Ok(expected));
        let channel = [&[1, 1, 7, 0][..], &text("/a"), &text("cdr"), &text("")].concat();
        let read = ChannelRecord::read(&channel).unwrap();
        assert_eq!(
            (read.id, read.schema_id, read.topic.as_str(), read.message_encoding.as_str()),
            (257, 7, "/a", "cdr")
        );
        let message =
            [&[1, 1][..], &3u32.to_le_bytes(), &5u64.to_le_bytes(), &4u64.to_le_bytes(), b"payload"].concat();
        let expected =
            MessageRecord { channel_id: 257, sequence: 3, log_time: 5, publish_time: 4, data: b"payload" };
        assert_eq!(MessageRecord::read(&message), Ok(expected));
    }

    #[test]
    fn lengths_beyond_the_record_are_refused() {
        let huge = u32::MAX.to_le_bytes();
        for body in [
            [&[7, 0][..], &huge].concat(),
            [&[7, 0][..], &text("a"), &huge].concat(),
            [&[7, 0][..], &text("a"), &text("b"), &huge, b"short"].concat(),
        ] {
            let why = SchemaRecord::read(&body).unwrap_err();
            assert!(matches!(why, RecordError::Field { count: 0xffff_ffff, .. }), "{why}");
        }
        assert!(ChannelRecord::read(&[&[0; 4][..], &text("/a"), &text("cdr"), &huge].concat()).is_err());
        assert!(MessageRecord::read(&[0; 21]).is_err());
        assert!(ChunkRecord::read(&[&[0; 28][..], &huge].concat()).is_err());
        let bytes = SchemaRecord::read(&[&[7, 0][..], &2u32.to_le_bytes(), &[0xff, 0xfe]].concat());
        assert!(matches!(bytes, Err(RecordError::NotText(_))));
        assert!(summary_start(&[0; 7], 7).is_none());
    }
}
