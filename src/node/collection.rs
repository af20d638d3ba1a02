//! The thread that owns the collector: it receives messages and commands, and returns answers and events. It
//! is separate because decoding and writing take time.

use std::{
    path::{Path, PathBuf},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use tokio::sync::{mpsc, oneshot};

use super::{
    clock::NodeClock,
    collect_error::CollectError,
    collector::{Collector, Phase, Seen},
    counts::Counts,
    live_map::{KeptView, LiveQueue, LiveStatus, MapKey},
    live_tracking::{Outcome, ToTrack, TrackQueue, Tracked},
    motion_watch::{MotionWatch, Turn},
    preview_cloud::PreviewCloud,
    sample::Sample,
    session_lock::SessionLock,
    track_status::{TrackStatus, TrackWatch},
};
use capture::{RgbdFrame, TrackCamera};
use io::ros2msg::TransformStamped;

/// Queue length for images.
pub(crate) const IMAGE_QUEUE: usize = 16;
/// Queue length for small messages.
pub(crate) const SMALL_QUEUE: usize = 2048;
/// Time between flushes of the recording; a crash loses at most this much.
const FLUSH_EVERY: Duration = Duration::from_secs(1);

/// Requests to the collection thread.
pub(crate) enum Command {
    /// Starts collecting a state.
    Start(usize, oneshot::Sender<Result<(), CollectError>>),
    /// Finishes a state; returns the number of kept views.
    Finish(usize, oneshot::Sender<Result<usize, CollectError>>),
    /// Discards the collected states and continues in another folder.
    Reset(PathBuf, oneshot::Sender<Result<(), CollectError>>),
    /// Flushes the recording to the disk.
    Flush(oneshot::Sender<Result<(), CollectError>>),
    /// Time jumped back.
    TimeJump,
    /// Parameters were set that the collection follows.
    Follow(Followed),
    /// Stops the thread and closes open recordings.
    Stop(oneshot::Sender<()>),
}

/// Parameters that the collection follows while it runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Followed {
    /// Whether the camera is tracked by its images.
    pub tracking: TrackCamera,
    /// Whether kept views go into the live map.
    pub live_map: bool,
}

/// State of the collection, readable by other threads at any time.
#[derive(Clone, Debug, Default)]
pub(crate) struct Snapshot {
    /// The state being collected, if any.
    pub collecting: Option<usize>,
    /// The state being collected, or the last one.
    pub state: usize,
    /// Whether the object is being moved between automatic states.
    pub moving: bool,
    /// Number of kept views per state.
    pub kept: [usize; 2],
    /// Finished recordings of the states.
    pub recordings: [Option<PathBuf>; 2],
    /// Number of matched image sets.
    pub matched: u64,
    /// Number of color, depth and mask images dropped without a match.
    pub unmatched: [u64; 3],
    /// Number of images waiting for a match, and of sets waiting for a pose.
    pub waiting: (usize, usize),
    /// Counts of messages and views.
    pub counts: Counts,
    /// Number of invalid transforms, and of backward time jumps of /tf.
    pub transforms: (u64, u64),
    /// Folder of the session.
    pub session: PathBuf,
    /// Frame of the poses.
    pub world_frame: Option<String>,
    /// Frame of the twin, if it differs from that of the poses.
    pub twin_frame: Option<&'static str>,
    /// Quality of camera tracking, if the camera is tracked.
    pub tracking: Option<TrackStatus>,
    /// The last problem, for diagnostics.
    pub problem: Option<String>,
    /// Version of the preview cloud.
    pub cloud_version: u64,
    /// Status of the live map, if there is one.
    pub live: Option<LiveStatus>,
}

impl Snapshot {
    /// The recordings of both states.
    ///
    /// # Errors
    /// [`CollectError`] if a state has too few views.
    pub(crate) fn both_recordings(&self) -> Result<[PathBuf; 2], CollectError> {
        if let Some(state) = self.collecting {
            return Err(CollectError::Collecting(state));
        }
        match &self.recordings {
            [Some(state0), Some(state1)] => Ok([state0.clone(), state1.clone()]),
            [None, None] => Err(CollectError::NoStates),
            [state0, _] => Err(CollectError::Missing(u8::from(state0.is_some()))),
        }
    }
}

/// Data shared by the collection and other threads.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    snapshot: Mutex<Snapshot>,
    /// Whether a reconstruction reads the session. Locked while a state starts, so that none can begin
    /// reading then.
    read: Mutex<bool>,
    cloud: Mutex<Vec<([f32; 3], [u8; 3])>>,
}

impl Shared {
    /// The current snapshot.
    #[must_use]
    pub(crate) fn snapshot(&self) -> Snapshot {
        guard(&self.snapshot).clone()
    }

    /// Marks the session as being read until the guard is dropped; until then no state can be started and no
    /// session left.
    pub(crate) fn read_session(self: &Arc<Self>) -> ReadSession {
        *guard(&self.read) = true;
        ReadSession(Arc::clone(self))
    }

    /// Whether a reconstruction reads the session.
    #[must_use]
    pub(crate) fn is_read(&self) -> bool {
        *guard(&self.read)
    }

    /// The current preview cloud.
    #[must_use]
    pub(crate) fn cloud(&self) -> Vec<([f32; 3], [u8; 3])> {
        guard(&self.cloud).clone()
    }
}

/// Guard: a reconstruction reads the session.
#[derive(Debug)]
pub(crate) struct ReadSession(Arc<Shared>);

impl Drop for ReadSession {
    fn drop(&mut self) {
        *guard(&self.0.read) = false;
    }
}

fn guard<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panic in another thread leaves valid values, as they are always replaced as a whole.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The collection with its queues.
pub(crate) struct Core {
    collector: Collector,
    lock: SessionLock,
    watch: Option<MotionWatch>,
    cloud: PreviewCloud,
    cloud_points: usize,
    cloud_version: u64,
    clock: Arc<NodeClock>,
    shared: Arc<Shared>,
    last_state: usize,
    flushed: Instant,
    tracking: Tracking,
    track_watch: TrackWatch,
    live: LiveQueue,
    maps_live: bool,
    live_key: MapKey,
}

/// Channels to and from the tracking thread.
pub(crate) struct Tracking {
    /// Views to be tracked.
    pub queue: TrackQueue,
    /// Tracked views.
    pub tracked: mpsc::Receiver<Tracked>,
    /// Poses to be published.
    pub poses: mpsc::Sender<TransformStamped>,
}

/// Channels for messages and commands.
pub(crate) struct Inbox {
    /// Image messages.
    pub images: mpsc::Receiver<Sample>,
    /// All other messages.
    pub small: mpsc::Receiver<Sample>,
    /// Commands.
    pub commands: mpsc::Receiver<Command>,
}

impl Core {
    /// A collection with a collector and a locked session; with a `watch`, states start and finish
    /// automatically.
    #[must_use]
    pub(crate) fn new(
        (collector, lock): (Collector, SessionLock),
        watch: Option<MotionWatch>,
        cloud_points: usize,
        clock: Arc<NodeClock>,
        shared: Arc<Shared>,
        tracking: Tracking,
        (live, maps_live): (LiveQueue, bool),
    ) -> Self {
        let cloud = PreviewCloud::new(cloud_points);
        Self {
            collector,
            lock,
            watch,
            cloud,
            cloud_points,
            cloud_version: 0,
            clock,
            shared,
            last_state: 0,
            flushed: Instant::now(),
            tracking,
            track_watch: TrackWatch::default(),
            live,
            maps_live,
            live_key: MapKey::default(),
        }
    }

    /// Runs until it is stopped or all senders are gone.
    pub(crate) async fn run(mut self, mut inbox: Inbox) {
        self.publish_snapshot();
        // Flush and update the snapshot even when nothing is received.
        let mut tick = tokio::time::interval(Duration::from_millis(200));
        loop {
            tokio::select! {
                // Biased order: images do not delay commands, and transforms come before the images that need
                // them.
                biased;
                command = inbox.commands.recv() => match command {
                    Some(Command::Stop(done)) => {
                        self.close_recording();
                        done.send(()).ok();
                        return;
                    }
                    Some(command) => self.obey_command(command),
                    None => return self.close_recording(),
                },
                Some(sample) = inbox.small.recv() => self.accept_sample(sample),
                Some(tracked) = self.tracking.tracked.recv() => self.take_tracked(tracked),
                Some(sample) = inbox.images.recv() => self.accept_sample(sample),
                _ = tick.tick() => {}
            }
            if self.flushed.elapsed() >= FLUSH_EVERY {
                self.flushed = Instant::now();
                if let Err(error) = self.collector.flush() {
                    log::error!("{error}");
                }
            }
            self.publish_snapshot();
        }
    }

    fn obey_command(&mut self, command: Command) {
        match command {
            Command::Start(state, answer) => {
                let started = self.unless_read(|core| {
                    core.start_state(state)?;
                    // A state started by a person is a new map. A state started automatically continues the
                    // map of the resting object.
                    core.begin_map();
                    Ok(())
                });
                answer.send(started).ok();
            }
            Command::Finish(state, answer) => {
                let finished = self.collector.finish_state(state);
                answer.send(finished).ok();
            }
            Command::Reset(session, answer) => {
                let reset = self.unless_read(|core| core.reset_session(&session));
                answer.send(reset).ok();
            }
            Command::Flush(answer) => _ = answer.send(self.collector.flush().map_err(CollectError::from)),
            Command::TimeJump => {
                log::warn!("time went back: what waited was dropped");
                self.collector.jump_back(self.clock.now_nanos());
                self.track_watch.begin_map();
                self.watch = self.watch.take().map(MotionWatch::renewed);
            }
            Command::Follow(followed) => {
                self.collector.set_tracking(followed.tracking);
                self.maps_live = followed.live_map;
            }
            Command::Stop(_) => {}
        }
    }

    /// Changes the session unless a reconstruction reads it.
    fn unless_read(
        &mut self,
        change: impl FnOnce(&mut Self) -> Result<(), CollectError>,
    ) -> Result<(), CollectError> {
        let shared = Arc::clone(&self.shared);
        // Locked during the change, so that no reconstruction starts reading.
        let read = guard(&shared.read);
        if *read {
            return Err(CollectError::Read);
        }
        let changed = change(self);
        self.publish_snapshot();
        changed
    }

    fn reset_session(&mut self, session: &Path) -> Result<(), CollectError> {
        // Lock the new folder before leaving the old one, so that a failure changes nothing.
        let lock = SessionLock::take(session)?;
        self.watch = self.watch.take().map(MotionWatch::renewed);
        self.cloud = PreviewCloud::new(self.cloud_points);
        self.track_watch.begin_map();
        let reset = self.collector.reset_session(session);
        self.lock = lock;
        self.live_key.session += 1;
        self.begin_live(0);
        Ok(reset?)
    }

    fn start_state(&mut self, state: usize) -> Result<(), CollectError> {
        self.collector.start_state(state)?;
        self.last_state = state;
        self.cloud = PreviewCloud::new(self.cloud_points);
        self.begin_live(state);
        Ok(())
    }

    /// The map so far belongs to an earlier state or session.
    fn begin_live(&mut self, state: usize) {
        self.live_key = MapKey { begun: self.live.begin_map(), state, ..self.live_key };
    }

    /// Sends a kept view to the live map, unless a reconstruction needs the CPU.
    fn map_live(&self, frame: &RgbdFrame) {
        if self.maps_live && !self.shared.is_read() {
            self.live.offer_view(KeptView {
                key: MapKey { tracked: self.collector.tracked_map(), ..self.live_key },
                kept: Instant::now(),
                world_frame: self.collector.world_frame.clone().unwrap_or_default(),
                frame: frame.clone(),
            });
        }
    }

    fn accept_sample(&mut self, sample: Sample) {
        let now = self.clock.now_nanos();
        match self.collector.accept_sample(sample, now, self.watch.is_some()) {
            Ok(seen) => seen.iter().for_each(|s| self.see_view(s)),
            Err(error) => log::error!("{error}; the state is not collected any further"),
        }
        let views = self.collector.take_to_track();
        // A reconstruction needs the CPU.
        if !self.shared.is_read() {
            for view in views {
                // Never blocks: if the tracker is busy, views are dropped and counted.
                let dropped = self.tracking.queue.offer_view(view);
                self.track_watch.count_offered(dropped.is_none(), Instant::now());
                if let Some(ToTrack { stamp_nanos, images, .. }) = dropped
                    && let Err(error) = self.collector.keep_unplaced(stamp_nanos, images, now)
                {
                    log::error!("{error}; the state is not collected any further");
                }
            }
        }
    }

    /// Handles a tracked view.
    fn take_tracked(&mut self, tracked: Tracked) {
        if tracked.map != self.collector.map_number() {
            return;
        }
        let was_lost = self.track_watch.is_lost();
        self.track_watch.count_tracked(&tracked, Instant::now());
        if let (Outcome::Lost(why), false) = (&tracked.outcome, was_lost) {
            log::warn!("the camera is lost: {}", why.reason());
        }
        match self.collector.accept_tracked(tracked, self.clock.now_nanos()) {
            Ok(Some((seen, transform))) => {
                // If the publisher is behind, drop the transform; the next one is newer.
                transform.into_iter().for_each(|t| _ = self.tracking.poses.try_send(t));
                self.see_view(&seen);
            }
            Ok(None) => {}
            Err(error) => log::error!("{error}; the state is not collected any further"),
        }
    }

    fn begin_map(&mut self) {
        self.collector.begin_map();
        self.track_watch.begin_map();
    }

    fn see_view(&mut self, seen: &Seen) {
        let frame = &seen.frame;
        if seen.kept {
            self.map_live(frame);
            self.cloud.add_view(frame);
            self.cloud_version += 1;
            // A copy, so that the publisher never waits for this thread.
            *guard(&self.shared.cloud) = self.cloud.colored_points();
        }
        // While a reconstruction reads the session no state can start, so motion is not watched.
        let Some(watch) = self.watch.as_mut().filter(|_| !self.shared.is_read()) else { return };
        let turn = watch.see_view(frame, self.collector.kept_views());
        match turn {
            Turn::None => {}
            Turn::Start(state) => match self.unless_read(|core| core.start_state(state)) {
                Ok(()) => log::info!("state {state} begins: the object is still"),
                Err(error) => log::error!("state {state} cannot begin: {error}"),
            },
            Turn::Finish(state) => self.end_state(state),
            Turn::Moved(state) => {
                // Motion is confirmed some views late; the held views may show it.
                self.collector.drop_held();
                self.end_state(state);
                // The moved surface contradicts its earlier views.
                self.begin_map();
                self.watch = self.watch.take().map(MotionWatch::in_another_map);
            }
        }
    }

    fn end_state(&mut self, state: usize) {
        match self.collector.finish_state(state) {
            Ok(kept) => log::info!("state {state} ends with {kept} views"),
            Err(error) => log::error!("state {state} cannot end: {error}"),
        }
    }

    /// Closes an open recording, so that nothing is lost.
    fn close_recording(&mut self) {
        // A bag without metadata.yaml can be read, but with a warning.
        if let Phase::Collecting(state) = self.collector.phase()
            && let Err(error) = self.collector.finish_state(state)
        {
            log::warn!("state {state} was not finished: {error}");
        }
    }

    fn publish_snapshot(&mut self) {
        let tracking = self.track_watch.status(Instant::now());
        let c = &self.collector;
        let (matched, unmatched) = c.match_counts();
        let collecting = match c.phase() {
            Phase::Collecting(state) => Some(state),
            Phase::Idle => None,
        };
        *guard(&self.shared.snapshot) = Snapshot {
            collecting,
            state: self.last_state,
            moving: self.watch.as_ref().is_some_and(MotionWatch::is_moving),
            kept: c.kept_views(),
            recordings: c.recordings(),
            matched,
            unmatched,
            waiting: c.waiting_counts(),
            counts: c.counts,
            transforms: (c.tf.refused, c.tf.jumps),
            session: c.session().to_owned(),
            world_frame: c.world_frame.clone(),
            twin_frame: c.twin_frame(),
            tracking,
            problem: c.problem.clone(),
            cloud_version: self.cloud_version,
            live: self.maps_live.then(|| self.live.status()),
        };
    }
}
