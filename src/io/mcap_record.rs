//! Reads the records of an MCAP file by the layouts of the mcap crate. Its own readers stop where a chunk is
//! cut; these read what is there. No length in a record leads beyond its bytes, and memory grows with the
//! bytes read.

use std::io::Cursor;

use binrw::BinRead;
use mcap::records::{ChunkIndex, Footer, SchemaHeader, op};

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
    /// The fields of a record of so many bytes.
    #[error("a record of {0} bytes names a longer field, or holds a name that is no text")]
    Fields(usize),
    /// A name of so many bytes.
    #[error("a record holds a name of {0} bytes; {MAX_NAME} are the limit")]
    Name(usize),
}

/// The fields at the front of a record's body, and the bytes behind them.
///
/// # Errors
/// [`RecordError::Fields`].
pub fn front_fields<T>(body: &[u8]) -> Result<(T, &[u8]), RecordError>
where
    T: for<'a> BinRead<Args<'a> = ()>,
{
    let mut cursor = Cursor::new(body);
    // The crate's error prints its own source lines.
    let Ok(fields) = T::read_le(&mut cursor) else { return Err(RecordError::Fields(body.len())) };
    Ok((fields, &body[cursor.position() as usize..]))
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
    /// Reads the body of a schema record; its definition must be whole.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn read(body: &[u8]) -> Result<Self, RecordError> {
        let (schema, rest) = front_fields::<SchemaHeader>(body)?;
        let (length, definition) = front_fields::<u32>(rest)?;
        let definition = definition.get(..length as usize).ok_or(RecordError::Fields(body.len()))?;
        let text = if definition.len() <= MAX_DEFINITION { definition } else { &[] };
        Ok(Self {
            id: schema.id,
            name: ros2_type_name(&limited_name(schema.name)?).into_owned(),
            encoding: limited_name(schema.encoding)?,
            definition: String::from_utf8(text.to_vec()).unwrap_or_default(),
        })
    }
}

/// A name that is not too long.
///
/// # Errors
/// [`RecordError::Name`].
pub fn limited_name(name: String) -> Result<String, RecordError> {
    if name.len() > MAX_NAME { Err(RecordError::Name(name.len())) } else { Ok(name) }
}

/// A chunk by the summary.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChunkPlace {
    /// Where its record begins in the file.
    pub start: u64,
    /// Bytes of its record, opcode and length included.
    pub bytes: u64,
    /// Channels of its messages; none where the writer indexed no messages.
    pub channels: Vec<u16>,
    /// Bytes of the message indexes behind it.
    pub index_bytes: u64,
}

impl From<ChunkIndex> for ChunkPlace {
    fn from(index: ChunkIndex) -> Self {
        Self {
            start: index.chunk_start_offset,
            bytes: index.chunk_length,
            channels: index.message_index_offsets.into_keys().collect(),
            index_bytes: index.message_index_length,
        }
    }
}

/// Where the summary begins, by the last bytes of a file of this size.
pub fn summary_start(end: &[u8], size: u64) -> Option<u64> {
    let tail = &end[end.len().checked_sub(TAIL as usize)?..];
    if tail[0] != op::FOOTER || tail[1..9] != 20u64.to_le_bytes() || tail[29..] != *mcap::MAGIC {
        return None;
    }
    let start = front_fields::<Footer>(&tail[9..29]).ok()?.0.summary_start;
    // 0 stands for no checksum.
    (start > 8 && start < size - TAIL && size - TAIL - start <= SUMMARY_LIMIT).then_some(start)
}

#[cfg(test)]
mod tests {
    use mcap::records::{Channel, ChunkHeader, MessageHeader};

    use super::*;

    fn text(of: &str) -> Vec<u8> {
        [&(of.len() as u32).to_le_bytes()[..], of.as_bytes()].concat()
    }

    #[test]
    fn lengths_beyond_the_record_are_refused() {
        let schema = [&[7, 0][..], &text("std_msgs/msg/String"), &text("ros2msg"), &text("string")].concat();
        let expected = SchemaRecord {
            id: 7,
            name: "std_msgs/msg/String".into(),
            encoding: "ros2msg".into(),
            definition: "string".into(),
        };
        assert_eq!(SchemaRecord::read(&schema), Ok(expected));
        assert_eq!(
            SchemaRecord::read(&schema[..schema.len() - 1]),
            Err(RecordError::Fields(schema.len() - 1))
        );
        let huge = u32::MAX.to_le_bytes();
        for body in [
            [&[7, 0][..], &huge].concat(),
            [&[7, 0][..], &text("a"), &huge].concat(),
            [&[7, 0][..], &text("a"), &text("b"), &huge, b"short"].concat(),
            [&[7, 0][..], &2u32.to_le_bytes(), &[0xff, 0xfe]].concat(),
        ] {
            assert_eq!(SchemaRecord::read(&body), Err(RecordError::Fields(body.len())));
        }
        let long = [&[7, 0][..], &text(&"a".repeat(5000)), &text("b"), &text("")].concat();
        assert_eq!(SchemaRecord::read(&long), Err(RecordError::Name(5000)));
        let channel = [&[0; 4][..], &text("/a"), &text("cdr"), &huge].concat();
        assert!(front_fields::<Channel>(&channel).is_err());
        assert!(front_fields::<MessageHeader>(&[0; 21]).is_err());
        assert!(front_fields::<ChunkHeader>(&[&[0; 28][..], &huge].concat()).is_err());
        assert!(summary_start(&[0; 7], 7).is_none());
    }
}
