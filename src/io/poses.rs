//! Where the camera's poses come from.

use super::{bag_index::BagIndex, topics::TopicChoice};
use capture::{CaptureConfig, CaptureError, TfBuffer, TrackCamera, stamp_secs};

/// Where the camera's poses come from.
pub struct PoseSource {
    /// The transforms, including those of the pose topic if it is used.
    pub tf: TfBuffer,
    /// Frame of the poses.
    pub world: String,
    /// Frame of the color images.
    pub optical: String,
    /// `/tf` or the name of a pose topic.
    pub origin: String,
    from_topic: bool,
}

/// The only topic with usable poses; `None` if there are several or none.
fn only_pose_topic(index: &BagIndex) -> Option<String> {
    let mut usable = index.poses.iter().filter(|(_, p)| !p.samples.is_empty() || p.invalid > 0);
    usable.next().filter(|_| usable.next().is_none()).map(|(name, _)| name.clone())
}

impl PoseSource {
    /// Where the poses come from, or `None` if the camera must be tracked.
    ///
    /// # Errors
    /// Those of [`Self::find`], if the settings ask for poses or the recorded ones are damaged.
    pub fn wanted(
        index: &BagIndex,
        topics: &TopicChoice,
        config: &CaptureConfig,
    ) -> Result<Option<Self>, CaptureError> {
        // A user who names a frame or a topic of poses wants those.
        let asked = config.world_frame.is_some() || config.pose_frame.is_some() || topics.pose.is_some();
        match (config.tracking, Self::find(index, topics, config)) {
            (TrackCamera::Always, _) => Ok(None),
            (
                TrackCamera::Auto,
                Err(CaptureError::NoTransform { .. } | CaptureError::StaticCamera { .. }),
            ) if !asked => Ok(None),
            (_, found) => found.map(Some),
        }
    }

    /// Finds where the poses of the color images come from: the requested topic, else /tf if the
    /// camera moves there, else the only pose topic.
    ///
    /// # Errors
    /// [`CaptureError::NoTransform`], [`CaptureError::StaticCamera`], [`CaptureError::InvalidPoses`].
    pub fn find(
        index: &BagIndex,
        topics: &TopicChoice,
        config: &CaptureConfig,
    ) -> Result<Self, CaptureError> {
        let optical = index.images.get(&topics.color).map(|i| i.frame.clone()).unwrap_or_default();
        // Only a chain with a moving frame can locate a moving camera.
        let moves = index.tf.chain_of_frame(&optical).moves;
        // A pose topic may belong to anything, such as a robot's base: unless requested, it is used only if
        // /tf is at rest.
        let topic = topics.pose.clone().or_else(|| if moves { None } else { only_pose_topic(index) });
        let mut source = Self {
            tf: index.tf.clone(),
            world: String::new(),
            optical,
            origin: "/tf".into(),
            from_topic: false,
        };
        if let Some(name) = topic {
            let poses = index.poses.get(&name).cloned().unwrap_or_default();
            let child = config
                .pose_frame
                .clone()
                // PoseStamped names no child, and Odometry may leave it empty: then the pose is the camera's.
                .or(poses.child)
                .filter(|c| !c.is_empty())
                .unwrap_or_else(|| source.optical.clone());
            source.tf.replace(&poses.parent, &child, poses.samples);
            source.origin = name;
            source.from_topic = true;
        }
        let chain = source.tf.chain_of_frame(&source.optical);
        // The root of the chain: the frame without a known parent.
        source.world = config.world_frame.clone().unwrap_or_else(|| chain.root.clone());
        // Checked first, as a missing parent or a camera at rest are only symptoms of this.
        if source.invalid(index) > 0
            && (!chain.moves || source.tf.chain_of_frame(&source.optical).root == source.optical)
        {
            return Err(CaptureError::InvalidPoses {
                topic: source.origin.clone(),
                count: source.invalid(index),
            });
        }
        if chain.root == source.optical && config.world_frame.is_none() {
            let reason = if source.optical.is_empty() {
                "the images name no frame (header.frame_id is empty)"
            } else {
                "the frame has no parent on /tf or /tf_static"
            };
            return Err(CaptureError::NoTransform {
                target: "a world frame".into(),
                source_frame: source.optical,
                stamp_secs: stamp_secs(
                    index
                        .images
                        .get(&topics.color)
                        .and_then(|i| i.entries.first())
                        .map_or(0, |e| e.stamp_nanos),
                ),
                reason: format!(
                    "{reason}; record /tf and /tf_static, or camera poses as PoseStamped or Odometry"
                ),
            });
        }
        // One view is not a recording. A user who names the world frame is trusted.
        if !chain.moves && config.world_frame.is_none() {
            return Err(CaptureError::StaticCamera { frame: source.optical, root: chain.root });
        }
        Ok(source)
    }

    /// Number of invalid poses that were dropped.
    #[must_use]
    pub fn invalid(&self, index: &BagIndex) -> usize {
        if self.from_topic {
            index.poses.get(&self.origin).map_or(0, |p| p.invalid)
        } else {
            index.tf.invalid
        }
    }
}
