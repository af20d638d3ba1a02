//! Writes a rosbag2 folder (MCAP storage) while messages arrive.
//!
//! After a crash, the messages up to the last [`BagWriter::flush`] are kept; `metadata.yaml` appears only
//! when the bag is finished, and a folder without it is read as an unclosed recording.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::{BufWriter, Write as _},
    path::{Path, PathBuf},
};

use mcap::records::{MessageHeader, Metadata};

use super::{
    bag_metadata::{BagFacts, TopicFacts},
    create_plain,
    offered_qos::OfferedQos,
    ros2msg::definitions::definition,
};

/// Uncompressed bytes of a chunk; a crash may lose this much besides the last second.
const CHUNK_BYTES: u64 = 768 << 10;

/// Why a bag could not be written.
#[derive(Debug, thiserror::Error)]
pub enum BagWriteError {
    /// The folder is there already.
    #[error("`{}` is there already; give another folder or move it away", .0.display())]
    Exists(PathBuf),
    /// The disk refuses.
    #[error("cannot write `{}`: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The MCAP writer refuses.
    #[error("cannot write `{}`: {source}", path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// Error of the writer.
        source: mcap::McapError,
    },
    /// The definition of a type is unknown.
    #[error("messages of type `{0}` cannot be recorded: its definition is not known")]
    Type(String),
}

/// A bag being written.
pub struct BagWriter {
    folder: PathBuf,
    file: PathBuf,
    writer: mcap::Writer<BufWriter<File>>,
    channels: BTreeMap<String, WrittenChannel>,
    facts: BagFacts,
}

struct WrittenChannel {
    id: u16,
    sequence: u32,
    /// Index of the topic in the facts.
    place: usize,
}

fn io_error(path: &Path, source: std::io::Error) -> BagWriteError {
    BagWriteError::Io { path: path.to_owned(), source }
}

impl BagWriter {
    /// Makes the folder and its file `<folder>_0.mcap`.
    ///
    /// # Errors
    /// If the folder is there already or cannot be made.
    pub fn create(folder: &Path) -> Result<Self, BagWriteError> {
        if let Some(above) = folder.parent() {
            fs::create_dir_all(above).map_err(|source| io_error(above, source))?;
        }
        // Not `create_dir_all`, which would accept an existing bag as a new one.
        fs::create_dir(folder).map_err(|source| match source.kind() {
            std::io::ErrorKind::AlreadyExists => BagWriteError::Exists(folder.to_owned()),
            _ => BagWriteError::Io { path: folder.to_owned(), source },
        })?;
        let name = format!("{}_0.mcap", folder.file_name().unwrap_or_default().to_string_lossy());
        let file = folder.join(&name);
        let sink = BufWriter::new(File::create_new(&file).map_err(|source| io_error(&file, source))?);
        // Images are compressed already or do not compress; checksums make damage visible.
        let options =
            mcap::WriteOptions::new().profile("ros2").compression(None).chunk_size(Some(CHUNK_BYTES));
        let writer =
            options.create(sink).map_err(|source| BagWriteError::Mcap { path: file.clone(), source })?;
        Ok(Self {
            folder: folder.to_owned(),
            file,
            writer,
            channels: BTreeMap::new(),
            facts: BagFacts::new(name),
        })
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Number of messages written.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.facts.messages()
    }

    /// Writes a message: CDR with its header ([`super::ros2msg::encode`]).
    ///
    /// # Errors
    /// If the disk refuses or the type is not known.
    pub fn write(
        &mut self,
        topic: &str,
        type_name: &str,
        qos: OfferedQos,
        log_nanos: i64,
        payload: &[u8],
    ) -> Result<(), BagWriteError> {
        if !self.channels.contains_key(topic) {
            let channel = self.add_channel(topic, type_name, qos)?;
            self.channels.insert(topic.to_owned(), channel);
        }
        let Some(channel) = self.channels.get_mut(topic) else { return Ok(()) };
        // MCAP has no times before the epoch.
        let time = u64::try_from(log_nanos).unwrap_or(0);
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.sequence,
            log_time: time,
            publish_time: time,
        };
        channel.sequence = channel.sequence.wrapping_add(1);
        self.facts.count(channel.place, time);
        self.writer
            .write_to_known_channel(&header, payload)
            .map_err(|source| BagWriteError::Mcap { path: self.file.clone(), source })
    }

    fn add_channel(
        &mut self,
        topic: &str,
        type_name: &str,
        qos: OfferedQos,
    ) -> Result<WrittenChannel, BagWriteError> {
        let definition = definition(type_name).ok_or_else(|| BagWriteError::Type(type_name.to_owned()))?;
        let failed = |source| BagWriteError::Mcap { path: self.file.clone(), source };
        let facts = TopicFacts {
            name: topic.to_owned(),
            type_name: type_name.to_owned(),
            qos,
            hash: definition.hash,
            messages: 0,
        };
        // `ros2 bag play` offers the topic again with these two; both are text, the profile as a YAML list.
        let metadata = BTreeMap::from([
            ("offered_qos_profiles".to_owned(), facts.qos_yaml()),
            ("topic_type_hash".to_owned(), definition.hash.to_owned()),
        ]);
        let schema =
            self.writer.add_schema(type_name, "ros2msg", definition.text.as_bytes()).map_err(failed)?;
        let id = self.writer.add_channel(schema, topic, "cdr", &metadata).map_err(failed)?;
        self.facts.topics.push(facts);
        Ok(WrittenChannel { id, sequence: 0, place: self.facts.topics.len() - 1 })
    }

    /// Writes everything so far to the disk.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn flush(&mut self) -> Result<(), BagWriteError> {
        // This also ends the open chunk, as a reader cannot use half of one.
        self.writer.flush().map_err(|source| BagWriteError::Mcap { path: self.file.clone(), source })
    }

    /// Closes the file and writes `metadata.yaml`; returns the number of messages.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn finish(mut self) -> Result<u64, BagWriteError> {
        let mcap = |source| BagWriteError::Mcap { path: self.file.clone(), source };
        // rosbag2 keeps its metadata in the file as well, for an .mcap without its folder.
        let inner = BTreeMap::from([("serialized_metadata".to_owned(), self.facts.body(0))]);
        self.writer
            .write_metadata(&Metadata { name: "rosbag2".to_owned(), metadata: inner })
            .map_err(mcap)?;
        self.writer.finish().map_err(mcap)?;
        self.writer
            .into_inner()
            .flush()
            .map_err(|source| BagWriteError::Io { path: self.file.clone(), source })?;
        let path = self.folder.join("metadata.yaml");
        let text = format!("rosbag2_bagfile_information:\n{}", self.facts.body(2));
        // metadata.yaml is written whole or not at all: half of it would look like damage, and its absence
        // says that the recording was not closed. `create_plain` follows no link planted under the
        // predictable name.
        let temporary = self.folder.join(".metadata.yaml.part");
        let written = create_plain(&temporary)
            .and_then(|mut f| f.write_all(text.as_bytes()).and_then(|()| f.sync_all()));
        written
            .and_then(|()| fs::rename(&temporary, &path))
            .map_err(|source| BagWriteError::Io { path, source })?;
        Ok(self.facts.messages())
    }
}
