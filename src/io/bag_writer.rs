//! Writes rosbag2 folders: one MCAP file and its `metadata.yaml`, as bytes.

use std::{collections::BTreeMap, fmt::Write as _, io::Cursor};

use mcap::{Compression, McapError, WriteOptions, Writer, records::MessageHeader};
use serde::Serialize;

use super::ros2msg::{self, DecodeError};

/// A message type as a bag tells it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageType {
    /// Such as `sensor_msgs/msg/Image`.
    pub name: &'static str,
    /// Definition with those of all types it is made of.
    definition: &'static str,
    /// Hash of the definition (REP 2016).
    hash: &'static str,
}

/// `sensor_msgs/msg/Image`.
pub const IMAGE: MessageType = MessageType {
    name: "sensor_msgs/msg/Image",
    definition: include_str!("messages/Image.msg"),
    hash: "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
};
/// `sensor_msgs/msg/CompressedImage`.
pub const COMPRESSED_IMAGE: MessageType = MessageType {
    name: "sensor_msgs/msg/CompressedImage",
    definition: include_str!("messages/CompressedImage.msg"),
    hash: "RIHS01_15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
};
/// `sensor_msgs/msg/CameraInfo`.
pub const CAMERA_INFO: MessageType = MessageType {
    name: "sensor_msgs/msg/CameraInfo",
    definition: include_str!("messages/CameraInfo.msg"),
    hash: "RIHS01_b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
};
/// `tf2_msgs/msg/TFMessage`.
pub const TF_MESSAGE: MessageType = MessageType {
    name: "tf2_msgs/msg/TFMessage",
    definition: include_str!("messages/TFMessage.msg"),
    hash: "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
};

/// Why a bag could not be written.
#[derive(Debug, thiserror::Error)]
pub enum BagWriteError {
    /// A message has no CDR form.
    #[error("a message on {topic} cannot be encoded: {source}")]
    Message {
        /// Its topic.
        topic: String,
        /// Why.
        source: DecodeError,
    },
    /// The container refused.
    #[error("the bag cannot be written: {0}")]
    Container(#[from] McapError),
    /// An image has no compressed form.
    #[error("an image cannot be compressed: {0}")]
    Image(#[from] image::ImageError),
}

struct Topic {
    channel: u16,
    kind: MessageType,
    count: usize,
}

/// A bag being written, in memory.
pub struct BagWriter {
    writer: Writer<Cursor<Vec<u8>>>,
    topics: BTreeMap<String, Topic>,
    /// First and last log time, nanoseconds.
    times: Option<[i64; 2]>,
}

impl BagWriter {
    /// An empty bag of zstd chunks.
    ///
    /// # Errors
    /// If the container refuses.
    pub fn new() -> Result<Self, BagWriteError> {
        // By default the container compresses with as many threads as there are cores, which shows in its bytes.
        let options = WriteOptions::new().profile("ros2").library("artitwin").compression(Some(Compression::Zstd)).compression_threads(0);
        Ok(Self { writer: options.create(Cursor::new(Vec::new()))?, topics: BTreeMap::new(), times: None })
    }

    /// Adds a message, logged at a time since the epoch; a topic keeps the type of its first message.
    ///
    /// # Errors
    /// A message that has no CDR form; a container that refuses.
    pub fn put(&mut self, topic: &str, kind: MessageType, log_nanos: i64, message: &impl Serialize) -> Result<(), BagWriteError> {
        let bytes = ros2msg::encode(message).map_err(|source| BagWriteError::Message { topic: topic.to_owned(), source })?;
        let (channel, count) = match self.topics.get_mut(topic) {
            Some(known) => {
                known.count += 1;
                (known.channel, known.count)
            }
            None => {
                let schema = self.writer.add_schema(kind.name, "ros2msg", kind.definition.as_bytes())?;
                let qos = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
                let channel = self.writer.add_channel(schema, topic, "cdr", &qos)?;
                self.topics.insert(topic.to_owned(), Topic { channel, kind, count: 1 });
                (channel, 1)
            }
        };
        let time = log_nanos.max(0).unsigned_abs();
        let header = MessageHeader { channel_id: channel, sequence: count as u32, log_time: time, publish_time: time };
        self.writer.write_to_known_channel(&header, &bytes)?;
        let [first, last] = self.times.unwrap_or([log_nanos; 2]);
        self.times = Some([first.min(log_nanos), last.max(log_nanos)]);
        Ok(())
    }

    /// The bytes of the MCAP file called `file`, and the text of `metadata.yaml`.
    ///
    /// # Errors
    /// If the container refuses.
    pub fn finish(mut self, file: &str) -> Result<(Vec<u8>, String), BagWriteError> {
        self.writer.finish()?;
        let [first, last] = self.times.unwrap_or_default();
        let metadata = metadata(file, first, last - first, &self.topics);
        Ok((self.writer.into_inner().into_inner(), metadata))
    }
}

/// rosbag2's description of a bag of one file, version 9.
fn metadata(file: &str, start_nanos: i64, duration_nanos: i64, topics: &BTreeMap<String, Topic>) -> String {
    let count: usize = topics.values().map(|t| t.count).sum();
    let mut text = format!(
        "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n  duration:\n    nanoseconds: {duration_nanos}\n  \
         starting_time:\n    nanoseconds_since_epoch: {start_nanos}\n  message_count: {count}\n  topics_with_message_count:\n"
    );
    for (name, topic) in topics {
        // Writing to a String cannot fail.
        write!(
            text,
            "  - topic_metadata:\n      name: {name}\n      type: {}\n      serialization_format: cdr\n      \
             offered_qos_profiles: []\n      type_description_hash: {}\n    message_count: {}\n",
            topic.kind.name, topic.kind.hash, topic.count
        )
        .unwrap_or_default();
    }
    write!(
        text,
        "  compression_format: ''\n  compression_mode: ''\n  relative_file_paths:\n  - {file}\n  files:\n  - path: {file}\n    \
         starting_time:\n      nanoseconds_since_epoch: {start_nanos}\n    duration:\n      nanoseconds: {duration_nanos}\n    \
         message_count: {count}\n  custom_data: null\n  ros_distro: rolling\n"
    )
    .unwrap_or_default();
    text
}
