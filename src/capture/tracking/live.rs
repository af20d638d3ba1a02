//! A camera followed while its views come in: the steps of [`Tracker`], with a pose at once and a bounded
//! map. Later views change nothing: no loop is closed, and a lost view leaves no trace.

use super::{
    gravity::Placed, keyframes::view_distance_rad, lost::Lost, observation::Observation, tracker::Tracker,
};
use geometry::Pose;

/// Change between two views near the limit of tracking, radians.
/// chosen: half of the 0.5 rad of matching features (`closure`)
const FAST_RAD: f64 = 0.25;

/// Follows a camera.
pub struct LiveTracker {
    seed: u64,
    /// Keyframes kept at most.
    most: usize,
    tracker: Tracker,
    /// Views looked at.
    views: usize,
    world_from_map: Pose,
    /// Of each keyframe: standard deviation of its place in the world, meters.
    errors_m: Vec<f64>,
}

/// Place of a view, and its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LiveView {
    /// Pose of the optical frame: z up, x along the first view, the origin on the support below its focus.
    pub world_from_camera: Pose,
    /// Agreeing share of its common surface with the keyframes; 1 of the first view.
    pub inliers: f64,
    /// Standard deviation of its place against the first view's, meters, in the least known direction.
    pub error_m: f64,
    /// Whether the camera moves nearly too fast.
    pub is_fast: bool,
}

impl LiveTracker {
    /// Before the first view; `most` keyframes are kept, each about a megabyte. Draws come from a stream of
    /// the seed.
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

    /// Whether no more keyframes are kept: new surface can then be seen from near the old ones alone.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.keyframes() >= self.most
    }

    /// Takes the next view.
    ///
    /// # Errors
    /// Why it has no place. It is as if it had not been.
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
                // Of a map of one view nothing is lost. This view may be the better one to begin with.
                if self.keyframes() == 1 {
                    self.begin(view, observation);
                }
                return Err(why);
            }
        };
        let located = &found.located;
        // By the way of least error from keyframe to keyframe: after a return the old place is known.
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

    /// Makes a view the first one of the map.
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
