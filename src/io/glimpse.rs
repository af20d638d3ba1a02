//! Estimates from its summary and a few messages how much a recording contains, to predict the cost of a run.

use std::{
    collections::BTreeMap,
    io,
    path::{Path, PathBuf},
};

use mcap::records::op;

use super::{
    bag::Bag,
    expansion::Expansion,
    file_ranges::FileRanges,
    joint_log::is_joint_topic,
    mcap_file::{Channels, RawMessage, read_messages},
    mcap_summary::McapSummary,
    ros1msg::ROS1,
    ros2msg::{CameraInfo, CompressedFront, DecodeError, ImageFront, decode},
    source::Source,
    topics::{IMAGE_TYPES, INFO_TYPE, TopicSummary, choose},
};
use capture::CaptureConfig;
use gap::record::tracks::Streams;

/// Largest number of image topics whose first messages are read.
const MAX_IMAGE_TOPICS: usize = 64;
/// Largest chunk whose first messages are read, bytes.
const MAX_LOOK: u64 = 64 << 20;

/// How many views a bag contains.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Glimpse {
    /// Number of color images; `None` if the bag does not say.
    pub frames: Option<u64>,
    /// Columns and rows of the color images.
    pub size: Option<(u32, u32)>,
}

/// Looks at the bags of recordings, each of one state or of all; a dataset gives an empty result.
///
/// # Errors
/// If a file cannot be read.
pub fn glimpse_views(paths: &[PathBuf], config: &CaptureConfig) -> io::Result<Vec<Glimpse>> {
    let bags = match Source::of(paths) {
        Ok(Source::States(paths)) => paths,
        Ok(Source::Both(path)) => vec![path],
        // The command itself refuses everything else.
        _ => return Ok(vec![Glimpse::default()]),
    };
    bags.iter().map(|path| glimpse_of_bag(path, config)).collect()
}

fn glimpse_of_bag(path: &Path, config: &CaptureConfig) -> io::Result<Glimpse> {
    let Ok(bag) = Bag::open(path) else { return Ok(Glimpse::default()) };
    if let Some(images) = &bag.images {
        let (frames, size) = images.views();
        return Ok(Glimpse { frames: Some(frames), size });
    }
    let Some(summaries) = Summaries::of(&bag)? else { return Ok(Glimpse::default()) };
    Ok(summaries.views(config)?.unwrap_or_default())
}

/// Number of messages about joints in a bag; 0 if the bag does not say.
///
/// # Errors
/// If a file cannot be read.
pub fn count_joint_messages(path: &Path, streams: &Streams) -> io::Result<u64> {
    let Ok(bag) = Bag::open(path) else { return Ok(0) };
    let Some(summaries) = Summaries::of(&bag)? else { return Ok(0) };
    let channels = summaries.all.iter().flat_map(|(_, s)| s.channels.values());
    let read = channels.filter(|c| {
        is_joint_topic(&c.topic, &c.type_name, ["cdr", ROS1].contains(&c.message_encoding.as_str()), streams)
    });
    Ok(read.map(|c| c.count).sum())
}

/// The files of a bag with their summaries.
struct Summaries {
    all: Vec<(FileRanges, McapSummary)>,
}

impl Summaries {
    /// `None` where a file has none.
    fn of(bag: &Bag) -> io::Result<Option<Self>> {
        let mut all = Vec::new();
        for path in &bag.files {
            let file = FileRanges::open(path)?;
            // The reader refuses other files than MCAP.
            if file.size() < 8 || file.range(0, 8)? != mcap::MAGIC {
                return Ok(None);
            }
            let Some(summary) = McapSummary::read(&file)? else { return Ok(None) };
            all.push((file, summary));
        }
        Ok(Some(Self { all }))
    }

    fn views(&self, config: &CaptureConfig) -> io::Result<Option<Glimpse>> {
        let Some(topics) = self.topics()? else { return Ok(None) };
        let Ok(choice) = choose(&topics, &config.topics, Path::new("")) else { return Ok(None) };
        let frames = topics.iter().find(|t| t.name == choice.color).map(|t| t.count as u64);
        let mut size = self.first_image(&choice.color)?.and_then(|i| i.size);
        if size.is_none() {
            size = self.first_image(&choice.color_info)?.and_then(|i| i.size);
        }
        Ok(Some(Glimpse { frames, size }))
    }

    /// A summary of each topic, for choosing among them; images have the encoding of their first message.
    fn topics(&self) -> io::Result<Option<Vec<TopicSummary>>> {
        let mut topics: BTreeMap<&str, TopicSummary> = BTreeMap::new();
        let channels = self.all.iter().flat_map(|(_, s)| s.channels.values());
        for channel in channels.filter(|c| c.count > 0) {
            let topic = topics.entry(&channel.topic).or_insert_with(|| TopicSummary {
                name: channel.topic.clone(),
                type_name: channel.type_name.clone(),
                ..TopicSummary::default()
            });
            // JSON, or a topic of two types: the reader of the whole bag reports it.
            if !["cdr", ROS1].contains(&channel.message_encoding.as_str())
                || topic.type_name != channel.type_name
            {
                return Ok(None);
            }
            topic.count += usize::try_from(channel.count).unwrap_or(usize::MAX);
        }
        let images = topics.values_mut().filter(|t| IMAGE_TYPES.contains(&t.type_name.as_str()));
        for (i, topic) in images.enumerate() {
            if i == MAX_IMAGE_TOPICS {
                return Ok(None);
            }
            let Some(front) = self.first_image(&topic.name)? else { return Ok(None) };
            topic.encoding = front.encoding;
        }
        Ok(Some(topics.into_values().collect()))
    }

    /// The first image or camera of a topic; `None` where it cannot be read.
    fn first_image(&self, topic: &str) -> io::Result<Option<FirstImage>> {
        for (file, summary) in &self.all {
            let holds = |c: &u16| summary.channels.get(c).is_some_and(|c| c.topic == topic);
            let may_hold = |channels: &[u16]| channels.is_empty() || channels.iter().any(holds);
            for chunk in summary.chunks.iter().filter(|c| may_hold(&c.channels)) {
                if chunk.bytes > MAX_LOOK {
                    return Ok(None);
                }
                let records = file.range(chunk.start, chunk.bytes)?;
                // A file of this chunk alone, with the names of all channels.
                let alone = [mcap::MAGIC, &summary.names[..], &records, &[op::DATA_END], &[0; 8]].concat();
                let mut found = None;
                let mut expansion = Expansion::of(file.size());
                let read = read_messages(
                    &alone[..],
                    &mut Channels::default(),
                    &mut expansion,
                    &mut |message: &RawMessage| -> Result<(), DecodeError> {
                        if message.topic == topic && found.is_none() {
                            found = Some(front(message)?);
                        }
                        Ok(())
                    },
                );
                if read.is_err() {
                    return Ok(None);
                }
                // An index may name a message where none can be read.
                if found.is_some() || !chunk.channels.is_empty() {
                    return Ok(found);
                }
            }
        }
        Ok(None)
    }
}

/// Encoding and size by the first message of an image topic.
struct FirstImage {
    /// Encoding or format.
    encoding: String,
    /// Width and height, pixels, where it says so.
    size: Option<(u32, u32)>,
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

#[cfg(test)]
#[path = "glimpse_tests.rs"]
mod tests;
