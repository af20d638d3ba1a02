//! Live tracking: the steps of [`Tracker`] with an immediate pose for every view and a bounded map. No loops
//! are closed, and later views change no earlier pose; a lost view leaves no trace.

use super::{
    gravity::Placed, keyframes::view_distance_rad, lost::Lost, observation::Observation, tracker::Tracker,
};
use geometry::Pose;

/// View change from frame to frame above which the camera counts as too fast, radians.
/// chosen: half of the 0.5 rad over which features match (`closure`)
const FAST_RAD: f64 = 0.25;

/// Tracks a camera while its views arrive.
pub struct LiveTracker {
    seed: u64,
    /// Most keyframes.
    most: usize,
    tracker: Tracker,
    /// Number of views so far.
    views: usize,
    world_from_map: Pose,
    /// Per keyframe, standard deviation of its position in the world, meters.
    errors_m: Vec<f64>,
}

/// The pose of a view and its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LiveView {
    /// Pose of the optical frame in the world: z up, x along the first view, origin on the support below its
    /// focus.
    pub world_from_camera: Pose,
    /// Agreeing share of the surface shared with the keyframes; 1 for the first view.
    pub inliers: f64,
    /// Standard deviation of the position relative to the first view, meters, in the least determined
    /// direction.
    pub error_m: f64,
    /// Whether the camera moves almost too fast to track.
    pub is_fast: bool,
}

impl LiveTracker {
    /// A tracker without views. It keeps at most `most` keyframes of about a megabyte each and draws random
    /// numbers from the seed.
    #[must_use]
    pub fn new(seed: u64, most: usize) -> Self {
        Self {
            seed,
            most: most.max(1),
            tracker: Tracker::new(seed),
            views: 0,
            world_from_map: Pose::identity(),
            errors_m: Vec::new(),
        }
    }

    /// Number of keyframes.
    #[must_use]
    pub fn keyframes(&self) -> usize {
        self.tracker.keyframes.all.len()
    }

    /// Whether the map is full: new surface can then only be tracked from near the existing keyframes.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.keyframes() >= self.most
    }

    /// Locates the next view.
    ///
    /// # Errors
    /// [`Lost`] if the view cannot be located; the tracker is then unchanged.
    pub fn see(&mut self, observation: Observation) -> Result<LiveView, Lost> {
        let view = self.views;
        self.views += 1;
        if let Some(why) = observation.reason_unplaceable() {
            return Err(why);
        }
        if self.keyframes() == 0 {
            return Ok(self.begin(view, observation));
        }
        let found = match self.tracker.place_of_frame(view, &observation) {
            Ok(found) => found,
            Err(why) => {
                // A map of one view loses nothing: this view may be the better one to start with.
                if self.keyframes() == 1 {
                    self.begin(view, observation);
                }
                return Err(why);
            }
        };
        let located = &found.located;
        // Along the path of least error over keyframes, so that a return to an old place restores its
        // accuracy.
        let mut before = f64::INFINITY;
        for k in &found.known {
            if found.known.iter().zip(&located.overlaps).any(|(n, o)| n == k && o.agreeing > 0) {
                before = before.min(self.errors_m[*k]);
            }
        }
        let error_m = before.hypot(located.least_known_m);
        let pose = located.pose;
        let inliers = located.agreement;
        let last = self.tracker.last.map(|l| (l.pose, self.tracker.keyframes.all[l.keyframe].depth_m));
        let is_fast = last.is_some_and(|(last, depth_m)| view_distance_rad(&last, &pose, depth_m) > FAST_RAD);
        let may = !self.is_full();
        self.tracker.take_placed(view, observation, &found, may);
        self.errors_m.resize(self.keyframes(), error_m);
        Ok(LiveView { world_from_camera: self.world_from_map * pose, inliers, error_m, is_fast })
    }

    /// Starts the map with a view.
    fn begin(&mut self, view: usize, observation: Observation) -> LiveView {
        self.tracker = Tracker::new(self.seed);
        self.world_from_map = Placed { observations: vec![&observation], poses: &[Pose::identity()] }
            .upright_world(None)
            .world_from_map;
        self.tracker.begin_piece(view, observation);
        self.errors_m = vec![0.0];
        LiveView { world_from_camera: self.world_from_map, inliers: 1.0, error_m: 0.0, is_fast: false }
    }
}
