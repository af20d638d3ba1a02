//! From an indexed bag to posed RGB-D views, still without pixels: chooses topics, pairs messages, checks
//! cameras, looks up the camera's pose.

use super::{
    bag::Bag,
    bag_index::{BagIndex, InfoTopic},
    camera::pinhole,
    depth_camera::{Camera, DepthSource},
    image_codec::{counts_units, has_opencv_order},
    imu::accelerometer,
    pose_candidate::PoseCandidate,
    poses::{PoseSource, PoseSources, poses_unused},
    synchronize::{Matched, synchronized},
    topics::{TopicChoice, choose},
};
use capture::{Accelerometer, CaptureConfig, CaptureError, nearest_stamp, stamp_secs};
use common::note::{Note, NoteCode};
use geometry::{Intrinsics, Pose};

/// Length of a unit of depth in whole numbers, meters. derived: REP 118
const REP_118_UNIT_M: f64 = 0.001;

/// One RGB-D view, by the indices of its messages.
#[derive(Clone, Debug)]
pub struct View {
    /// Stamp of the color image, nanoseconds.
    pub stamp_nanos: i64,
    /// Recording time of the color image, nanoseconds.
    pub log_nanos: i64,
    /// Index of the color message.
    pub color: usize,
    /// Index of the depth message.
    pub depth: usize,
    /// Index of the mask message, if any.
    pub mask: Option<usize>,
    /// Its camera, an index into [`Views::cameras`].
    pub camera: usize,
    /// Pose of the optical frame; `None` if the camera must be tracked.
    pub world_from_camera: Option<Pose>,
}

/// The views of a bag.
#[derive(Clone, Debug)]
pub struct Views {
    /// The topics from which they come.
    pub topics: TopicChoice,
    /// Frame of the poses; empty until they are settled, and if the camera must be tracked.
    pub world_frame: String,
    /// Distinct cameras.
    pub cameras: Vec<Camera>,
    /// Views, sorted by stamp.
    pub views: Vec<View>,
    /// Sources of poses, the most certain first, with a pose for each view or none.
    pub(super) candidates: Vec<PoseCandidate>,
    /// The source of the poses that are used, and the pose of the camera in the frame that they are of.
    pub(super) used: Option<(PoseSource, Pose)>,
    /// Factor applied to depth readings.
    pub depth_factor: f64,
    /// Whether depth counts units whose length neither the recording nor the settings give.
    pub(super) has_unknown_unit: bool,
    /// The topics that are used, and those that could have been.
    pub(super) topics_text: String,
    /// Source of the up direction for a tracked camera.
    pub accelerometer: Option<Accelerometer>,
    /// The note on it, for where the camera is tracked.
    pub(super) accelerometer_note: Option<Note>,
    /// Notes on the chosen topics.
    pub notes: Vec<Note>,
    /// Warnings about losses.
    pub warnings: Vec<Note>,
}

/// The note on how many views of a state are kept.
#[must_use]
pub fn views_kept(state: usize, kept: usize, all: usize) -> Note {
    let text = format!("state {state}: {kept} of {all} views kept, by the spread of their poses");
    Note::new(NoteCode::ViewsKept, text)
}

impl Views {
    /// The views of an indexed bag, and the sources of their poses, among which `probe::settle` chooses.
    /// `state` is used in messages.
    ///
    /// # Errors
    /// Every [`CaptureError`] about topics, cameras, depth and poses.
    pub fn find(
        bag: &Bag,
        index: &BagIndex,
        config: &CaptureConfig,
        state: usize,
    ) -> Result<Self, CaptureError> {
        let topics = choose(&index.summaries(), &config.topics, &bag.path)?;
        let mut found = Self {
            topics,
            world_frame: String::new(),
            cameras: Vec::new(),
            views: Vec::new(),
            candidates: Vec::new(),
            used: None,
            depth_factor: 1.0,
            has_unknown_unit: false,
            accelerometer: None,
            accelerometer_note: None,
            topics_text: String::new(),
            notes: bag.notes.clone(),
            warnings: Vec::new(),
        };
        found.warnings.extend(bag.warnings.iter().cloned());
        found.warnings.extend(index.damage());
        let depth_encoding = index.images.get(&found.topics.depth).map_or("", |i| i.encoding.as_str());
        if counts_units(depth_encoding) {
            let unit_m = config.depth_unit_m.or(bag.depth_unit_m());
            found.depth_factor = depth_factor(unit_m);
            found.has_unknown_unit = unit_m.is_none();
        }
        // First messages of one moment, then their cameras, then their poses: losses of each step are
        // reported separately.
        let matches = synchronized(&found.topics, index, config, state, &mut found.warnings)?;
        let cameras = found.find_cameras(index)?;
        let by_stamp = by_stamp(&cameras);
        for m in &matches {
            let camera = by_stamp.camera(m.color.stamp_nanos);
            found.check_sizes(m, &found.cameras[camera])?;
            found.views.push(View::of(m, camera));
        }
        let sources = PoseSources::wanted(index, &found.topics, config)?;
        found.find_poses(index, config, state, sources)?;
        let optical = index.images.get(&found.topics.color).map_or("", |i| i.frame.as_str());
        (found.accelerometer, found.accelerometer_note) = accelerometer(&index.imus, &index.tf, optical);
        found.topics_text = found.chosen_topics(bag, index);
        Ok(found)
    }

    /// Keeps the sources that give enough views a pose.
    ///
    /// # Errors
    /// [`CaptureError::NoPoses`] and [`CaptureError::InvalidPoses`] where the settings ask for poses.
    fn find_poses(
        &mut self,
        index: &BagIndex,
        config: &CaptureConfig,
        state: usize,
        sources: PoseSources,
    ) -> Result<(), CaptureError> {
        let must = sources.must;
        let all = self.views.len();
        let mut candidates: Vec<PoseCandidate> =
            sources.sources.into_iter().map(|s| PoseCandidate::of_source(s, self, index, config)).collect();
        let too_few = candidates.first().map(|c| c.error(state, all));
        candidates.retain(|c| c.is_enough(all) || (must && c.count() > 0));
        if candidates.is_empty() {
            match too_few {
                Some(error) if must => return Err(error),
                Some(error) => self.warnings.push(poses_unused(&error.to_string())),
                None => self.warnings.extend(sources.refused.map(|why| poses_unused(&why))),
            }
        }
        self.candidates = candidates;
        Ok(())
    }

    /// Gives the views the poses of a candidate; those without one are dropped and reported.
    pub(super) fn take_poses(&mut self, candidate: usize, state: usize) {
        let chosen = &self.candidates[candidate];
        self.world_frame.clone_from(&chosen.source.world);
        self.used = Some((chosen.source.clone(), Pose::identity()));
        self.warnings.extend(chosen.warnings(state, self.views.len()));
        for (view, pose) in self.views.iter_mut().zip(&chosen.poses) {
            view.world_from_camera = *pose;
        }
        self.views.retain(|view| view.world_from_camera.is_some());
    }

    /// Brings the poses of a frame to the camera in it.
    pub(super) fn mount(&mut self, posed_from_camera: &Pose) {
        for view in &mut self.views {
            view.world_from_camera = view.world_from_camera.map(|pose| pose * posed_from_camera);
        }
        if let Some((_, mounted)) = &mut self.used {
            *mounted = *posed_from_camera;
        }
    }

    /// Pose of the camera at a stamp; `None` where none was recorded.
    #[must_use]
    pub fn pose_at(&self, stamp_nanos: i64, config: &CaptureConfig) -> Option<Pose> {
        let gap = (config.tf_max_gap_secs * 1e9) as i64;
        let delay = (config.pose_delay_secs * 1e9) as i64;
        let (source, mounted) = self.used.as_ref()?;
        let pose = source.tf.lookup(&source.world, &source.optical, stamp_nanos + delay, gap).ok()?;
        Some(pose * mounted)
    }

    /// `frames` frames, with their columns and rows.
    #[must_use]
    pub fn sizes(&self, frames: usize) -> (usize, usize, usize) {
        let (width, height) =
            self.cameras.first().map_or((0, 0), |c| (c.intrinsics.width, c.intrinsics.height));
        (frames, width, height)
    }

    /// Adds the notes on the topics, the poses and the accelerometer that are used, once poses are settled.
    pub(super) fn tell_what_is_used(&mut self, poses: Option<&str>) {
        if poses.is_none() {
            self.notes.extend(self.accelerometer_note.take());
        }
        let poses = poses.unwrap_or("no camera poses: tracked by the images");
        self.notes.push(Note::new(NoteCode::TopicsChosen, format!("{}, {poses}", self.topics_text)));
    }

    /// The topics that are used, and those that could have been.
    fn chosen_topics(&self, bag: &Bag, index: &BagIndex) -> String {
        let t = &self.topics;
        let mask = t.mask.as_ref().map_or("no mask topic".into(), |m| format!("masks {m}"));
        let encoding = index.images.get(&t.color).map_or("", |i| i.encoding.as_str());
        let order = if has_opencv_order(encoding) {
            format!(" ({encoding}: its channels are taken for blue, green, red, as OpenCV has them)")
        } else {
            String::new()
        };
        let others =
            if t.others.is_empty() { String::new() } else { format!(" (not used: {})", t.others.join(", ")) };
        format!(
            "{}: color {}{order}, depth {}, camera_info {}, {mask}{others}",
            bag.path.display(),
            t.color,
            t.depth,
            t.color_info
        )
    }

    /// The cameras of the color topic's distinct parameters, checked against those of depth.
    fn find_cameras(&mut self, index: &BagIndex) -> Result<InfoTopic, CaptureError> {
        let t = &self.topics;
        let mut infos = index.infos.get(&t.color_info).cloned().unwrap_or_default();
        let lost = infos.settle();
        if lost > 0 {
            self.warnings.push(Note::new(
                NoteCode::CameraInfoContradicted,
                format!("{}: {lost} messages contradict all others and are not used", t.color_info),
            ));
        }
        let source = DepthSource::of_topics(t, index)?;
        for info in &infos.distinct {
            let (intrinsics, color) = pinhole(info, &t.color_info, &t.color)?;
            // Focus may change from frame to frame, but not the size of the images.
            let first = self.cameras.first().map_or(intrinsics, |c| c.intrinsics);
            if (first.width, first.height) != (intrinsics.width, intrinsics.height) {
                return Err(CaptureError::ImageSize {
                    topic: t.color_info.clone(),
                    width: intrinsics.width,
                    height: intrinsics.height,
                    stamp_secs: 0.0,
                    expected: "earlier messages",
                    expected_width: first.width,
                    expected_height: first.height,
                });
            }
            self.cameras.push(source.camera(intrinsics, color)?);
        }
        let Some(camera) = self.cameras.first() else { return Ok(infos) };
        if !camera.color.is_pinhole() || !camera.depth.is_pinhole() {
            self.notes.push(Note::new(
                NoteCode::ImagesUndistorted,
                format!("images are undistorted by {}", self.topics.color_info),
            ));
        }
        self.notes.extend(camera.registration_note(&self.topics.depth));
        Ok(infos)
    }

    /// Whether the camera must be tracked.
    #[must_use]
    pub fn are_untracked(&self) -> bool {
        self.views.iter().all(|v| v.world_from_camera.is_none())
    }

    fn check_sizes(&self, m: &Matched, camera: &Camera) -> Result<(), CaptureError> {
        let color = &camera.intrinsics;
        let mask = (m.mask.as_ref(), self.topics.mask.as_ref().unwrap_or(&self.topics.color), color);
        let messages = [
            (Some(&m.color), &self.topics.color, color),
            (Some(&m.depth), &self.topics.depth, camera.of_depth()),
        ];
        for (entry, topic, camera) in messages.into_iter().chain([mask]) {
            let Some(entry) = entry else { continue };
            if let Some(size) = entry.size {
                check_size(topic, size, entry.stamp_nanos, camera)?;
            }
        }
        Ok(())
    }
}

/// What multiplies depth whose integers were taken for millimeters.
#[must_use]
pub fn depth_factor(unit_m: Option<f64>) -> f64 {
    unit_m.unwrap_or(REP_118_UNIT_M) / REP_118_UNIT_M
}

/// Refuses an image with another size than its camera's.
///
/// # Errors
/// [`CaptureError::ImageSize`].
pub fn check_size(
    topic: &str,
    (width, height): (usize, usize),
    stamp_nanos: i64,
    camera: &Intrinsics,
) -> Result<(), CaptureError> {
    if (width, height) == (camera.width, camera.height) {
        return Ok(());
    }
    Err(CaptureError::ImageSize {
        topic: topic.to_owned(),
        width,
        height,
        stamp_secs: stamp_secs(stamp_nanos),
        expected: "the color images' camera_info",
        expected_width: camera.width,
        expected_height: camera.height,
    })
}

/// Cameras by stamp.
struct ByStamp {
    stamps: Vec<i64>,
    cameras: Vec<usize>,
    several: bool,
}

fn by_stamp(infos: &InfoTopic) -> ByStamp {
    let mut entries = infos.entries.clone();
    // Sorted by stamp, as `nearest` requires; the bag's order is that of recording.
    entries.sort_by_key(|e| e.0);
    let (stamps, cameras) = entries.into_iter().unzip();
    ByStamp { stamps, cameras, several: infos.distinct.len() != 1 }
}

impl ByStamp {
    /// Index of the camera of an image; a single one is valid for all, even if its camera_info was sent only
    /// once.
    fn camera(&self, stamp: i64) -> usize {
        if self.several { nearest_stamp(&self.stamps, stamp).map_or(0, |i| self.cameras[i]) } else { 0 }
    }
}

impl View {
    fn of(matched: &Matched, camera: usize) -> Self {
        Self {
            stamp_nanos: matched.color.stamp_nanos,
            log_nanos: matched.color.log_nanos,
            color: matched.color.ordinal,
            depth: matched.depth.ordinal,
            mask: matched.mask.as_ref().map(|e| e.ordinal),
            camera,
            world_from_camera: None,
        }
    }
}
