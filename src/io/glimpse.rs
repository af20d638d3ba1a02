//! How much a recording holds, by its summary and a few messages: what a run will cost is estimated from it.

use std::{
    io,
    path::{Path, PathBuf},
};

use super::{
    bag::Bag,
    excerpt::{Wanted, excerpts, first_image, summaries, topics_of},
    joint_log::is_joint_topic,
    mcap_summary::McapSummary,
    ranges::{FileRanges, Ranges, stored_bytes},
    remembered::Remembered,
    source::Source,
    topics::choose,
};
use crate::{capture::CaptureConfig, gap::record::tracks::Streams};

/// How much a bag holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Glimpse {
    /// Bytes of its files.
    pub bytes: u64,
    /// Bytes of them that are needed.
    pub needed_bytes: u64,
    /// Color images; `None` where the bag does not say.
    pub frames: Option<u64>,
    /// Columns and rows of the color images.
    pub size: Option<(u32, u32)>,
    /// Messages about joints.
    pub samples: u64,
}

/// Looks at a bag.
///
/// # Errors
/// Where a file cannot be read.
pub fn glimpse(files: &[Remembered], wanted: Wanted) -> io::Result<Glimpse> {
    let bytes = files.iter().map(Ranges::size).sum();
    let plans = excerpts(files, wanted)?;
    let needed_bytes = plans.iter().map(|p| stored_bytes(p)).sum();
    let mut found = Glimpse { bytes, needed_bytes, ..Glimpse::default() };
    let Some(bag) = summaries(files)? else { return Ok(found) };
    if let Wanted::Views(config) | Wanted::ViewsAndJoints(config, _) = wanted {
        views(files, &bag, config, &mut found)?;
    }
    if let Wanted::Joints(streams) | Wanted::ViewsAndJoints(_, streams) = wanted {
        found.samples = samples(&bag, streams);
    }
    Ok(found)
}

fn views(
    files: &[Remembered],
    bag: &[McapSummary],
    config: &CaptureConfig,
    found: &mut Glimpse,
) -> io::Result<()> {
    let Some(topics) = topics_of(files, bag)? else { return Ok(()) };
    let Ok(choice) = choose(&topics, &config.topics, Path::new("")) else { return Ok(()) };
    found.frames = topics.iter().find(|t| t.name == choice.color).map(|t| t.count as u64);
    found.size = first_image(files, bag, &choice.color)?.and_then(|i| i.size);
    if found.size.is_none() {
        found.size = first_image(files, bag, &choice.color_info)?.and_then(|i| i.size);
    }
    Ok(())
}

fn samples(bag: &[McapSummary], streams: &Streams) -> u64 {
    let channels = bag.iter().flat_map(|s| s.channels.values());
    let read =
        channels.filter(|c| is_joint_topic(&c.topic, &c.type_name, c.message_encoding == "cdr", streams));
    read.map(|c| c.count).sum()
}

/// Looks at the bags of recordings on this machine, each a state or all of them; of a dataset its bytes
/// alone.
///
/// # Errors
/// Where a file cannot be read.
pub fn glimpse_paths(paths: &[PathBuf], wanted: Wanted) -> io::Result<Vec<Glimpse>> {
    let bags = match Source::of(paths) {
        Ok(Source::States(paths)) => paths,
        Ok(Source::Both(path)) => vec![path],
        // What is none is refused by the command itself.
        _ => return Ok(vec![Glimpse::default()]),
    };
    bags.iter().map(|path| glimpse_bag(path, wanted)).collect()
}

/// Looks at one bag of this machine.
///
/// # Errors
/// Where a file cannot be read.
pub fn glimpse_bag(path: &Path, wanted: Wanted) -> io::Result<Glimpse> {
    let Ok(bag) = Bag::open(path) else { return Ok(Glimpse::default()) };
    let sources: Vec<FileRanges> =
        bag.files.iter().map(|f| FileRanges::open(f)).collect::<io::Result<_>>()?;
    let files: Vec<Remembered> = sources.iter().map(|s| Remembered::of(s)).collect();
    glimpse(&files, wanted)
}
