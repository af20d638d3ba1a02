//! The recording of one state: exactly the messages that its kept views need.

use std::path::{Path, PathBuf};

use super::view::View;
use io::{
    BagWriteError, BagWriter, LiveTopics, OfferedQos,
    ros2msg::{
        CameraInfo, Header, PoseStamped, TfMessage, TransformStamped, definitions::RosMessage, encode,
        odometry::FullOdometry,
    },
};

/// QoS of images in the recording.
const SENSOR: OfferedQos = OfferedQos { reliable: false, latched: false, depth: 10 };
const RELIABLE: OfferedQos = OfferedQos { reliable: true, latched: false, depth: 100 };
const LATCHED: OfferedQos = OfferedQos { reliable: true, latched: true, depth: 1 };

/// Names of the topics after remapping.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Topics {
    /// Color images.
    pub color: String,
    /// Depth images.
    pub depth: String,
    /// CameraInfo of the color images.
    pub color_info: String,
    /// CameraInfo of the depth images.
    pub depth_info: Option<String>,
    /// Object masks.
    pub mask: Option<String>,
    /// Camera poses in place of `/tf`, and whether they are odometry.
    pub pose: Option<(String, bool)>,
}

impl Topics {
    /// The names of the images, for messages.
    #[must_use]
    pub(crate) fn live_names(&self) -> LiveTopics<'_> {
        LiveTopics {
            color: &self.color,
            color_info: &self.color_info,
            depth: &self.depth,
            mask: self.mask.as_deref().unwrap_or_default(),
        }
    }
}

/// The recording of one state during writing.
pub(crate) struct StateBag {
    bag: BagWriter,
    topics: Topics,
    fixed: Vec<TransformStamped>,
    /// New path of an earlier recording.
    replaced: Option<PathBuf>,
}

impl StateBag {
    /// Creates `session/state<N>`; an earlier one is renamed to `state<N>_replaced<K>`.
    ///
    /// # Errors
    /// If writing fails.
    pub(crate) fn create(session: &Path, state: usize, topics: Topics) -> Result<Self, BagWriteError> {
        let folder = session.join(format!("state{state}"));
        let spare = || (1..).map(|k| session.join(format!("state{state}_replaced{k}"))).find(|p| !p.exists());
        let replaced = folder.exists().then(spare).flatten();
        if let Some(spare) = &replaced {
            rename_folder(&folder, spare)?;
        }
        Ok(Self { bag: BagWriter::create(&folder)?, topics, fixed: Vec::new(), replaced })
    }

    /// Removes the recording and restores the earlier one.
    ///
    /// # Errors
    /// If writing fails.
    pub(crate) fn abandon(self) -> Result<(), BagWriteError> {
        let folder = self.bag.folder().to_owned();
        // Closed first, as some systems do not remove open files.
        drop(self.bag);
        std::fs::remove_dir_all(&folder)
            .map_err(|source| BagWriteError::Io { path: folder.clone(), source })?;
        self.replaced.map_or(Ok(()), |spare| rename_folder(&spare, &folder))
    }

    /// Writes a view, transforms first for replays: `infos` of color and depth, `fixed` transforms, and those
    /// `around` its stamp; the transform of the frame `posed` goes to the pose topic.
    ///
    /// # Errors
    /// If writing fails.
    pub(crate) fn write_view(
        &mut self,
        view: &View,
        infos: [Option<&CameraInfo>; 2],
        fixed: Vec<TransformStamped>,
        around: Vec<TransformStamped>,
        posed: Option<&str>,
        now_nanos: i64,
    ) -> Result<(), BagWriteError> {
        // Latched in a replay: written once, unless they change.
        if fixed != self.fixed {
            self.write_message("/tf_static", LATCHED, now_nanos, &TfMessage { transforms: fixed.clone() })?;
            self.fixed = fixed;
        }
        self.write_transforms(around, posed, now_nanos)?;
        let topics = self.topics.clone();
        // With every view, since a reader may split the bag anywhere.
        for (info, topic) in infos.into_iter().zip([Some(&topics.color_info), topics.depth_info.as_ref()]) {
            if let (Some(info), Some(topic)) = (info, topic) {
                self.write_message(topic, SENSOR, now_nanos, info)?;
            }
        }
        for (image, topic) in
            view.images.iter().zip([Some(&topics.color), Some(&topics.depth), topics.mask.as_ref()])
        {
            if let (Some(image), Some(topic)) = (image, topic) {
                let payload = image.payload().map_err(|e| unwritable_bag(&self.bag, &e.to_string()))?;
                self.bag.write(topic, image.type_name(), SENSOR, now_nanos, &payload)?;
            }
        }
        Ok(())
    }

    /// Writes the transforms around a stamp; that of the pose topic under this topic.
    fn write_transforms(
        &mut self,
        around: Vec<TransformStamped>,
        posed: Option<&str>,
        now_nanos: i64,
    ) -> Result<(), BagWriteError> {
        let (posed, plain): (Vec<_>, Vec<_>) = match (&self.topics.pose, posed) {
            // A reader must not find the pose twice, on /tf and on its own topic.
            (Some(_), Some(child)) => around.into_iter().partition(|t| t.child_frame_id == child),
            _ => (Vec::new(), around),
        };
        if !plain.is_empty() {
            self.write_message("/tf", RELIABLE, now_nanos, &TfMessage { transforms: plain })?;
        }
        let Some((topic, odometry)) = self.topics.pose.clone() else { return Ok(()) };
        for t in posed {
            let header = Header { stamp: t.header.stamp, frame_id: t.header.frame_id };
            if odometry {
                let message = FullOdometry {
                    header,
                    child_frame_id: t.child_frame_id,
                    pose: t.transform,
                    ..FullOdometry::default()
                };
                self.write_message(&topic, RELIABLE, now_nanos, &message)?;
            } else {
                self.write_message(&topic, RELIABLE, now_nanos, &PoseStamped { header, pose: t.transform })?;
            }
        }
        Ok(())
    }

    fn write_message<M: RosMessage>(
        &mut self,
        topic: &str,
        qos: OfferedQos,
        now_nanos: i64,
        message: &M,
    ) -> Result<(), BagWriteError> {
        let payload = encode(message).map_err(|e| unwritable_bag(&self.bag, &e.to_string()))?;
        self.bag.write(topic, M::TYPE, qos, now_nanos, &payload)
    }

    /// Flushes the recording to the disk.
    ///
    /// # Errors
    /// If writing fails.
    pub(crate) fn flush(&mut self) -> Result<(), BagWriteError> {
        self.bag.flush()
    }

    /// Closes the recording; returns its folder.
    ///
    /// # Errors
    /// If writing fails.
    pub(crate) fn finish(self) -> Result<PathBuf, BagWriteError> {
        let folder = self.bag.folder().to_owned();
        self.bag.finish().map(|_| folder)
    }
}

fn rename_folder(from: &Path, to: &Path) -> Result<(), BagWriteError> {
    std::fs::rename(from, to).map_err(|source| BagWriteError::Io { path: to.to_owned(), source })
}

fn unwritable_bag(bag: &BagWriter, why: &str) -> BagWriteError {
    BagWriteError::Io { path: bag.folder().to_owned(), source: std::io::Error::other(why.to_owned()) }
}
