//! Where the camera's poses come from.

use super::{bag_index::BagIndex, topics::TopicChoice};
use capture::{CaptureConfig, CaptureError, TfBuffer, TrackCamera, stamp_secs};
use common::note::{Note, NoteCode};
use geometry::Pose;

/// Most sources of poses that are compared. chosen: more than a recording has, and each is quickly compared
const MOST_SOURCES: usize = 8;

/// How much a recording says about whose poses a source gives, the most first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Certainty {
    /// Its frames lead from the world to the color images.
    Named,
    /// It is taken for the camera's; the images have to confirm it.
    Assumed,
    /// The camera stands still: static transforms lead from the world to it.
    Stands,
}

/// Where the camera's poses come from.
#[derive(Clone, Debug)]
pub struct PoseSource {
    /// The transforms, including those of the pose topic if it is used.
    pub tf: TfBuffer,
    /// Frame of the poses.
    pub world: String,
    /// Frame of the color images.
    pub optical: String,
    /// `/tf` or the name of a pose topic.
    pub origin: String,
    /// Whether it is the camera's.
    pub certainty: Certainty,
    /// Number of invalid poses that were dropped.
    pub invalid: usize,
}

/// The sources of poses of a recording, and what is to be known about those that are none.
#[derive(Clone, Debug, Default)]
pub struct PoseSources {
    /// Those that can be used, the most certain first.
    pub sources: Vec<PoseSource>,
    /// Why there is none.
    pub refused: Option<String>,
    /// Whether the settings ask for poses, so that nothing takes their place.
    pub must: bool,
}

impl PoseSources {
    /// The sources of poses, none if the camera must be tracked.
    ///
    /// # Errors
    /// Those of [`PoseSource::asked`], if the settings ask for poses.
    pub fn wanted(
        index: &BagIndex,
        topics: &TopicChoice,
        config: &CaptureConfig,
    ) -> Result<Self, CaptureError> {
        // A user who names a frame or a topic of poses wants those.
        if config.tracking == TrackCamera::Always {
            return Ok(Self::default());
        }
        if config.asks_for_poses() {
            let source = PoseSource::asked(index, topics, config)?;
            return Ok(Self { sources: vec![source], refused: None, must: true });
        }
        let must = config.tracking == TrackCamera::Never;
        let sources = Self::found(index, topics);
        if !sources.is_empty() {
            return Ok(Self { sources, refused: None, must });
        }
        match PoseSource::asked(index, topics, config) {
            Ok(source) => Ok(Self { sources: vec![source], refused: None, must }),
            Err(error) if must => Err(error),
            // Nothing was recorded: that is said by all that is tracked.
            Err(CaptureError::NoTransform { .. } | CaptureError::StaticCamera { .. }) => Ok(Self::default()),
            Err(error) => Ok(Self { sources: Vec::new(), refused: Some(error.to_string()), must }),
        }
    }

    /// All sources of a recording, the most certain first.
    fn found(index: &BagIndex, topics: &TopicChoice) -> Vec<PoseSource> {
        let frame = index.images.get(&topics.color).map(|i| i.frame.clone()).unwrap_or_default();
        let mut sources = Vec::new();
        for optical in optical_frames(&index.tf, &frame) {
            let mut resting = Vec::new();
            for tf in index.tf.with_one_parent(&optical) {
                let source = PoseSource::of_tf(tf, &optical);
                let chain = source.tf.chain_of_frame(&optical);
                if chain.moves {
                    sources.push(source);
                } else if chain.root != optical && index.tf.invalid == 0 {
                    // Invalid transforms, which were dropped, would have moved it.
                    resting.push(PoseSource { certainty: Certainty::Stands, ..source });
                }
            }
            sources.extend(topic_sources(index, &optical));
            // A topic names a world, where a driver's own transforms may end at the camera.
            sources.extend(resting);
            // A frame that moves and carries no other, where nothing leads from it to the images.
            if !index.tf.has_parent(&optical) {
                let ends = index.tf.moving_ends().into_iter().take(MOST_SOURCES);
                sources.extend(ends.map(|end| PoseSource::assumed_at(index, &optical, end)));
            }
        }
        sources.sort_by_key(|s| s.certainty);
        sources.truncate(MOST_SOURCES);
        sources
    }
}

/// The optical frames of images in a frame: itself and, where it is named as the camera's body, those that
/// are fixed to it.
fn optical_frames(tf: &TfBuffer, frame: &str) -> Vec<String> {
    let mut frames = vec![frame.to_owned()];
    if !frame.contains("optical") {
        let below = tf.fixed_below(frame).into_iter().filter(|f| f.contains("optical"));
        let (color, other): (Vec<&str>, Vec<&str>) =
            below.partition(|f| f.contains("color") || f.contains("rgb"));
        let best = if color.is_empty() { other } else { color };
        frames.extend(best.into_iter().map(str::to_owned));
    }
    frames
}

/// The sources of all pose topics; those of a topic at rest are of a camera that stands still.
fn topic_sources(index: &BagIndex, optical: &str) -> Vec<PoseSource> {
    let mut children: Vec<(&String, &str, Certainty)> = Vec::new();
    let root = index.tf.chain_of_frame(optical).root;
    for (name, poses) in index.poses.iter().filter(|(_, poses)| !poses.samples.is_empty()) {
        match poses.child.as_deref().filter(|c| !c.is_empty()) {
            Some(child) => {
                children.push((name, child, Certainty::Named));
                if child != optical {
                    children.push((name, optical, Certainty::Assumed));
                }
            }
            // Without a name they are those of the images' frame or of what carries it.
            None => {
                children.push((name, optical, Certainty::Named));
                if root != optical {
                    children.push((name, &root, Certainty::Assumed));
                }
            }
        }
    }
    let mut sources = Vec::new();
    for (name, child, certainty) in children {
        let poses = &index.poses[name];
        let mut source = PoseSource::of_tf(index.tf.clone(), optical);
        source.tf.replace(&poses.parent, child, poses.samples.clone());
        source.world = source.tf.chain_of_frame(optical).root;
        source.origin.clone_from(name);
        source.certainty = if poses.moves() { certainty } else { Certainty::Stands };
        source.invalid = poses.invalid;
        // A child that does not carry the camera leaves the camera where it was.
        if source.world != root && poses.parent != optical {
            sources.push(source);
        }
    }
    sources
}

/// The only topic with poses, if there is one.
fn only_pose_topic(index: &BagIndex) -> Option<String> {
    let mut usable = index.poses.iter().filter(|(_, p)| !p.samples.is_empty() || p.invalid > 0);
    usable.next().filter(|_| usable.next().is_none()).map(|(name, _)| name.clone())
}

impl PoseSource {
    fn of_tf(tf: TfBuffer, optical: &str) -> Self {
        let world = tf.chain_of_frame(optical).root;
        let invalid = tf.invalid;
        let optical = optical.to_owned();
        Self { tf, world, optical, origin: "/tf".into(), certainty: Certainty::Named, invalid }
    }

    /// The camera taken to be where a moving frame is.
    fn assumed_at(index: &BagIndex, optical: &str, end: &str) -> Self {
        let mut tf = index.tf.clone();
        tf.add_static(end, optical, Pose::identity());
        let mut source = Self::of_tf(tf, optical);
        source.origin = format!("/tf of `{end}`");
        source.certainty = Certainty::Assumed;
        source
    }

    /// The source that the settings ask for, or else /tf, whatever is missing of it.
    ///
    /// # Errors
    /// [`CaptureError::NoTransform`], [`CaptureError::StaticCamera`], [`CaptureError::InvalidPoses`].
    pub fn asked(
        index: &BagIndex,
        topics: &TopicChoice,
        config: &CaptureConfig,
    ) -> Result<Self, CaptureError> {
        let optical = index.images.get(&topics.color).map(|i| i.frame.clone()).unwrap_or_default();
        let tf = index.tf.with_one_parent(&optical).into_iter().next().unwrap_or_default();
        let mut source = Self::of_tf(tf, &optical);
        // A frame without a topic is that of the only poses there are.
        let moves = source.tf.chain_of_frame(&optical).moves;
        if let Some(name) = topics.pose.clone().or_else(|| if moves { None } else { only_pose_topic(index) })
        {
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
            source.invalid = poses.invalid;
        }
        let chain = source.tf.chain_of_frame(&source.optical);
        // The root of the chain: the frame without a known parent.
        source.world = config.world_frame.clone().unwrap_or_else(|| chain.root.clone());
        // Checked first, as a missing parent or a camera at rest are only symptoms of this.
        if source.invalid > 0 && (!chain.moves || chain.root == source.optical) {
            return Err(CaptureError::InvalidPoses { topic: source.origin, count: source.invalid });
        }
        if chain.root == source.optical && config.world_frame.is_none() {
            return Err(no_world(index, topics, source.optical));
        }
        // One view is not a recording. A user who names the world frame is trusted.
        if !chain.moves && config.world_frame.is_none() {
            return Err(CaptureError::StaticCamera { frame: source.optical, root: chain.root });
        }
        Ok(source)
    }
}

/// The error of images whose frame leads to no world.
fn no_world(index: &BagIndex, topics: &TopicChoice, optical: String) -> CaptureError {
    let reason = if optical.is_empty() {
        "the images name no frame (header.frame_id is empty)"
    } else {
        "the frame has no parent on /tf or /tf_static"
    };
    let first = index.images.get(&topics.color).and_then(|i| i.entries.first());
    CaptureError::NoTransform {
        target: "a world frame".into(),
        source_frame: optical,
        stamp_secs: stamp_secs(first.map_or(0, |e| e.stamp_nanos)),
        reason: format!("{reason}; record /tf and /tf_static, or camera poses on a topic of their own"),
    }
}

/// The note on poses that are there and not used.
#[must_use]
pub fn poses_unused(why: &str) -> Note {
    let text = format!("the recorded poses cannot be used, so the camera is tracked by the images: {why}");
    Note::new(NoteCode::PosesUnused, text)
}
