//! The camera followed while views come in, on a thread of its own: a view goes in, and comes out with its
//! pose or the reason against one. Nothing waits for it: views without room are dropped.

use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use tokio::sync::mpsc;

use super::{
    sample::Picture,
    state_bag::Topics,
    view::{Pixels, View},
};
use capture::{CaptureConfig, LiveTracker, LiveView, Lost, NoiseConfig, Observation, noise_of};
use common::ahead::Ahead;
use common::stop::Stop;
use geometry::Pose;
use io::{LiveEye, ros2msg::CameraInfo};

/// Views waiting to be tracked.
/// derived: one in work and one behind it: older ones say less of where the camera is now
const WAITING: usize = 2;

/// A view to be tracked.
pub(crate) struct ToTrack {
    /// Number of its map; a higher one begins another.
    pub map: u64,
    /// Stamp of the color image, nanoseconds.
    pub stamp_nanos: i64,
    /// Color, depth, mask.
    pub images: [Option<Picture>; 3],
    /// Of color and depth.
    pub infos: [Option<CameraInfo>; 2],
}

/// A view after tracking.
pub(crate) struct Tracked {
    /// Number of the map.
    pub map: u64,
    /// Its images, with the pose where it has one.
    pub view: View,
    /// Its pixels and its place, or the reason against one.
    pub outcome: Outcome,
    /// Keyframes of the map, and whether it takes no more.
    pub keyframes: (usize, bool),
}

/// The outcome of a view.
pub(crate) enum Outcome {
    /// It was placed.
    Placed(Box<(Pixels, LiveView)>),
    /// It has no place.
    Lost(Lost),
    /// It cannot be used.
    Broken(String),
}

/// Where views go; without any, the thread ends.
#[derive(Clone)]
pub(crate) struct TrackQueue(SyncSender<ToTrack>);

impl TrackQueue {
    /// Hands a view over; it comes back where it found no room.
    #[must_use]
    pub(crate) fn offer_view(&self, view: ToTrack) -> Option<ToTrack> {
        match self.0.try_send(view) {
            Err(TrySendError::Full(view)) => Some(view),
            _ => None,
        }
    }
}

/// Settings of the tracking.
#[derive(Clone)]
pub(crate) struct TrackSettings {
    /// Settings of a run.
    pub config: CaptureConfig,
    /// Names of the topics, for messages.
    pub topics: Topics,
    /// Seed of the draws.
    pub seed: u64,
    /// Keyframes of a map at most.
    pub most: usize,
}

/// Starts the thread; where views go, and where they come out.
///
/// # Errors
/// If the system has no thread.
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

/// Follows the camera from view to view.
pub(crate) struct Follower<'a> {
    settings: &'a TrackSettings,
    eye: LiveEye,
    /// That of the first view, as of a recording's first ones: a model that changed would move the gates.
    noise: Option<NoiseConfig>,
    map: Option<(u64, LiveTracker)>,
}

impl<'a> Follower<'a> {
    /// Before the first view.
    #[must_use]
    pub(crate) fn new(settings: &'a TrackSettings) -> Self {
        Self { settings, eye: LiveEye::new(settings.config.clone()), noise: None, map: None }
    }

    /// Looks at the next view.
    pub(crate) fn follow_view(&mut self, view: ToTrack) -> Tracked {
        let ToTrack { map, stamp_nanos, images, infos } = view;
        let mut view = View { stamp_nanos, images, world_from_camera: Pose::identity() };
        let outcome = self.place_view(map, &mut view, &infos).unwrap_or_else(Outcome::Broken);
        let keyframes = self.map.as_ref().map_or((0, false), |(_, t)| (t.keyframes(), t.is_full()));
        Tracked { map, view, outcome, keyframes }
    }

    fn place_view(
        &mut self,
        map: u64,
        view: &mut View,
        infos: &[Option<CameraInfo>; 2],
    ) -> Result<Outcome, String> {
        let t = &self.settings.topics;
        let info = infos[0].as_ref().ok_or_else(|| format!("no camera_info came on {}", t.color_info))?;
        let names = [t.color.as_str(), t.depth.as_str(), t.mask.as_deref().unwrap_or_default()];
        let pixels = view.decoded_pixels(info, &t.color_info, names).map_err(|why| why.to_string())?;
        let frame = self
            .eye
            .see(
                view.stamp_nanos,
                infos.each_ref().map(Option::as_ref),
                [&t.color_info, &t.color],
                (&pixels.color, &pixels.depth),
            )
            .map_err(|why| why.to_string())?;
        let noise = match self.noise {
            Some(noise) => noise,
            None => noise_of(std::iter::once(&frame), &self.settings.config, &Stop::never())
                .map_err(|why| why.to_string())?,
        };
        self.noise = Some(noise);
        let observation = Observation::of_frame(frame, &noise, &Ahead::default());
        if self.map.as_ref().is_none_or(|(number, _)| *number != map) {
            self.map = Some((map, LiveTracker::new(self.settings.seed, self.settings.most)));
        }
        let Some((_, tracker)) = &mut self.map else { return Err("no map".into()) };
        Ok(match tracker.see(observation) {
            Ok(found) => {
                view.world_from_camera = found.world_from_camera;
                Outcome::Placed(Box::new((pixels, found)))
            }
            Err(why) => Outcome::Lost(why),
        })
    }
}
