//! Which bytes of a bag a command needs: the chunks that hold messages of the topics that it reads.
//!
//! An excerpt is an MCAP file with the same messages of these topics in the same order. The topics are those
//! that the reader of the whole bag would choose; where that is in doubt, a topic is kept, and where a file
//! says nothing certain of itself, all of it is.

use std::{
    collections::{BTreeMap, BTreeSet},
    io,
    path::Path,
};

use mcap::records::op;

use super::{
    bag_index::BETWEEN_NANOS,
    expansion::Expansion,
    imu::IMU_TYPE,
    joint_log::is_joint_topic,
    mcap_file::{Channels, RawMessage, read_messages},
    mcap_record::ChunkIndexRecord,
    mcap_summary::McapSummary,
    ranges::{Piece, Ranges, stored_bytes},
    remembered::Remembered,
    ros2msg::{CameraInfo, CompressedFront, DecodeError, ImageFront, decode},
    thinned::thinned,
    topics::{IMAGE_TYPES, INFO_TYPE, POSE_TYPES, TopicSummary, choose, rivals},
};
use crate::{
    capture::{CaptureConfig, Split},
    gap::record::tracks::Streams,
};

/// Most image topics whose first messages are looked at.
const MAX_IMAGE_TOPICS: usize = 64;
/// Largest chunk whose first messages are looked at, bytes.
const MAX_LOOK: u64 = 64 << 20;
/// An excerpt of more than this share of a file is the file itself.
const WORTH: f64 = 0.95;

/// What is read from a bag.
#[derive(Clone, Copy, Debug)]
pub enum Wanted<'a> {
    /// Everything.
    All,
    /// RGB-D views, as a reconstruction takes them.
    Views(&'a CaptureConfig),
    /// Joints and what is recorded beside them.
    Joints(&'a Streams),
    /// RGB-D views, and joints that are recorded beside them.
    ViewsAndJoints(&'a CaptureConfig, &'a Streams),
}

/// The excerpts of the files of one bag, in their order.
///
/// # Errors
/// Where a file cannot be read.
pub fn excerpts(files: &[Remembered], wanted: Wanted) -> io::Result<Vec<Vec<Piece>>> {
    let whole = || files.iter().map(|f| vec![Piece::Stored(0..f.size())]).collect();
    let Some(bag) = summaries(files)? else { return Ok(whole()) };
    let Some(needed) = needed(files, &bag, wanted)? else { return Ok(whole()) };
    let between = between(&bag, wanted);
    let cut = |(file, summary): (&Remembered, &McapSummary)| {
        excerpt(file, summary, &needed, (between.as_ref(), splits(wanted)))
    };
    files.iter().zip(&bag).map(cut).collect()
}

/// The summaries of all files; `None` where one has none.
///
/// # Errors
/// Where a file cannot be read.
pub fn summaries(files: &[Remembered]) -> io::Result<Option<Vec<McapSummary>>> {
    let mut all = Vec::new();
    for file in files {
        // What is no MCAP file is refused by its reader.
        if file.size() < 8 || file.range(0, 8)? != mcap::MAGIC {
            return Ok(None);
        }
        let Some(summary) = McapSummary::read(file)? else { return Ok(None) };
        all.push(summary);
    }
    Ok(Some(all))
}

/// Names of the topics that are needed; `None` where that cannot be said.
fn needed(files: &[Remembered], bag: &[McapSummary], wanted: Wanted) -> io::Result<Option<BTreeSet<String>>> {
    Ok(match wanted {
        Wanted::All => None,
        Wanted::Views(config) => for_views(files, bag, config)?,
        Wanted::Joints(streams) => for_joints(bag, streams),
        Wanted::ViewsAndJoints(config, streams) => for_views(files, bag, config)?.map(|mut names| {
            names.extend(for_joints(bag, streams).unwrap_or_default());
            names
        }),
    })
}

fn for_joints(bag: &[McapSummary], streams: &Streams) -> Option<BTreeSet<String>> {
    let channels = || bag.iter().flat_map(|s| s.channels.values()).filter(|c| c.count > 0);
    let named = streams.wrenches.iter().chain(&streams.poses).map(|(t, _)| t);
    // A refusal lists all topics of a bag: it is made from all of it.
    if named.chain(streams.commands.iter().map(|(t, _)| t)).any(|t| channels().all(|c| c.topic != *t)) {
        return None;
    }
    let reads = |c: &&super::mcap_summary::SummaryChannel| {
        is_joint_topic(&c.topic, &c.type_name, c.message_encoding == "cdr", streams)
    };
    let names: BTreeSet<String> = channels().filter(reads).map(|c| c.topic.clone()).collect();
    (!names.is_empty()).then_some(names)
}

fn for_views(
    files: &[Remembered],
    bag: &[McapSummary],
    config: &CaptureConfig,
) -> io::Result<Option<BTreeSet<String>>> {
    let Some(topics) = topics_of(files, bag)? else { return Ok(None) };
    // A refusal lists all topics of a bag: it is made from all of it.
    let Ok(choice) = choose(&topics, &config.topics, Path::new("")) else { return Ok(None) };
    let mut names: BTreeSet<String> = BTreeSet::new();
    for chosen in [Some(&choice.color), Some(&choice.depth), choice.mask.as_ref()].into_iter().flatten() {
        names.insert(chosen.clone());
        names.extend(rivals(&topics, chosen).into_iter().map(str::to_owned));
    }
    names.extend(choice.marker);
    // Poses, transforms and cameras come from several topics, and are small.
    let small = |t: &&TopicSummary| {
        let kind = t.type_name.as_str();
        POSE_TYPES.contains(&kind) || [INFO_TYPE, IMU_TYPE, "tf2_msgs/msg/TFMessage"].contains(&kind)
    };
    names.extend(topics.iter().filter(small).map(|t| t.name.clone()));
    Ok(Some(names))
}

/// The topics of a bag as the choice between them needs them, images with the encoding of their first
/// message.
///
/// # Errors
/// Where a file cannot be read.
pub fn topics_of(files: &[Remembered], bag: &[McapSummary]) -> io::Result<Option<Vec<TopicSummary>>> {
    let mut topics: BTreeMap<&str, TopicSummary> = BTreeMap::new();
    for channel in bag.iter().flat_map(|s| s.channels.values()).filter(|c| c.count > 0) {
        let topic = topics.entry(&channel.topic).or_insert_with(|| TopicSummary {
            name: channel.topic.clone(),
            type_name: channel.type_name.clone(),
            ..TopicSummary::default()
        });
        // ROS 1, or a topic of two types: the reader of the whole says what it makes of that.
        if channel.message_encoding != "cdr" || topic.type_name != channel.type_name {
            return Ok(None);
        }
        topic.count += usize::try_from(channel.count).unwrap_or(usize::MAX);
    }
    let images: Vec<String> = topics
        .values()
        .filter(|t| IMAGE_TYPES.contains(&t.type_name.as_str()))
        .map(|t| t.name.clone())
        .collect();
    if images.len() > MAX_IMAGE_TOPICS {
        return Ok(None);
    }
    for name in images {
        match first_image(files, bag, &name)? {
            Some(front) => {
                if let Some(topic) = topics.get_mut(name.as_str()) {
                    topic.encoding = front.encoding;
                }
            }
            None => return Ok(None),
        }
    }
    Ok(Some(topics.into_values().collect()))
}

/// What the first message of an image topic says of itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FirstImage {
    /// Encoding or format.
    pub encoding: String,
    /// Width and height, pixels, where it says so.
    pub size: Option<(u32, u32)>,
}

/// The first image or camera of a topic; `None` where it cannot be read.
///
/// # Errors
/// Where a file cannot be read.
pub fn first_image(files: &[Remembered], bag: &[McapSummary], topic: &str) -> io::Result<Option<FirstImage>> {
    for (file, summary) in files.iter().zip(bag) {
        let holds = |c: &u16| summary.channels.get(c).is_some_and(|c| c.topic == topic);
        for chunk in summary.chunks.iter().filter(|c| c.channels.is_empty() || c.channels.iter().any(holds)) {
            if chunk.bytes > MAX_LOOK {
                return Ok(None);
            }
            let records = file.range(chunk.start, chunk.bytes)?;
            // A file of this chunk alone, with the names of all channels.
            let alone = [mcap::MAGIC, &summary.names[..], &records, &[op::DATA_END], &[0; 8]].concat();
            let mut found = None;
            let mut first = |message: &RawMessage| -> Result<(), DecodeError> {
                if message.topic == topic && found.is_none() {
                    found = Some(front(message)?);
                }
                Ok(())
            };
            let mut expansion = Expansion::of(file.size());
            if read_messages(&alone[..], &mut Channels::default(), &mut expansion, &mut first).is_err() {
                return Ok(None);
            }
            if found.is_some() {
                return Ok(found);
            }
            // An index that names a message where none can be read.
            if !chunk.channels.is_empty() {
                return Ok(None);
            }
        }
    }
    Ok(None)
}

fn front(message: &RawMessage) -> Result<FirstImage, DecodeError> {
    if message.type_name == INFO_TYPE {
        let info: CameraInfo = decode(message.data)?;
        return Ok(FirstImage { encoding: String::new(), size: Some((info.width, info.height)) });
    }
    if message.type_name == IMAGE_TYPES[0] {
        let front: ImageFront = decode(message.data)?;
        return Ok(FirstImage { encoding: front.encoding, size: Some((front.width, front.height)) });
    }
    let front: CompressedFront = decode(message.data)?;
    Ok(FirstImage { encoding: front.format, size: None })
}

/// Whether the recording is divided by time.
fn splits(wanted: Wanted) -> bool {
    matches!(wanted, Wanted::Views(config) if !config.split_secs.is_empty())
}

/// The split of a bag, where images between two states are left out.
fn between(bag: &[McapSummary], wanted: Wanted) -> Option<Split> {
    let Wanted::Views(config) = wanted else { return None };
    let [_, _] = config.split_secs[..] else { return None };
    let chunks = || bag.iter().flat_map(|s| &s.chunks);
    let nanos = |n: u64| i64::try_from(n).unwrap_or(i64::MAX);
    let first = chunks().map(|c| nanos(c.times[0])).min()?;
    // A split outside the recording is refused by its reader.
    Split::at(&config.split_secs, first, chunks().map(|c| nanos(c.times[1])).max()?).ok()
}

/// The excerpt of a file: with the ends of the recording where it is divided by time, and without the images
/// between two states.
///
/// # Errors
/// Where the file cannot be read.
fn excerpt(
    file: &Remembered,
    summary: &McapSummary,
    needed: &BTreeSet<String>,
    (between, splits): (Option<&Split>, bool),
) -> io::Result<Vec<Piece>> {
    let is_between = |nanos: &u64| {
        between.is_some_and(|s| i64::try_from(*nanos).is_ok_and(|n| s.is_between(n, BETWEEN_NANOS)))
    };
    // Poses and transforms of all times are taken together.
    let channels = |chunk: &ChunkIndexRecord| -> BTreeSet<u16> {
        let no_images = chunk.times.iter().all(is_between);
        let is_needed = |c: &&u16| {
            summary.channels.get(c).is_some_and(|c| {
                needed.contains(&c.topic) && !(no_images && IMAGE_TYPES.contains(&c.type_name.as_str()))
            })
        };
        chunk.channels.iter().filter(is_needed).copied().collect()
    };
    let mut thin = thinned(file, summary, &channels)?;
    // A split is counted from the first message of all, whatever its topic.
    let first = summary.chunks.iter().min_by_key(|c| c.times[0]).map(|c| c.start);
    let last = summary.chunks.iter().max_by_key(|c| c.times[1]).map(|c| c.start);
    let mut pieces: Vec<Piece> = Vec::new();
    let mut keep = |piece: Piece| match (pieces.last_mut(), piece) {
        (_, Piece::Stored(range)) if range.is_empty() => {}
        (Some(Piece::Stored(open)), Piece::Stored(range)) if open.end == range.start => open.end = range.end,
        (_, piece) => pieces.push(piece),
    };
    let mut at = 0;
    for chunk in &summary.chunks {
        // What lies between chunks: the header, and records that no index names.
        keep(Piece::Stored(at..chunk.start));
        let at_an_end = splits && (Some(chunk.start) == first || Some(chunk.start) == last);
        if at_an_end || chunk.channels.is_empty() {
            keep(Piece::Stored(chunk.start..chunk.start + chunk.bytes));
        } else if let Some(parts) = thin.remove(&chunk.start) {
            parts.into_iter().for_each(&mut keep);
        } else if !channels(chunk).is_empty() {
            keep(Piece::Stored(chunk.start..chunk.start + chunk.bytes));
        }
        at = chunk.start + chunk.bytes + chunk.index_bytes;
    }
    keep(Piece::Stored(at..summary.start));
    if stored_bytes(&pieces) as f64 > WORTH * file.size() as f64 {
        return Ok(vec![Piece::Stored(0..file.size())]);
    }
    let made = |p: &Piece| if let Piece::Made(bytes) = p { bytes.len() as u64 } else { 0 };
    let bytes = stored_bytes(&pieces) + pieces.iter().map(made).sum::<u64>();
    pieces.push(Piece::Made(end(bytes, &summary.names)));
    Ok(pieces)
}

/// The end of a file whose data takes so many bytes: the names of all channels, a footer and the magic.
fn end(start: u64, names: &[u8]) -> Vec<u8> {
    // Without names there is no summary; without a checksum none is looked at.
    let start = if names.is_empty() { 0 } else { start };
    let footer = [&[op::FOOTER][..], &20u64.to_le_bytes(), &start.to_le_bytes(), &[0; 12]].concat();
    [names, &footer, mcap::MAGIC].concat()
}

#[cfg(test)]
#[path = "excerpt_tests.rs"]
mod tests;
