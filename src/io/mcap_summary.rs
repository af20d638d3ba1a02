//! The summary section at the end of an MCAP file: its channels and where their chunks are.

use std::{collections::BTreeMap, io};

use mcap::records::op;

use super::{
    file_ranges::FileRanges,
    mcap_file::RECORD_LIMIT,
    mcap_record::{
        ChannelRecord, ChunkIndexRecord, SchemaRecord, StatisticsRecord, TAIL, summary_crc, summary_start,
    },
};

/// First read from the end, bytes: the summary of most recordings in one request.
const FIRST_LOOK: u64 = 64 << 10;

/// A channel with its type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SummaryChannel {
    /// Topic name.
    pub topic: String,
    /// Type, e.g. `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// `cdr` for ROS 2.
    pub message_encoding: String,
    /// Messages of it.
    pub count: u64,
}

/// Contents of a file according to its summary.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct McapSummary {
    /// Channels by id.
    pub channels: BTreeMap<u16, SummaryChannel>,
    /// Chunks, in the order of the file.
    pub chunks: Vec<ChunkIndexRecord>,
    /// Where the section begins in the file.
    pub start: u64,
    /// Its schema and channel records as they lie there.
    pub names: Vec<u8>,
}

impl McapSummary {
    /// Reads the summary of a file; `None` unless it names every chunk and channel.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn read(source: &FileRanges) -> io::Result<Option<Self>> {
        let size = source.size();
        if size < TAIL + 8 {
            return Ok(None);
        }
        let look = FIRST_LOOK.min(size);
        let mut end = source.range(size - look, look)?;
        let Some(start) = summary_start(&end, size) else { return Ok(None) };
        if start < size - look {
            let mut front = source.range(start, size - look - start)?;
            front.append(&mut end);
            end = front;
        } else {
            end.drain(..(start - (size - look)) as usize);
        }
        Ok(Self::parse(&end, start).filter(Self::is_sound))
    }

    /// From the bytes between the section's start and the end of the file.
    fn parse(bytes: &[u8], start: u64) -> Option<Self> {
        let (section, tail) = bytes.split_at_checked(bytes.len().checked_sub(TAIL as usize)?)?;
        let expected = summary_crc(&tail[9..29]).ok()?;
        // Up to the checksum itself, by the specification.
        let covered = &bytes[..bytes.len() - 8 - 4];
        if expected != 0 && crc32fast::hash(covered) != expected {
            return None;
        }
        let mut found = Self { start, ..Self::default() };
        let mut types = BTreeMap::new();
        let mut channels = Vec::new();
        let mut statistics = None;
        let mut rest = section;
        while !rest.is_empty() {
            let (opcode, body, behind) = record(rest)?;
            match opcode {
                op::SCHEMA => {
                    let schema = SchemaRecord::read(body).ok()?;
                    types.insert(schema.id, schema.name);
                    found.names.extend_from_slice(&rest[..9 + body.len()]);
                }
                op::CHANNEL => {
                    channels.push(ChannelRecord::read(body).ok()?);
                    found.names.extend_from_slice(&rest[..9 + body.len()]);
                }
                op::CHUNK_INDEX => found.chunks.push(ChunkIndexRecord::read(body).ok()?),
                op::STATISTICS => statistics = Some(StatisticsRecord::read(body).ok()?),
                _ => {}
            }
            rest = behind;
        }
        let statistics = statistics?;
        let counts: BTreeMap<u16, u64> = statistics.messages.iter().copied().collect();
        for c in channels {
            let type_name = types.get(&c.schema_id)?.clone();
            let count = counts.get(&c.id).copied().unwrap_or(0);
            let channel =
                SummaryChannel { topic: c.topic, type_name, message_encoding: c.message_encoding, count };
            // The last of repetitions, as the reader takes it.
            found.channels.insert(c.id, channel);
        }
        found.chunks.sort_by_key(|c| c.start);
        (statistics.chunks == found.chunks.len() as u64 && !found.chunks.is_empty()).then_some(found)
    }

    /// Whether chunks follow one another within the file, and contain only named channels.
    fn is_sound(&self) -> bool {
        let mut at = 8;
        for chunk in &self.chunks {
            let Some(end) =
                chunk.start.checked_add(chunk.bytes).and_then(|e| e.checked_add(chunk.index_bytes))
            else {
                return false;
            };
            let named = chunk.channels.iter().all(|c| self.channels.contains_key(c));
            if chunk.start < at || end > self.start || chunk.bytes < 9 || !named {
                return false;
            }
            // The reader would end there.
            if chunk.bytes - 9 > RECORD_LIMIT {
                return false;
            }
            at = end;
        }
        true
    }
}

/// Opcode and body of the record at the front, and the bytes behind it.
pub fn record(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (front, rest) = bytes.split_first_chunk::<9>()?;
    let length = u64::from_le_bytes(*front[1..].first_chunk()?);
    let (body, behind) = rest.split_at_checked(usize::try_from(length).ok()?)?;
    Some((front[0], body, behind))
}
