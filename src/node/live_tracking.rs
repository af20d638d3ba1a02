//! Live camera tracking in its own thread: each view is returned with its pose, or the reason for having
//! none. Nothing waits for it: views that find the queue full are dropped.

use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use tokio::sync::mpsc;

use super::{sample::Picture, state_bag::Topics, view::View};
use capture::{CaptureConfig, LiveTracker, LiveView, Lost, NoiseConfig, Observation, RgbdFrame, noise_of};
use common::ahead::Ahead;
use common::stop::Stop;
use geometry::Pose;
use io::{LiveCamera, LiveEye};

/// Queue length for views.
/// derived: one in work and one waiting; older ones say less about the current pose
const WAITING: usize = 2;

/// A view to be tracked.
pub(crate) struct ToTrack {
    /// Number of its map; a higher number starts another map.
    pub map: u64,
    /// Stamp of the color image, nanoseconds.
    pub stamp_nanos: i64,
    /// Color, depth and mask.
    pub images: [Option<Picture>; 3],
    /// What came about its camera.
    pub seen_by: LiveCamera,
}

/// A view after tracking.
pub(crate) struct Tracked {
    /// Number of the map.
    pub map: u64,
    /// Its images, with the pose if it has one.
    pub view: View,
    /// Its frame and place, or the reason for having none.
    pub outcome: Outcome,
    /// Number of keyframes in the map, and whether it is full.
    pub keyframes: (usize, bool),
}

/// Result of tracking a view.
pub(crate) enum Outcome {
    /// It was located.
    Placed(Box<(RgbdFrame, LiveView)>),
    /// It could not be located.
    Lost(Lost),
    /// Its images cannot be used.
    Broken(String),
}

/// Input queue of the tracker; the thread ends when it is dropped.
#[derive(Clone)]
pub(crate) struct TrackQueue(SyncSender<ToTrack>);

impl TrackQueue {
    /// Sends a view; returns it if the queue is full.
    #[must_use]
    pub(crate) fn offer_view(&self, view: ToTrack) -> Option<ToTrack> {
        match self.0.try_send(view) {
            Err(TrySendError::Full(view)) => Some(view),
            _ => None,
        }
    }
}

/// Settings of live tracking.
#[derive(Clone)]
pub(crate) struct TrackSettings {
    /// Capture settings of a reconstruction.
    pub config: CaptureConfig,
    /// Topic names for messages.
    pub topics: Topics,
    /// Random seed.
    pub seed: u64,
    /// Most keyframes of a map.
    pub most: usize,
}

/// Starts the thread; returns its input queue and its output.
///
/// # Errors
/// If no thread can be created.
pub(crate) fn start_thread(
    settings: TrackSettings,
) -> std::io::Result<(TrackQueue, mpsc::Receiver<Tracked>)> {
    let (queue, views) = sync_channel(WAITING);
    let (done, results) = mpsc::channel(WAITING);
    std::thread::Builder::new()
        .name("tracking".into())
        .spawn(move || track_views(&settings, &views, &done))?;
    Ok((TrackQueue(queue), results))
}

fn track_views(settings: &TrackSettings, views: &Receiver<ToTrack>, done: &mpsc::Sender<Tracked>) {
    let mut follower = Follower::new(settings);
    while let Ok(view) = views.recv() {
        if done.blocking_send(follower.follow_view(view)).is_err() {
            return;
        }
    }
}

/// Tracks the camera from view to view.
pub(crate) struct Follower<'a> {
    settings: &'a TrackSettings,
    eye: LiveEye,
    /// Noise from the first view, as in the pipeline from the first ones; a changing model would change the
    /// gates.
    noise: Option<NoiseConfig>,
    map: Option<(u64, LiveTracker)>,
}

impl<'a> Follower<'a> {
    /// A follower without views.
    #[must_use]
    pub(crate) fn new(settings: &'a TrackSettings) -> Self {
        Self { settings, eye: LiveEye::new(settings.config.clone()), noise: None, map: None }
    }

    /// Tracks the next view.
    pub(crate) fn follow_view(&mut self, view: ToTrack) -> Tracked {
        let ToTrack { map, stamp_nanos, images, seen_by } = view;
        let mut view = View { stamp_nanos, images, world_from_camera: Pose::identity() };
        let outcome = self.place_view(map, &mut view, &seen_by).unwrap_or_else(Outcome::Broken);
        let keyframes = self.map.as_ref().map_or((0, false), |(_, t)| (t.keyframes(), t.is_full()));
        Tracked { map, view, outcome, keyframes }
    }

    fn place_view(&mut self, map: u64, view: &mut View, seen_by: &LiveCamera) -> Result<Outcome, String> {
        let mut frame =
            view.frame(&mut self.eye, seen_by, &self.settings.topics).map_err(|why| why.to_string())?;
        // What stands about the object helps to place the camera.
        let unmasked = RgbdFrame { mask: None, ..frame.clone() };
        let noise = match self.noise {
            Some(noise) => noise,
            None => noise_of(std::iter::once(&unmasked), &self.settings.config, &Stop::never())
                .map_err(|why| why.to_string())?,
        };
        self.noise = Some(noise);
        let observation = Observation::of_frame(unmasked, &noise, &Ahead::default());
        if self.map.as_ref().is_none_or(|(number, _)| *number != map) {
            self.map = Some((map, LiveTracker::new(self.settings.seed, self.settings.most)));
        }
        let Some((_, tracker)) = &mut self.map else { return Err("no map".into()) };
        Ok(match tracker.see(observation) {
            Ok(found) => {
                view.world_from_camera = found.world_from_camera;
                frame.world_from_camera = found.world_from_camera;
                Outcome::Placed(Box::new((frame, found)))
            }
            Err(why) => Outcome::Lost(why),
        })
    }
}
