//! `artitwin record`: writes all inputs of the node to a bag.

use std::{
    path::Path,
    time::{Duration, Instant},
};

use super::{
    clock::NodeClock,
    error::NodeError,
    inputs,
    sample::Sample,
    session::{Start, core_queues, end_log, end_requested, in_runtime},
    state_bag::Topics,
};
use io::{
    BagWriteError, BagWriter, OfferedQos,
    ros2msg::{
        CameraInfo, DecodeError, PoseStamped, TfMessage, definitions::RosMessage, encode,
        odometry::FullOdometry,
    },
};

/// Name of the node if none is given.
const DEFAULT_NAME: &str = "artitwin_record";
/// Queue length for images.
const IMAGE_QUEUE: usize = 64;
/// Time between flushes of the recording; a crash loses at most this much.
const FLUSH_EVERY: Duration = Duration::from_secs(1);

/// Counts of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// Number of written messages.
    pub messages: u64,
    /// Number of messages lost in transport, malformed, or dropped.
    pub dropped: u64,
}

/// Records until Ctrl-C or SIGTERM. `arguments` are those of the node.
///
/// # Errors
/// [`NodeError`] if it cannot start or writing fails.
pub fn record(bag: &Path, arguments: &[String]) -> Result<Recorded, NodeError> {
    let start = Start::read_inputs(arguments, DEFAULT_NAME)?;
    in_runtime(record_live(bag, &start))
}

async fn record_live(folder: &Path, start: &Start) -> Result<Recorded, NodeError> {
    let p = &start.parameters;
    let topics = inputs::topic_names(&start.arguments, &start.identity, p);
    // Before joining the network, so that an unusable folder ends the command at once.
    let mut bag = BagWriter::create(folder)?;
    let mut participant = start.join_domain()?;
    let clock = std::sync::Arc::new(NodeClock::new(p.use_sim_time));
    let (outbox, mut inbox) = core_queues(IMAGE_QUEUE);
    let inputs = inputs::subscribe_topics(&mut participant, p, &topics, &outbox, &clock)?;
    participant.announce_node()?;
    log::info!("recording to {}", folder.display());
    let end = end_requested();
    tokio::pin!(end);
    let mut flushed = Instant::now();
    loop {
        let sample = tokio::select! {
            done = &mut end => {
                done?;
                break;
            }
            Some(sample) = inbox.small.recv() => Some(sample),
            Some(sample) = inbox.images.recv() => Some(sample),
            // A time jump only affects messages that wait for partners; a recording takes all messages.
            Some(_) = inbox.commands.recv() => None,
        };
        if let Some(sample) = sample {
            write_sample(&mut bag, &topics, &sample, clock.now_nanos())?;
        }
        // By the system clock, as /clock may stand still.
        if flushed.elapsed() >= FLUSH_EVERY {
            bag.flush()?;
            flushed = Instant::now();
        }
    }
    end_log();
    let messages = bag.finish()?;
    let mut dropped = 0;
    for input in &inputs {
        let count = input.count.snapshot();
        dropped += count.lost + count.malformed + count.overrun;
    }
    Ok(Recorded { messages, dropped })
}

/// Writes a message to its topic without checking its content, which is up to the reader.
fn write_sample(
    bag: &mut BagWriter,
    topics: &Topics,
    sample: &Sample,
    now_nanos: i64,
) -> Result<(), BagWriteError> {
    // Profiles for replay: best effort does not match reliable readers, so transforms are reliable.
    const SENSOR: OfferedQos = OfferedQos { reliable: false, latched: false, depth: 10 };
    const RELIABLE: OfferedQos = OfferedQos { reliable: true, latched: false, depth: 100 };
    const LATCHED: OfferedQos = OfferedQos { reliable: true, latched: true, depth: 1 };
    let named = |name: &Option<String>| name.clone().unwrap_or_default();
    let pose = topics.pose.as_ref().map(|(name, _)| name.clone()).unwrap_or_default();
    let (topic, type_name, qos, payload): (String, &str, OfferedQos, Result<Vec<u8>, DecodeError>) =
        match sample {
            Sample::Color(m) => (topics.color.clone(), m.type_name(), SENSOR, m.payload()),
            Sample::Depth(m) => (topics.depth.clone(), m.type_name(), SENSOR, m.payload()),
            Sample::Mask(m) => (named(&topics.mask), m.type_name(), SENSOR, m.payload()),
            Sample::ColorInfo(m) => (topics.color_info.clone(), CameraInfo::TYPE, SENSOR, encode(m.as_ref())),
            Sample::DepthInfo(m) => (named(&topics.depth_info), CameraInfo::TYPE, SENSOR, encode(m.as_ref())),
            Sample::Transforms(m) => ("/tf".to_owned(), TfMessage::TYPE, RELIABLE, encode(m)),
            Sample::StaticTransforms(m) => ("/tf_static".to_owned(), TfMessage::TYPE, LATCHED, encode(m)),
            Sample::Pose(m) => (pose, PoseStamped::TYPE, SENSOR, encode(m)),
            Sample::Odometry(m) => (pose, FullOdometry::TYPE, SENSOR, encode(m.as_ref())),
        };
    match payload {
        Ok(payload) => bag.write(&topic, type_name, qos, now_nanos, &payload),
        // Only this message is lost, which is logged; the recording continues.
        Err(error) => {
            log::warn!("{topic}: a message cannot be written: {error}");
            Ok(())
        }
    }
}
