//! From messages to the recordings of two states: matches images, looks up the camera pose, keeps new views
//! and writes them to a bag. Independent of middleware and clock.

mod keep;
mod to_track;
mod tracked;

use std::{
    collections::VecDeque,
    path::{Path, PathBuf},
};

use self::to_track::TrackedMap;
use super::{
    collect_error::CollectError,
    counts::Counts,
    keyframes::{KeyframeRule, Keyframes},
    live_tf::LiveTf,
    sample::{Picture, Sample},
    state_bag::{StateBag, Topics},
    synchronizer::{Matched, Synchronizer},
    view::View,
};
use capture::{CaptureConfig, RgbdFrame, TrackCamera, stamp_secs};
use geometry::Pose;
use io::{
    BagWriteError, LiveCamera, LiveEye,
    ros2msg::{CameraInfo, Header, PoseStamped, Transform, TransformStamped},
};

/// Least backward step that counts as a time jump, nanoseconds.
const JUMP_NANOS: i64 = 500_000_000;

/// Settings of a collector.
#[derive(Clone, Debug)]
pub(crate) struct CollectorSettings {
    /// Capture settings of a reconstruction.
    pub capture: CaptureConfig,
    /// Names of the topics, for messages and the recording.
    pub topics: Topics,
    /// Frame of the twin, if given.
    pub world_frame: Option<String>,
    /// Frame described by PoseStamped messages, if given.
    pub pose_frame: Option<String>,
    /// Largest difference of matching stamps, nanoseconds.
    pub slop_nanos: i64,
    /// Largest gap between transforms for interpolation, nanoseconds.
    pub max_gap_nanos: i64,
    /// Most waiting images per kind, and most waiting sets.
    pub queue: usize,
    /// Rule for which views are kept.
    pub rule: KeyframeRule,
    /// Number of views held back before writing, while they can still be dropped.
    pub hold: usize,
    /// Whether the camera is tracked by its images.
    pub tracking: TrackCamera,
    /// Whether a topic or frame of poses was given.
    pub poses_asked: bool,
    /// Frame in which tracked poses are published.
    pub map_frame: String,
}

/// What the collector is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Phase {
    /// No state is being collected.
    Idle,
    /// This state is being collected.
    Collecting(usize),
}

/// A decoded view with its pose.
#[derive(Clone, Debug)]
pub(crate) struct Seen {
    /// Its frame.
    pub frame: RgbdFrame,
    /// Whether it was kept.
    pub kept: bool,
}

/// A kept view that is not written yet.
struct Held {
    view: View,
    /// Transforms around its stamp, saved in case they are dropped before it is written.
    around: Vec<TransformStamped>,
    /// Time of reception, nanoseconds.
    now_nanos: i64,
}

/// Collects the two states of an object.
pub(crate) struct Collector {
    settings: CollectorSettings,
    session: PathBuf,
    sync: Synchronizer<Picture>,
    waiting: VecDeque<Matched<Picture>>,
    /// Recent transforms.
    pub tf: LiveTf,
    infos: [Option<CameraInfo>; 2],
    eye: LiveEye,
    phase: Phase,
    bag: Option<StateBag>,
    held: VecDeque<Held>,
    keyframes: [Keyframes; 2],
    finished: [Option<PathBuf>; 2],
    /// Earlier recording and views of the state being collected, in case it is abandoned.
    before: (Option<PathBuf>, Keyframes),
    tracking: TrackedMap,
    newest_nanos: i64,
    /// Frame of the poses, once it is known.
    pub world_frame: Option<String>,
    /// Counts of messages and views.
    pub counts: Counts,
    /// The last problem.
    pub problem: Option<String>,
}

impl Collector {
    /// A collector that writes its bags into the folder of a session.
    #[must_use]
    pub(crate) fn new(settings: CollectorSettings, session: &Path) -> Self {
        let with_masks = settings.topics.mask.is_some();
        let mut tf = LiveTf::default();
        // From the start, so that poses on /tf before the topic's first one are ignored too.
        tf.overridden = settings.pose_frame.clone().filter(|_| settings.topics.pose.is_some());
        Self {
            sync: Synchronizer::new(settings.slop_nanos, settings.queue, with_masks),
            waiting: VecDeque::new(),
            tf,
            infos: [None, None],
            eye: LiveEye::new(settings.capture.clone()),
            phase: Phase::Idle,
            bag: None,
            held: VecDeque::new(),
            keyframes: Default::default(),
            finished: [0, 1].map(|s| finished_state(session, s)),
            before: Default::default(),
            tracking: TrackedMap::default(),
            newest_nanos: i64::MIN,
            world_frame: settings.world_frame.clone(),
            counts: Counts::default(),
            problem: None,
            session: session.to_owned(),
            settings,
        }
    }

    /// What the collector is doing.
    #[must_use]
    pub(crate) fn phase(&self) -> Phase {
        self.phase
    }

    /// Folder of the session.
    #[must_use]
    pub(crate) fn session(&self) -> &Path {
        &self.session
    }

    /// Number of kept views per state.
    #[must_use]
    pub(crate) fn kept_views(&self) -> [usize; 2] {
        [0, 1].map(|s| self.keyframes[s].len())
    }

    /// The finished recordings of the states.
    #[must_use]
    pub(crate) fn recordings(&self) -> [Option<PathBuf>; 2] {
        self.finished.clone()
    }

    /// Number of images waiting for a match, and of sets waiting for a pose.
    #[must_use]
    pub(crate) fn waiting_counts(&self) -> (usize, usize) {
        (self.sync.waiting(), self.waiting.len())
    }

    /// Number of matched sets, and of images dropped without a match.
    #[must_use]
    pub(crate) fn match_counts(&self) -> (u64, [u64; 3]) {
        (self.sync.matched, self.sync.unmatched)
    }

    /// Starts collecting a state; its earlier recording is renamed.
    ///
    /// # Errors
    /// If another state is being collected, or writing fails.
    pub(crate) fn start_state(&mut self, state: usize) -> Result<(), CollectError> {
        if state > 1 {
            return Err(CollectError::NoState(state));
        }
        if let Phase::Collecting(other) = self.phase {
            return Err(CollectError::Collecting(other));
        }
        let bag = StateBag::create(&self.session, state, self.settings.topics.clone())?;
        self.before = (self.finished[state].take(), std::mem::take(&mut self.keyframes[state]));
        // Waiting images are from before the state started.
        self.waiting.clear();
        self.held.clear();
        self.tracking.to_track.clear();
        self.tracking.kept = None;
        self.tracking.in_state = self.settings.tracking;
        self.bag = Some(bag);
        self.phase = Phase::Collecting(state);
        Ok(())
    }

    /// Finishes the state being collected; returns the number of kept views. Without views the state is
    /// abandoned.
    ///
    /// # Errors
    /// If the state is not being collected, nothing was kept, or writing fails.
    pub(crate) fn finish_state(&mut self, state: usize) -> Result<usize, CollectError> {
        if self.phase != Phase::Collecting(state) {
            return Err(match self.phase {
                Phase::Idle => CollectError::NotCollecting(state),
                Phase::Collecting(collecting) => CollectError::Other { collecting, asked: state },
            });
        }
        let kept = self.keyframes[state].len();
        // An empty recording must not replace an earlier one of this state.
        if kept == 0 {
            let why = self.why_nothing();
            self.abandon_state(state)?;
            return Err(CollectError::NoView { state, why });
        }
        self.write_held(0)?;
        let Some(bag) = self.bag.take() else { return Err(CollectError::NoRecording) };
        self.phase = Phase::Idle;
        self.finished[state] = Some(bag.finish()?);
        Ok(kept)
    }

    /// Abandons a state: restores its earlier recording.
    fn abandon_state(&mut self, state: usize) -> Result<(), BagWriteError> {
        self.phase = Phase::Idle;
        let (finished, keyframes) = std::mem::take(&mut self.before);
        if let Some(bag) = self.bag.take() {
            bag.abandon()?;
        }
        (self.finished[state], self.keyframes[state]) = (finished, keyframes);
        Ok(())
    }

    /// Drops the views held back, which may show the object in motion.
    pub(crate) fn drop_held(&mut self) {
        if let Phase::Collecting(state) = self.phase {
            self.keyframes[state].forget_last(self.held.len());
        }
        self.held.clear();
    }

    /// Writes the oldest held views until `left` remain.
    fn write_held(&mut self, left: usize) -> Result<(), BagWriteError> {
        while self.held.len() > left {
            let (Some(held), Some(bag)) = (self.held.pop_front(), &mut self.bag) else { break };
            let infos = self.infos.each_ref().map(Option::as_ref);
            bag.write_view(
                &held.view,
                infos,
                self.tf.static_transforms(),
                held.around,
                self.tf.overridden.as_deref(),
                held.now_nanos,
            )?;
        }
        Ok(())
    }

    /// Describes what is missing.
    fn why_nothing(&self) -> String {
        let t = &self.settings.topics;
        let (matched, unmatched) = self.match_counts();
        match () {
            () if unmatched == [0; 3] && matched == 0 => {
                format!("no images came on {} and {}", t.color, t.depth)
            }
            () if matched == 0 => format!(
                "images on {} and {} do not belong together: {unmatched:?} without partner",
                t.color, t.depth
            ),
            () if self.infos[0].is_none() => format!("no camera_info came on {}", t.color_info),
            () if self.tracking.is_on => "the camera was not tracked; see the hint on ~/status".to_owned(),
            () => self.problem.clone().unwrap_or_else(|| "no camera pose was found".into()),
        }
    }

    /// Discards the collected states and continues in another folder; recordings remain on the disk.
    ///
    /// # Errors
    /// If the open recording cannot be closed.
    pub(crate) fn reset_session(&mut self, session: &Path) -> Result<(), BagWriteError> {
        let kept_something =
            matches!(self.phase, Phase::Collecting(state) if self.keyframes[state].len() > 0);
        let bag = self.bag.take();
        let tf = std::mem::take(&mut self.tf);
        // Camera infos and transforms are kept: some are published only once.
        let infos = self.infos.clone();
        let counts = std::mem::take(&mut self.counts);
        let tracking = TrackedMap { map: self.tracking.map + 1, ..TrackedMap::default() };
        let counts = counts.after_reset();
        *self = Self { tf, infos, counts, tracking, ..Self::new(self.settings.clone(), session) };
        match bag {
            Some(bag) if kept_something => bag.finish().map(|_| ()),
            Some(bag) => bag.abandon(),
            None => Ok(()),
        }
    }

    /// Flushes the recording to the disk.
    ///
    /// # Errors
    /// If writing fails.
    pub(crate) fn flush(&mut self) -> Result<(), BagWriteError> {
        self.bag.as_mut().map_or(Ok(()), StateBag::flush)
    }

    /// Handles a message received at `now_nanos`; returns the completed views that were decoded: with
    /// `pixels` all, else only kept ones.
    ///
    /// # Errors
    /// If writing fails; the state is then no longer collected.
    pub(crate) fn accept_sample(
        &mut self,
        sample: Sample,
        now_nanos: i64,
        pixels: bool,
    ) -> Result<Vec<Seen>, BagWriteError> {
        if let Err(refusal) = sample.check() {
            self.counts.count_refusal(refusal);
            // One invalid transform does not invalidate the others in a message.
            if !matches!(sample, Sample::Transforms(_) | Sample::StaticTransforms(_)) {
                return Ok(Vec::new());
            }
        }
        match sample {
            Sample::Color(picture) => self.take_image(0, picture),
            Sample::Depth(picture) => self.take_image(1, picture),
            Sample::Mask(picture) => self.take_image(2, picture),
            Sample::ColorInfo(info) => self.infos[0] = Some(*info),
            Sample::DepthInfo(info) => self.infos[1] = Some(*info),
            Sample::Transforms(m) => self.tf.add_message(&m),
            Sample::StaticTransforms(m) => self.tf.add_static(&m),
            Sample::Pose(m) => self.take_pose(m),
            Sample::Odometry(m) => {
                let child = Some(m.child_frame_id.clone()).filter(|c| !c.is_empty());
                self.sample_of_pose(m.header, child, m.pose);
            }
        }
        let seen = self.place_waiting(now_nanos, pixels);
        self.unless_failed(seen)
    }

    /// Passes on the result of a write; an error ends the state.
    fn unless_failed<T>(&mut self, written: Result<T, BagWriteError>) -> Result<T, BagWriteError> {
        if let Err(error) = &written {
            self.problem = Some(error.to_string());
            self.phase = Phase::Idle;
            // Closing the bag would make it look complete; without metadata.yaml it does not.
            self.bag = None;
        }
        written
    }

    fn take_image(&mut self, role: usize, picture: Picture) {
        let Some((stamp, _)) = picture.header().checked() else { return };
        // Color decides; depth and masks jump with it.
        if role == 0 {
            if stamp < self.newest_nanos.saturating_sub(JUMP_NANOS) {
                let back = stamp_secs(self.newest_nanos - stamp);
                self.problem = Some(format!(
                    "the stamps of the images went back by {back:.3} s; what waited was dropped"
                ));
                self.jump_back(stamp);
            }
            self.newest_nanos = self.newest_nanos.max(stamp);
        }
        for set in self.sync.push(role, stamp, picture) {
            if self.waiting.len() == self.settings.queue {
                // Drops the oldest set, whose transform is least likely to arrive.
                self.waiting.pop_front();
                self.counts.without_pose += 1;
            }
            self.waiting.push_back(set);
        }
    }

    /// Handles a backward time jump: drops later images and moving transforms.
    pub(crate) fn jump_back(&mut self, now_nanos: i64) {
        let latest = now_nanos.saturating_add(self.settings.slop_nanos);
        self.counts.jumps += 1;
        self.sync.forget_after(latest);
        let before = self.waiting.len();
        self.waiting.retain(|set| set.stamp_nanos <= latest);
        self.counts.without_pose += (before - self.waiting.len()) as u64;
        self.tf.forget_after(latest);
        self.begin_map();
        self.newest_nanos = self.newest_nanos.min(latest);
    }

    fn take_pose(&mut self, m: PoseStamped) {
        self.sample_of_pose(m.header, self.settings.pose_frame.clone(), m.pose);
    }

    /// Stores a pose as a transform; its child frame may be known only after an image.
    fn sample_of_pose(&mut self, header: Header, child: Option<String>, transform: Transform) {
        let Some(child) = child.or_else(|| self.optical_frame()) else { return };
        // /tf may contain another estimate of this frame, which must not be mixed in.
        self.tf.overridden = Some(child.clone());
        self.tf.add_one(&TransformStamped { header, child_frame_id: child, transform });
    }

    /// Frame of the color images.
    fn optical_frame(&self) -> Option<String> {
        let info = self.infos[0].as_ref().and_then(|i| i.header.checked());
        info.map(|(_, frame)| frame).filter(|f| !f.is_empty())
    }

    /// What came so far about the camera of a set of images.
    fn camera_of_images(&self, images: &[Option<Picture>; 3]) -> LiveCamera {
        let frames = [0, 1].map(|role| {
            let header = images[role].as_ref().and_then(|picture| picture.header().checked());
            header.map_or_else(String::new, |(_, frame)| frame)
        });
        let color_from_depth = match frames[0] == frames[1] {
            true => Some(Pose::identity()),
            // Stamp 0 and no gap: only a static transform can answer.
            false => self.tf.lookup(&frames[0], &frames[1], 0, 0).ok(),
        };
        LiveCamera { infos: self.infos.clone(), frames, color_from_depth }
    }

    /// Assigns poses to waiting sets in order, and keeps new views.
    fn place_waiting(&mut self, now_nanos: i64, pixels: bool) -> Result<Vec<Seen>, BagWriteError> {
        let mut seen = Vec::new();
        let mut still = VecDeque::new();
        while let Some(set) = self.waiting.pop_front() {
            let optical = set.images[0]
                .as_ref()
                .and_then(|p| p.header().checked())
                .map(|(_, frame)| frame)
                .unwrap_or_default();
            if self.is_to_track(&set, &optical) {
                self.hand_over(set);
                continue;
            }
            // The root above a moving camera; it may become known while images wait.
            let world = self.settings.world_frame.clone().or_else(|| self.tf.moving_root(&optical));
            let pose = world
                .as_ref()
                .map(|w| self.tf.lookup(w, &optical, set.stamp_nanos, self.settings.max_gap_nanos));
            match pose {
                Some(Ok(world_from_camera)) if self.infos[0].is_some() => {
                    self.world_frame = world;
                    let view = View { stamp_nanos: set.stamp_nanos, images: set.images, world_from_camera };
                    seen.extend(self.keep_if_new(view, now_nanos, pixels, None)?);
                }
                // The transform after the stamp may still arrive; the queue bounds the wait.
                other => {
                    if let Some(Err(error)) = other {
                        self.problem = Some(error.to_string());
                    } else if world.is_none() {
                        self.problem = Some(format!(
                            "frame `{optical}` has no moving parent on /tf; name a pose_topic or a \
                             world_frame"
                        ));
                    }
                    still.push_back(set);
                }
            }
        }
        self.waiting = still;
        Ok(seen)
    }
}

/// The recording of a state that an earlier run of the node completed in this session.
fn finished_state(session: &Path, state: usize) -> Option<PathBuf> {
    let folder = session.join(format!("state{state}"));
    folder.join("metadata.yaml").is_file().then_some(folder)
}

#[cfg(test)]
#[path = "collector_tests.rs"]
mod tests;
