//! From an indexed bag to posed RGB-D views, still without pixels: chooses topics, pairs messages, checks
//! cameras, looks up the camera's pose.

use super::{
    bag::Bag,
    bag_index::{BagIndex, ImageEntry, InfoTopic},
    camera::pinhole,
    imu::accelerometer,
    poses::PoseSource,
    topics::{TopicChoice, choose},
};
use capture::{Accelerometer, CaptureConfig, CaptureError, Distortion, nearest_stamp, pair, stamp_secs};
use common::note::{Note, NoteCode};
use geometry::{Intrinsics, Pose};

/// Length of a unit of depth in whole numbers, meters. derived: REP 118
const REP_118_UNIT_M: f64 = 0.001;
/// Largest relative difference of focal lengths of aligned images. chosen: drivers round them
const FOCAL_TOLERANCE: f64 = 0.005;
/// Largest difference of principal points of aligned images, pixels. chosen: drivers round them
const CENTER_TOLERANCE_PX: f64 = 1.0;
/// Largest distance between frames of aligned images, meters and radians. chosen: drivers round them
const FRAME_TOLERANCE: f64 = 1e-3;

/// A pinhole camera with the distortion of its lenses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The ideal camera.
    pub intrinsics: Intrinsics,
    /// Distortion of the color images.
    pub color: Distortion,
    /// Distortion of the depth images.
    pub depth: Distortion,
}

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
    /// Frame of the poses; empty if the camera must be tracked.
    pub world_frame: String,
    /// Distinct cameras.
    pub cameras: Vec<Camera>,
    /// Views, sorted by stamp.
    pub views: Vec<View>,
    /// Factor applied to depth readings.
    pub depth_factor: f64,
    /// Source of the up direction for a tracked camera.
    pub accelerometer: Option<Accelerometer>,
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
    /// The views of an indexed bag. `state` is used in messages.
    ///
    /// # Errors
    /// Every [`CaptureError`] about topics, cameras, alignment and poses.
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
            depth_factor: bag.depth_unit_m().map_or(1.0, |unit_m| unit_m / REP_118_UNIT_M),
            accelerometer: None,
            notes: bag.notes.clone(),
            warnings: Vec::new(),
        };
        found.warnings.extend(bag.warnings.iter().cloned());
        found.warnings.extend(index.damage());
        // First messages of one moment, then their cameras, then their poses: losses of each step are
        // reported separately.
        let matches = found.synchronize(index, config, state)?;
        let cameras = found.find_cameras(index)?;
        let poses = PoseSource::wanted(index, &found.topics, config)?;
        match &poses {
            Some(poses) => {
                found.world_frame = poses.world.clone();
                found.place(index, config, state, &matches, &cameras, poses)?;
            }
            None => {
                found.without_poses(&matches, &cameras)?;
                let optical = index.images.get(&found.topics.color).map_or("", |i| i.frame.as_str());
                let (instrument, note) = accelerometer(&index.imus, &index.tf, optical);
                found.accelerometer = instrument;
                found.notes.extend(note);
            }
        }
        found.notes.push(Note::new(
            NoteCode::TopicsChosen,
            format!("{}: {}", bag.path.display(), found.describe_topics(poses.as_ref())),
        ));
        Ok(found)
    }

    /// `frames` frames, with their columns and rows.
    #[must_use]
    pub fn sizes(&self, frames: usize) -> (usize, usize, usize) {
        let (width, height) =
            self.cameras.first().map_or((0, 0), |c| (c.intrinsics.width, c.intrinsics.height));
        (frames, width, height)
    }

    fn describe_topics(&self, poses: Option<&PoseSource>) -> String {
        let t = &self.topics;
        let mask = t.mask.as_ref().map_or("no mask topic".into(), |m| format!("masks {m}"));
        let poses = poses.map_or("no camera poses: tracked by the images".into(), |p| {
            format!("poses of `{}` in `{}` from {}", p.optical, p.world, p.origin)
        });
        format!("color {}, depth {}, camera_info {}, {mask}, {poses}", t.color, t.depth, t.color_info)
    }

    /// Pairs color, depth and mask messages of the same views, and reports losses.
    fn synchronize(
        &mut self,
        index: &BagIndex,
        config: &CaptureConfig,
        state: usize,
    ) -> Result<Vec<Matched>, CaptureError> {
        let entries = |topic: &str| index.images.get(topic).map_or(&[][..], |i| &i.entries[..]);
        let stamps = |topic: &str| entries(topic).iter().map(|e| e.stamp_nanos).collect::<Vec<_>>();
        let slop = (config.sync_slop_secs * 1e9) as i64;
        let color = stamps(&self.topics.color);
        // Color leads (docs/method.md 2.2): each view has the stamp, camera and pose of its color image.
        let depth = pair(&color, &stamps(&self.topics.depth), slop);
        let mask = self
            .topics
            .mask
            .as_ref()
            // Masks that are not used must not cost frames without one.
            .filter(|_| config.isolate.use_masks)
            .map(|topic| pair(&color, &stamps(topic), slop));
        let mut matched = Vec::new();
        let mut no_depth = 0;
        let mut no_mask = 0;
        for (i, entry) in entries(&self.topics.color).iter().enumerate() {
            let Some(d) = depth[i] else {
                no_depth += 1;
                continue;
            };
            let mask = match (&mask, &self.topics.mask) {
                (Some(partners), Some(topic)) => match partners[i] {
                    Some(m) => Some(entries(topic)[m].clone()),
                    None => {
                        // Without its mask, a frame's background would count as the object.
                        no_mask += 1;
                        continue;
                    }
                },
                _ => None,
            };
            matched.push(Matched {
                color: entry.clone(),
                depth: entries(&self.topics.depth)[d].clone(),
                mask,
            });
        }
        let slop_ms = config.sync_slop_secs * 1e3;
        if no_depth > 0 {
            self.warnings.push(Note::new(NoteCode::DepthUnpaired, format!(
                "state {state}: {no_depth} of {} color images have no depth image within {slop_ms} ms and \
                 are not used",
                color.len()
            )));
        }
        if no_mask > 0 {
            self.warnings.push(Note::new(NoteCode::MasksUnpaired, format!(
                "state {state}: {no_mask} of {} color images have no mask within {slop_ms} ms and are not \
                 used",
                color.len()
            )));
        }
        for topic in [&self.topics.color, &self.topics.depth] {
            if let Some(strays) = index.images.get(topic).map(|i| i.strays).filter(|n| *n > 0) {
                self.warnings.push(Note::new(
                    NoteCode::ImagesInOtherFrame,
                    format!("{topic}: {strays} images are in another frame than the first and are not used"),
                ));
            }
        }
        if matched.is_empty() {
            let reason = format!(
                "of {} color and {} depth images none are within {slop_ms} ms of each other{}; check the \
                 header stamps or raise the limit with `--set capture.sync_slop_secs=SECONDS`",
                color.len(),
                entries(&self.topics.depth).len(),
                if no_mask > 0 { " and of a mask" } else { "" }
            );
            return Err(CaptureError::NoFrames { state, reason });
        }
        // Messages are in the order of recording, which may differ from that of their stamps.
        matched.sort_by_key(|m| (m.color.stamp_nanos, m.color.ordinal));
        Ok(matched)
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
        // The first stands for all: aligned depth has the camera of the color images.
        let mut depth_infos =
            t.depth_info.as_ref().and_then(|n| index.infos.get(n)).cloned().unwrap_or_default();
        depth_infos.settle();
        let aligned = depth_infos.distinct.into_iter().next();
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
            // Without its own camera_info, depth aligned to color has color's lens.
            let mut depth = color;
            if let (Some(depth_info), Some(name)) = (&aligned, &t.depth_info) {
                let (other, distortion) = pinhole(depth_info, name, &t.depth)?;
                depth = distortion;
                self.check_alignment(index, &intrinsics, &other)?;
            } else {
                // Depth has no camera_info to compare; the optical frames are still compared.
                self.check_alignment(index, &intrinsics, &intrinsics)?;
            }
            self.cameras.push(Camera { intrinsics, color, depth });
        }
        match self.cameras.first() {
            Some(camera) if !camera.color.is_pinhole() || !camera.depth.is_pinhole() => {
                self.notes.push(Note::new(
                    NoteCode::ImagesUndistorted,
                    format!("images are undistorted by {}", self.topics.color_info),
                ));
            }
            _ => {}
        }
        Ok(infos)
    }

    fn check_alignment(
        &self,
        index: &BagIndex,
        color: &Intrinsics,
        depth: &Intrinsics,
    ) -> Result<(), CaptureError> {
        let t = &self.topics;
        let refuse =
            |reason| Err(CaptureError::NotAligned { depth: t.depth.clone(), color: t.color.clone(), reason });
        if (color.width, color.height) != (depth.width, depth.height) {
            return refuse(format!(
                "depth is {}x{}, color {}x{}",
                depth.width, depth.height, color.width, color.height
            ));
        }
        let focal = (color.fx / depth.fx - 1.0).abs().max((color.fy / depth.fy - 1.0).abs());
        let center = (color.cx - depth.cx).abs().max((color.cy - depth.cy).abs());
        // Aligned depth has color's matrix up to rounding; unaligned depth differs by far more.
        if focal > FOCAL_TOLERANCE || center > CENTER_TOLERANCE_PX {
            return refuse(format!(
                "their camera matrices differ (fx {:.1} and {:.1}, cx {:.1} and {:.1})",
                depth.fx, color.fx, depth.cx, color.cx
            ));
        }
        let frame = |topic: &str| index.images.get(topic).map_or("", |i| i.frame.as_str());
        let color_frame = frame(&t.color);
        let depth_frame = frame(&t.depth);
        if color_frame == depth_frame {
            return Ok(());
        }
        // Stamp 0 and no gap: only a static transform can answer.
        match index.tf.lookup(color_frame, depth_frame, 0, 0) {
            Ok(pose)
                if pose.translation.vector.norm() <= FRAME_TOLERANCE
                    && pose.rotation.angle() <= FRAME_TOLERANCE =>
            {
                Ok(())
            }
            Ok(pose) => refuse(format!(
                "frame `{depth_frame}` lies {:.1} mm from `{color_frame}`",
                1e3 * pose.translation.vector.norm()
            )),
            Err(_) => refuse(format!(
                "it is in frame `{depth_frame}`, color in `{color_frame}`, and no static transform says \
                 that they are one"
            )),
        }
    }

    /// Gives every match its camera and pose; those without a pose are dropped and reported.
    fn place(
        &mut self,
        index: &BagIndex,
        config: &CaptureConfig,
        state: usize,
        matches: &[Matched],
        infos: &InfoTopic,
        poses: &PoseSource,
    ) -> Result<(), CaptureError> {
        let gap = (config.tf_max_gap_secs * 1e9) as i64;
        let delay = (config.pose_delay_secs * 1e9) as i64;
        let by_stamp = by_stamp(infos);
        let mut failures = 0;
        let mut first_failure = None;
        for m in matches {
            let stamp = m.color.stamp_nanos;
            let camera = by_stamp.camera(stamp);
            self.check_sizes(m, self.cameras[camera].intrinsics)?;
            // (2.2), at the stamp of the color image; nothing is extrapolated.
            match poses.tf.lookup(&poses.world, &poses.optical, stamp + delay, gap) {
                Ok(world_from_camera) => self.views.push(View::of(m, camera, Some(world_from_camera))),
                Err(error) => {
                    failures += 1;
                    first_failure.get_or_insert(error);
                }
            }
        }
        let invalid = poses.invalid(index);
        let first = first_failure.map(|e| e.to_string());
        if self.views.is_empty() {
            // Reported as the cause: a missing pose is only its symptom.
            if invalid > 0 {
                return Err(CaptureError::InvalidPoses { topic: poses.origin.clone(), count: invalid });
            }
            return Err(CaptureError::NoPoses {
                state,
                frames: matches.len(),
                first: first.unwrap_or_default(),
            });
        }
        if let Some(first) = first {
            self.warnings.push(Note::new(
                NoteCode::PosesMissing,
                format!(
                    "state {state}: {failures} of {} frames have no camera pose and are not used (first: \
                 {first})",
                    matches.len()
                ),
            ));
        }
        if invalid > 0 {
            self.warnings.push(Note::new(NoteCode::TransformsInvalid, format!(
                "state {state}: {invalid} transforms from {} are invalid (NaN, or no unit quaternion) and \
                 are not used",
                poses.origin
            )));
        }
        Ok(())
    }

    /// Gives every match its camera, without a pose: the camera must be tracked.
    fn without_poses(&mut self, matches: &[Matched], infos: &InfoTopic) -> Result<(), CaptureError> {
        let by_stamp = by_stamp(infos);
        for m in matches {
            let camera = by_stamp.camera(m.color.stamp_nanos);
            self.check_sizes(m, self.cameras[camera].intrinsics)?;
            self.views.push(View::of(m, camera, None));
        }
        Ok(())
    }

    /// Whether the camera must be tracked.
    #[must_use]
    pub fn are_untracked(&self) -> bool {
        self.views.iter().all(|v| v.world_from_camera.is_none())
    }

    fn check_sizes(&self, m: &Matched, camera: Intrinsics) -> Result<(), CaptureError> {
        let messages = [(Some(&m.color), &self.topics.color), (Some(&m.depth), &self.topics.depth)];
        let mask = (m.mask.as_ref(), self.topics.mask.as_ref().unwrap_or(&self.topics.color));
        for (entry, topic) in messages.into_iter().chain([mask]) {
            let Some(entry) = entry else { continue };
            if let Some(size) = entry.size {
                check_size(topic, size, entry.stamp_nanos, &camera)?;
            }
        }
        Ok(())
    }
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
    fn of(matched: &Matched, camera: usize, world_from_camera: Option<Pose>) -> Self {
        Self {
            stamp_nanos: matched.color.stamp_nanos,
            log_nanos: matched.color.log_nanos,
            color: matched.color.ordinal,
            depth: matched.depth.ordinal,
            mask: matched.mask.as_ref().map(|e| e.ordinal),
            camera,
            world_from_camera,
        }
    }
}

struct Matched {
    color: ImageEntry,
    depth: ImageEntry,
    mask: Option<ImageEntry>,
}
