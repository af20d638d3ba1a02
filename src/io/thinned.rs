//! What of a chunk is needed, where its records are stored as they are: the message indexes behind it say
//! where each message begins.
//!
//! A chunk with a checksum is taken whole: damage in it must be found, not read.

use std::{
    collections::{BTreeMap, BTreeSet},
    io,
    ops::Range,
};

use mcap::records::op;

use super::{
    mcap_record::{ChunkIndexRecord, ChunkRecord, MessageIndexRecord},
    mcap_summary::{McapSummary, record},
    ranges::{Piece, Ranges as _},
    remembered::Remembered,
};

/// A chunk of fewer bytes is taken whole: its message index alone costs a request.
const LEAST: u64 = if cfg!(test) { 500 } else { 256 << 10 };
/// Most bytes of the message indexes of a chunk.
const MAX_INDEX: u64 = 1 << 20;
/// Most bytes of all message indexes that are looked at.
const MAX_INDEXES: u64 = 32 << 20;
/// Opcode and length of a record.
const FRONT: u64 = 9;
/// Front and fields of a chunk without a name of its compression.
const HEADER: u64 = FRONT + 8 + 8 + 8 + 4 + 4 + 8;

/// The pieces of chunks, by where these begin, of which only messages of some channels are needed. `channels`
/// gives the needed channels of a chunk.
///
/// # Errors
/// Where the file cannot be read.
pub fn thinned(
    file: &Remembered,
    summary: &McapSummary,
    channels: &dyn Fn(&ChunkIndexRecord) -> BTreeSet<u16>,
) -> io::Result<BTreeMap<u64, Vec<Piece>>> {
    let may_be = |chunk: &&ChunkIndexRecord| {
        let needed = channels(chunk).len();
        chunk.is_stored
            && chunk.bytes >= LEAST
            && (1..=MAX_INDEX).contains(&chunk.index_bytes)
            && needed > 0
            && needed < chunk.channels.len()
    };
    let chunks: Vec<&ChunkIndexRecord> = summary.chunks.iter().filter(may_be).collect();
    let Some(first) = chunks.first() else { return Ok(BTreeMap::new()) };
    // One writer writes all chunks alike.
    let header = file.range(first.start, HEADER.min(first.bytes))?;
    let has_no_checksum = ChunkRecord::read(&header[FRONT as usize..]).is_ok_and(|c| c.uncompressed_crc == 0);
    if !has_no_checksum || chunks.iter().map(|c| c.index_bytes).sum::<u64>() > MAX_INDEXES {
        return Ok(BTreeMap::new());
    }
    let behind = |c: &&ChunkIndexRecord| c.start + c.bytes..c.start + c.bytes + c.index_bytes;
    let indexes = file.many(&chunks.iter().map(behind).collect::<Vec<_>>())?;
    let thin = |(chunk, index): (&&ChunkIndexRecord, Vec<u8>)| {
        Some((chunk.start, pieces(chunk, &messages(chunk, &index)?, &channels(chunk))?))
    };
    Ok(chunks.iter().zip(indexes).filter_map(thin).collect())
}

/// Where the messages of a chunk begin within its records, with their channels, in order; `None` where its
/// indexes do not name each of its channels once.
fn messages(chunk: &ChunkIndexRecord, index: &[u8]) -> Option<Vec<(u64, u16)>> {
    let (mut found, mut named, mut rest) = (Vec::new(), Vec::new(), index);
    while !rest.is_empty() {
        let (opcode, body, behind) = record(rest)?;
        if opcode != op::MESSAGE_INDEX {
            return None;
        }
        let of = MessageIndexRecord::read(body).ok()?;
        named.push(of.channel_id);
        found.extend(of.offsets.iter().map(|offset| (*offset, of.channel_id)));
        rest = behind;
    }
    found.sort_unstable();
    named.sort_unstable();
    let mut expected = chunk.channels.clone();
    expected.sort_unstable();
    let is_sound = found.windows(2).all(|w| w[0].0 < w[1].0)
        && found.last().is_some_and(|(offset, _)| *offset < chunk.bytes.saturating_sub(HEADER));
    (named == expected && is_sound).then_some(found)
}

/// A chunk with the messages of the needed channels alone, and what stands before the first message.
fn pieces(chunk: &ChunkIndexRecord, messages: &[(u64, u16)], needed: &BTreeSet<u16>) -> Option<Vec<Piece>> {
    let records = chunk.start + HEADER;
    let end = chunk.bytes.checked_sub(HEADER)?;
    let mut kept: Vec<Range<u64>> = Vec::new();
    let mut keep = |from: u64, to: u64| match kept.last_mut() {
        Some(open) if open.end == records + from => open.end = records + to,
        _ if from < to => kept.push(records + from..records + to),
        _ => {}
    };
    keep(0, messages.first()?.0);
    for (i, (from, channel)) in messages.iter().enumerate() {
        if needed.contains(channel) {
            keep(*from, messages.get(i + 1).map_or(end, |next| next.0));
        }
    }
    let bytes: u64 = kept.iter().map(|r| r.end - r.start).sum();
    let header = [
        &[op::CHUNK][..],
        &(HEADER - FRONT + bytes).to_le_bytes(),
        &chunk.times[0].to_le_bytes(),
        &chunk.times[1].to_le_bytes(),
        &bytes.to_le_bytes(),
        // No checksum, no compression.
        &[0; 4 + 4],
        &bytes.to_le_bytes(),
    ]
    .concat();
    Some(std::iter::once(Piece::Made(header)).chain(kept.into_iter().map(Piece::Stored)).collect())
}
