//! The recording of one state: the needs of its kept views, and nothing else.

use std::path::{Path, PathBuf};

use super::view::View;
use io::{
    BagWriteError, BagWriter, OfferedQos,
    ros2msg::{
        CameraInfo, Header, PoseStamped, TfMessage, TransformStamped, definitions::RosMessage, encode,
        odometry::FullOdometry,
    },
};

/// How images were offered, as far as a recording says.
const SENSOR: OfferedQos = OfferedQos { reliable: false, latched: false, depth: 10 };
const RELIABLE: OfferedQos = OfferedQos { reliable: true, latched: false, depth: 100 };
const LATCHED: OfferedQos = OfferedQos { reliable: true, latched: true, depth: 1 };

/// Names of the topics, remapped.
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
    /// Camera poses in place of `/tf`; whether they are odometry.
    pub pose: Option<(String, bool)>,
}

/// The recording of one state while it is written.
pub(crate) struct StateBag {
    bag: BagWriter,
    topics: Topics,
    fixed: Vec<TransformStamped>,
    /// New place of an earlier recording.
    replaced: Option<PathBuf>,
}

impl StateBag {
    /// Opens `session/state<N>`. An earlier one is kept as `state<N>_replaced<K>`.
    ///
    /// # Errors
    /// If the disk refuses.
    pub(crate) fn create(session: &Path, state: usize, topics: Topics) -> Result<Self, BagWriteError> {
        let folder = session.join(format!("state{state}"));
        let spare = || (1..).map(|k| session.join(format!("state{state}_replaced{k}"))).find(|p| !p.exists());
        let replaced = folder.exists().then(spare).flatten();
        if let Some(spare) = &replaced {
            rename_folder(&folder, spare)?;
        }
        Ok(Self { bag: BagWriter::create(&folder)?, topics, fixed: Vec::new(), replaced })
    }

    /// Removes the recording and puts back the earlier one.
    ///
    /// # Errors
    /// If the disk refuses.
    pub(crate) fn abandon(self) -> Result<(), BagWriteError> {
        let folder = self.bag.folder().to_owned();
        // Closed first: some systems do not remove open files.
        drop(self.bag);
        std::fs::remove_dir_all(&folder)
            .map_err(|source| BagWriteError::Io { path: folder.clone(), source })?;
        self.replaced.map_or(Ok(()), |spare| rename_folder(&spare, &folder))
    }

    /// Writes a view: its transforms first, for replays. `infos` of color and depth, `fixed` transforms,
    /// those `around` its stamp; the one of the frame `posed` came from the pose topic.
    ///
    /// # Errors
    /// If the disk refuses.
    pub(crate) fn write_view(
        &mut self,
        view: &View,
        infos: [Option<&CameraInfo>; 2],
        fixed: Vec<TransformStamped>,
        around: Vec<TransformStamped>,
        posed: Option<&str>,
        now_nanos: i64,
    ) -> Result<(), BagWriteError> {
        // Latched in a replay: once is enough, unless one of them changed.
        if fixed != self.fixed {
            self.write_message("/tf_static", LATCHED, now_nanos, &TfMessage { transforms: fixed.clone() })?;
            self.fixed = fixed;
        }
        self.write_transforms(around, posed, now_nanos)?;
        let topics = self.topics.clone();
        // With each view: a reader may cut the bag anywhere.
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

    /// The transforms about a stamp; those of the pose topic under its name.
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
    /// If the disk refuses.
    pub(crate) fn flush(&mut self) -> Result<(), BagWriteError> {
        self.bag.flush()
    }

    /// Closes the recording; its folder.
    ///
    /// # Errors
    /// If the disk refuses.
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
