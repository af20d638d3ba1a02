//! First reading of a bag: topics, times and camera poses; everything but the pixels.

use std::{
    collections::{BTreeMap, HashMap},
    path::PathBuf,
};

use super::{
    bag::Bag,
    image_codec::compressed_size,
    imu::{IMU_TYPE, ImuTopic},
    lags::Lags,
    mcap_file::{FileReport, RawMessage},
    pose_topic::{POSE_TYPES, PoseTopic},
    ros2msg::{
        CameraInfo, CompressedFront, CompressedImage, DecodeError, ImageFront, TfMessage, decode, encode,
        imu::Imu,
    },
    topics::{INFO_TYPE, TopicSummary},
};
use capture::{CaptureError, MAX_TF_FRAMES, Split, TfBuffer};
use common::limits::NAMED;
use common::note::{Note, NoteCode};
use common::stop::Stop;

/// Largest number of indexed transforms, images and poses.
const MAX_ENTRIES: usize = 5_000_000;
/// Largest number of topics of one bag.
const MAX_TOPICS: usize = 10_000;
/// Largest number of distinct camera parameters of a topic: a focusing camera changes them every frame.
const MAX_CAMERAS: usize = 100_000;
/// Largest number of lens coefficients; the largest model of OpenCV has 14.
const MAX_COEFFICIENTS: usize = 64;

/// Images of other topics are kept this long after the end of a state and before the next, nanoseconds: they
/// are paired by stamps but recorded at other times.
const BETWEEN_NANOS: i64 = 1_000_000_000;

/// Why a message is not used.
#[derive(Debug, thiserror::Error)]
pub enum MessageError {
    /// Its encoding is not CDR.
    #[error("message encoding `{0}` is not cdr")]
    Encoding(String),
    /// It cannot be decoded.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// Its stamp or frame is invalid.
    #[error("its header is invalid")]
    Header,
    /// Its lens has more coefficients than any model.
    #[error("it has {0} lens coefficients; {MAX_COEFFICIENTS} are the limit")]
    Lens(usize),
    /// There are too many distinct cameras already.
    #[error("it is one more than {MAX_CAMERAS} different camera_infos")]
    Cameras,
}

/// Counts and type of a topic.
#[derive(Clone, Debug, Default)]
pub struct TopicStat {
    /// Type of its messages.
    pub type_name: String,
    /// Messages in the bag.
    pub count: usize,
    /// Undecodable messages of a known type.
    pub undecodable: usize,
    /// Why the first of them could not be decoded.
    pub problem: Option<String>,
    /// Recording time of the first message, nanoseconds.
    pub first_nanos: i64,
    /// Recording time of the last message, nanoseconds.
    pub last_nanos: i64,
}

/// One image message, without its pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageEntry {
    /// Index among all messages of its topic, in the order of reading.
    pub ordinal: usize,
    /// Header stamp, nanoseconds.
    pub stamp_nanos: i64,
    /// Recording time, nanoseconds.
    pub log_nanos: i64,
    /// Width and height, if the message states them.
    pub size: Option<(usize, usize)>,
}

/// The images of a topic.
#[derive(Clone, Debug, Default)]
pub struct ImageTopic {
    /// Encoding or format of the first image.
    pub encoding: String,
    /// Optical frame of the first image.
    pub frame: String,
    /// Number of messages in another frame than the first; they are not used.
    pub strays: usize,
    /// Columns and rows of the first image, if it states them.
    pub first_size: Option<(usize, usize)>,
    /// How long after their stamps they were recorded.
    pub lags: Lags,
    /// The images, in the order of reading.
    pub entries: Vec<ImageEntry>,
}

impl ImageTopic {
    /// Gives images without a stamp the time of their recording, on the clock of the stamped ones.
    fn stamp_all(&mut self) {
        let lag = self.lags.median_nanos().unwrap_or(0);
        for entry in self.entries.iter_mut().filter(|e| e.stamp_nanos == 0) {
            entry.stamp_nanos = entry.log_nanos - lag;
        }
    }
}

/// The camera parameters of a topic.
#[derive(Clone, Debug, Default)]
pub struct InfoTopic {
    /// Distinct parameters, without stamps.
    pub distinct: Vec<CameraInfo>,
    /// Stamp of each message, nanoseconds, and its index into `distinct`.
    pub entries: Vec<(i64, usize)>,
    /// Index into `distinct`, by the encoded parameters.
    known: HashMap<Vec<u8>, usize>,
}

impl InfoTopic {
    /// Drops parameters that nearly all messages contradict (damage); returns the number of dropped messages.
    pub fn settle(&mut self) -> usize {
        let mut counts = vec![0; self.distinct.len()];
        self.entries.iter().for_each(|e| counts[e.1] += 1);
        let Some((common, agreeing)) =
            // Of equals the first: `max_by_key` alone would give the last.
            counts.into_iter().enumerate().max_by_key(|(d, n): &(usize, usize)| (*n, usize::MAX - d))
        else {
            return 0;
        };
        let lost = self.entries.len() - agreeing;
        // A focusing camera changes its parameters for many messages; damage changes few.
        if lost == 0 || agreeing < 10 * lost {
            return 0;
        }
        self.distinct = vec![self.distinct[common].clone()];
        self.entries = self.entries.iter().filter(|e| e.1 == common).map(|e| (e.0, 0)).collect();
        lost
    }
}

/// The contents of a bag without the pixels.
#[derive(Clone, Debug, Default)]
pub struct BagIndex {
    /// Statistics of all topics, by name.
    pub topics: BTreeMap<String, TopicStat>,
    /// Image topics, by name.
    pub images: BTreeMap<String, ImageTopic>,
    /// CameraInfo topics, by name.
    pub infos: BTreeMap<String, InfoTopic>,
    /// Pose topics, by name.
    pub poses: BTreeMap<String, PoseTopic>,
    /// IMU topics, by name.
    pub imus: BTreeMap<String, ImuTopic>,
    /// Recording times of the messages of std_msgs topics.
    pub markers: BTreeMap<String, Vec<i64>>,
    /// Transforms of /tf and /tf_static.
    pub tf: TfBuffer,
    /// How long after their stamps the moving transforms were recorded, by child.
    pub tf_lags: BTreeMap<String, Lags>,
    /// How each file was read.
    pub files: Vec<(PathBuf, FileReport)>,
    entries: usize,
}

impl BagIndex {
    /// Reads a bag once, front to back.
    ///
    /// # Errors
    /// Those of [`Bag::read_starts`]; [`CaptureError::Unsupported`] for too many entries.
    pub fn read(bag: &Bag, stop: &Stop) -> Result<Self, CaptureError> {
        let mut index = Self::default();
        index.files = bag.read_starts(&mut |message| {
            stop.check()?;
            index.add(message, bag)
        })?;
        index.images.values_mut().for_each(ImageTopic::stamp_all);
        Ok(index)
    }

    /// First and last recording time, nanoseconds.
    #[must_use]
    pub fn span_nanos(&self) -> Option<(i64, i64)> {
        let first = self.topics.values().map(|t| t.first_nanos).min()?;
        Some((first, self.topics.values().map(|t| t.last_nanos).max()?))
    }

    /// Notes about damage; if there are many files or topics, only about the first ones.
    #[must_use]
    pub fn damage(&self) -> Vec<Note> {
        let undecodable = |text| Note::new(NoteCode::MessagesUndecodable, text);
        let files = self.files.iter().filter_map(|(path, report)| report.damage(&path.display().to_string()));
        let broken = self.topics.values().filter(|t| t.undecodable > 0).count();
        let more = (broken > NAMED).then(|| {
            undecodable(format!("{} more topics hold messages that could not be decoded", broken - NAMED))
        });
        let surplus = (self.tf.surplus > 0).then(|| {
            let text = format!(
                "{} transforms are of more frames than are taken ({MAX_TF_FRAMES}) and are not used",
                self.tf.surplus
            );
            Note::new(NoteCode::TransformsSurplus, text)
        });
        let topics = self.topics.iter().filter(|(_, t)| t.undecodable > 0).map(|(name, t)| {
            let problem = t.problem.as_deref().unwrap_or_default();
            undecodable(format!(
                "{} of {} messages on {name} could not be decoded and are not used ({problem})",
                t.undecodable, t.count
            ))
        });
        files.take(NAMED).chain(topics.take(NAMED)).chain(more).chain(surplus).collect()
    }

    /// A summary of each topic, for choosing among them.
    #[must_use]
    pub fn summaries(&self) -> Vec<TopicSummary> {
        self.topics.iter().map(|(name, stat)| self.topic_summary(name, stat)).collect()
    }

    fn topic_summary(&self, name: &str, stat: &TopicStat) -> TopicSummary {
        let summary = TopicSummary {
            name: name.to_owned(),
            type_name: stat.type_name.clone(),
            count: stat.count - stat.undecodable,
            ..TopicSummary::default()
        };
        let Some(images) = self.images.get(name) else { return summary };
        TopicSummary {
            encoding: images.encoding.clone(),
            frame: images.frame.clone(),
            size: images.first_size,
            stamps: images.entries.iter().map(|e| e.stamp_nanos).collect(),
            moves: self.tf.chain_of_frame(&images.frame).moves,
            ..summary
        }
    }

    /// Removes the images between two states. Messages that belong to a color image of a state may have been
    /// recorded a little before or after it.
    pub fn leave_out_between(&mut self, split: &Split, color: &str) {
        for (topic, images) in &mut self.images {
            let margin = if topic == color { 0 } else { BETWEEN_NANOS };
            images.entries.retain(|e| !split.is_between(e.log_nanos, margin));
        }
    }

    fn add(&mut self, message: &RawMessage, bag: &Bag) -> Result<(), CaptureError> {
        // Checked before the message is indexed: a small compressed bag may contain more of them than fit in
        // memory.
        if self.entries >= MAX_ENTRIES || self.topics.len() >= MAX_TOPICS {
            return refuse_bag(
                bag,
                "a bag with so many messages",
                "cut it with `ros2 bag convert` to the topics and times that are needed",
            );
        }
        // MCAP counts unsigned; values beyond i64 lie after the year 2262.
        let log_nanos = i64::try_from(message.log_time_nanos).unwrap_or(i64::MAX);
        // Not `entry`: it would copy the name for every message.
        if !self.topics.contains_key(message.topic) {
            let stat = TopicStat {
                type_name: message.type_name.to_owned(),
                first_nanos: log_nanos,
                last_nanos: log_nanos,
                ..TopicStat::default()
            };
            self.topics.insert(message.topic.to_owned(), stat);
        }
        let outcome = match message.message_encoding {
            "cdr" => self.decode(message, log_nanos),
            other => Err(MessageError::Encoding(other.to_owned())),
        };
        if let Some(stat) = self.topics.get_mut(message.topic) {
            // After decoding, because the ordinal of an image is the count before it.
            stat.count += 1;
            stat.first_nanos = stat.first_nanos.min(log_nanos);
            stat.last_nanos = stat.last_nanos.max(log_nanos);
            if let Err(why) = outcome {
                stat.undecodable += 1;
                stat.problem.get_or_insert(why.to_string());
            }
        }
        Ok(())
    }

    fn decode(&mut self, message: &RawMessage, log_nanos: i64) -> Result<(), MessageError> {
        let topic = message.topic;
        let data = message.data;
        match message.type_name {
            "sensor_msgs/msg/Image" => {
                // Only the fields before the pixels, which are read once the views are chosen.
                let front: ImageFront = decode(data)?;
                let (stamp, frame) = front.header.checked().ok_or(MessageError::Header)?;
                self.add_image(
                    topic,
                    stamp,
                    log_nanos,
                    frame,
                    front.encoding,
                    Some((front.width as usize, front.height as usize)),
                );
            }
            "sensor_msgs/msg/CompressedImage" => {
                let front: CompressedFront = decode(data)?;
                let (stamp, frame) = front.header.checked().ok_or(MessageError::Header)?;
                // The size stands in the compressed data, of which the first is looked at; the second reading
                // checks it.
                let is_first = self.images.get(topic).is_none_or(|i| i.entries.is_empty());
                let first: Option<CompressedImage> = if is_first { decode(data).ok() } else { None };
                self.add_image(topic, stamp, log_nanos, frame, front.format, None);
                if let Some(images) = self.images.get_mut(topic).filter(|_| is_first) {
                    images.first_size = first.as_ref().and_then(compressed_size);
                }
            }
            INFO_TYPE => self.add_info(topic, decode(data)?, log_nanos)?,
            IMU_TYPE => {
                let m: Imu = decode(data)?;
                let (stamp, frame) = m.header.checked().ok_or(MessageError::Header)?;
                self.entries += 1;
                self.imus.entry(topic.to_owned()).or_default().add(stamp, frame, &m);
            }
            "tf2_msgs/msg/TFMessage" => self.add_transforms(topic, &decode(data)?, log_nanos),
            name if POSE_TYPES.contains(&name) => {
                let poses = self.poses.entry(topic.to_owned()).or_default();
                self.entries += poses.add(name, data, log_nanos)?;
            }
            // Any of them may mark the end of a state; only its recording time is needed.
            name if name.starts_with("std_msgs/") => {
                self.entries += 1;
                self.markers.entry(topic.to_owned()).or_default().push(log_nanos);
            }
            _ => {}
        }
        Ok(())
    }

    fn add_image(
        &mut self,
        topic: &str,
        stamp_nanos: i64,
        log_nanos: i64,
        frame: String,
        encoding: String,
        size: Option<(usize, usize)>,
    ) {
        self.entries += 1;
        // Undecodable messages count too, as the second reading counts without decoding.
        let ordinal = self.topics.get(topic).map_or(0, |t| t.count);
        let images = self.images.entry(topic.to_owned()).or_default();
        // One optical frame a topic: a stray would get the pose of another camera.
        if images.entries.is_empty() {
            images.frame = frame;
            images.encoding = encoding;
            images.first_size = size;
        } else if images.frame != frame {
            images.strays += 1;
            return;
        }
        images.lags.add(stamp_nanos, log_nanos);
        images.entries.push(ImageEntry { ordinal, stamp_nanos, log_nanos, size });
    }

    fn add_info(&mut self, topic: &str, mut info: CameraInfo, log_nanos: i64) -> Result<(), MessageError> {
        let (stamp, frame) = info.header.checked().ok_or(MessageError::Header)?;
        if info.d.len() > MAX_COEFFICIENTS {
            return Err(MessageError::Lens(info.d.len()));
        }
        self.entries += 1;
        // Without the stamp, so equal parameters have equal bytes.
        info.header = super::ros2msg::Header { frame_id: frame, ..Default::default() };
        let infos = self.infos.entry(topic.to_owned()).or_default();
        // Compared as bytes, because NaN is not equal to itself.
        let key = encode(&info)?;
        let next = infos.distinct.len();
        if next >= MAX_CAMERAS && !infos.known.contains_key(&key) {
            return Err(MessageError::Cameras);
        }
        let known = *infos.known.entry(key).or_insert(next);
        if known == next {
            infos.distinct.push(info);
        }
        infos.entries.push((if stamp == 0 { log_nanos } else { stamp }, known));
        Ok(())
    }

    fn add_transforms(&mut self, topic: &str, message: &TfMessage, log_nanos: i64) {
        for t in &message.transforms {
            self.entries += 1;
            // Old recordings write `/base_link`; tf2 knows frames without the slash.
            let child = t.child_frame_id.trim_start_matches('/');
            match (t.header.checked(), t.transform.checked()) {
                // The topic may be in a namespace, so its end decides.
                (Some((_, parent)), Some(pose)) if topic.ends_with("tf_static") => {
                    self.tf.add_static(&parent, child, pose)
                }
                (Some((stamp, parent)), Some(pose)) => {
                    // Not `entry`: it would copy the name for every transform.
                    if !self.tf_lags.contains_key(child) && self.tf_lags.len() < MAX_TF_FRAMES {
                        self.tf_lags.insert(child.to_owned(), Lags::default());
                    }
                    if let Some(lags) = self.tf_lags.get_mut(child) {
                        lags.add(stamp, log_nanos);
                    }
                    let stamp = if stamp == 0 { log_nanos } else { stamp };
                    self.tf.add(&parent, child, stamp, pose);
                }
                _ => self.tf.invalid += 1,
            }
        }
    }
}

fn refuse_bag(bag: &Bag, what: &str, remedy: &str) -> Result<(), CaptureError> {
    let what = format!("`{}`: {what}", bag.path.display());
    Err(CaptureError::Unsupported { what, remedy: remedy.into() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_message_against_all_others_is_left_out_and_a_real_change_is_kept() {
        let info = |width| CameraInfo { width, ..CameraInfo::default() };
        let entries =
            |odd: std::ops::Range<i64>| (0..30).map(|i| (i, usize::from(odd.contains(&i)))).collect();
        let topic = |entries, other| InfoTopic {
            distinct: vec![info(640), info(other)],
            entries,
            ..InfoTopic::default()
        };
        let mut damaged = topic(entries(7..8), 641);
        assert_eq!((damaged.settle(), damaged.distinct.len(), damaged.entries.len()), (1, 1, 29));
        assert_eq!(damaged.distinct[0].width, 640);
        let mut changed = topic(entries(20..30), 320);
        assert_eq!((changed.settle(), changed.distinct.len()), (0, 2));
        assert_eq!(InfoTopic::default().settle(), 0);
    }

    #[test]
    fn parameters_that_change_with_every_message_cost_no_more_each() {
        let mut index = BagIndex::default();
        let begun = std::time::Instant::now();
        let mut info = CameraInfo { width: 640, ..CameraInfo::default() };
        info.header.frame_id = "camera".into();
        for i in 0..MAX_CAMERAS + 10 {
            info.k[2] = i as f64;
            let more = index.add_info("/info", info.clone(), 1);
            // One that is not equal to itself is one.
            assert_eq!(more.is_err(), i >= MAX_CAMERAS - 1);
            info.k[2] = f64::NAN;
            if i < MAX_CAMERAS - 1 {
                index.add_info("/info", info.clone(), 1).unwrap();
            }
        }
        let infos = index.infos.get_mut("/info").unwrap();
        assert_eq!(infos.distinct.len(), MAX_CAMERAS);
        assert_eq!(infos.settle(), 0);
        assert!(begun.elapsed().as_secs() < 5, "{:?}", begun.elapsed());
        info.d = vec![0.0; 65];
        assert!(matches!(index.add_info("/info", info, 1), Err(MessageError::Lens(65))));
    }
}
