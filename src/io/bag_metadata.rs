//! `metadata.yaml` of a rosbag2 folder, version 8: read by Jazzy and later, and by key also by Humble.

use std::fmt::Write as _;

use super::offered_qos::OfferedQos;

/// Contents of a bag, for its metadata.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BagFacts {
    /// Name of its file.
    pub file: String,
    /// Topics, in the order of their first messages.
    pub topics: Vec<TopicFacts>,
    /// First and last recording time, nanoseconds.
    span_nanos: Option<(u64, u64)>,
}

/// Contents of a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicFacts {
    /// Its name.
    pub name: String,
    /// Type of its messages.
    pub type_name: String,
    /// Its QoS profile.
    pub qos: OfferedQos,
    /// Hash of the type.
    pub hash: &'static str,
    /// Number of messages.
    pub messages: u64,
}

impl TopicFacts {
    /// The offered QoS profile as rosbag2 stores it: a YAML list in a string, with rmw's numbers for
    /// policies.
    #[must_use]
    pub fn qos_yaml(&self) -> String {
        const KEEP_LAST: u8 = 1;
        // rmw's infinite duration: 2^63 - 1 nanoseconds.
        let infinite = |indent: &str| format!("\n{indent}sec: 9223372036\n{indent}nsec: 854775807");
        let forever = infinite("    ");
        // rmw's numbers: reliable 1, best effort 2; transient local 1, volatile 2.
        let reliability = if self.qos.reliable { 1 } else { 2 };
        let durability = if self.qos.latched { 1 } else { 2 };
        format!(
            "- history: {KEEP_LAST}\n  depth: {}\n  reliability: {reliability}\n  durability: \
             {durability}\n  deadline:{forever}\n  \
             lifespan:{forever}\n  liveliness: \
             1\n  liveliness_lease_duration:{forever}\n  avoid_ros_namespace_conventions: false",
            self.qos.depth
        )
    }
}

impl BagFacts {
    /// An empty bag of one file.
    #[must_use]
    pub fn new(file: String) -> Self {
        Self { file, ..Self::default() }
    }

    /// Counts a message of the topic with this index.
    pub fn count(&mut self, place: usize, log_nanos: u64) {
        if let Some(topic) = self.topics.get_mut(place) {
            topic.messages += 1;
        }
        let (first, last) = self.span_nanos.unwrap_or((log_nanos, log_nanos));
        self.span_nanos = Some((first.min(log_nanos), last.max(log_nanos)));
    }

    /// Number of messages of all topics.
    #[must_use]
    pub fn messages(&self) -> u64 {
        self.topics.iter().map(|t| t.messages).sum()
    }

    /// The YAML below `rosbag2_bagfile_information`, each line indented.
    #[must_use]
    pub fn body(&self, indent: usize) -> String {
        let (start, end) = self.span_nanos.unwrap_or_default();
        let count = self.messages();
        let duration = end - start;
        let file = &self.file;
        let mut text = format!(
            "version: 8\nstorage_identifier: mcap\nduration:\n  nanoseconds: {duration}\nstarting_time:\n  \
             nanoseconds_since_epoch: {start}\nmessage_count: {count}\ntopics_with_message_count:{}\n",
            if self.topics.is_empty() { " []" } else { "" }
        );
        for t in &self.topics {
            // A JSON string is a YAML string.
            let qos = serde_json::Value::from(t.qos_yaml());
            _ = write!(
                text,
                "  - topic_metadata:\n      name: {}\n      type: {}\n      serialization_format: \
                 cdr\n      offered_qos_profiles: {qos}\n      \
                 type_description_hash: {}\n    message_count: {}\n",
                t.name, t.type_name, t.hash, t.messages
            );
        }
        _ = write!(
            text,
            "compression_format: \"\"\ncompression_mode: \"\"\nrelative_file_paths:\n  - \
             {file}\nfiles:\n  - path: {file}\n    \
             starting_time:\n      nanoseconds_since_epoch: {start}\n    duration:\n      nanoseconds: \
             {duration}\n    \
             message_count: {count}\ncustom_data: ~\nros_distro: jazzy\n"
        );
        let pad = " ".repeat(indent);
        text.lines().map(|line| format!("{pad}{line}\n")).collect()
    }
}
