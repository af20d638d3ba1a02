//! Views without a camera pose: before tracking, and after it.
//!
//! They are written without a pose: the pipeline tracks them as those of any bag, with all views at hand, and
//! brings the states together. A pose of now knows less, and would be a second way in.

use super::{Collector, Held, Phase, Seen, View};
use crate::{
    live_tracking::{Outcome, ToTrack, Tracked},
    sample::Picture,
    synchronizer::Matched,
};
use capture::TrackCamera;
use geometry::Pose;
use io::{
    BagWriteError,
    ros2msg::{Header, Time, Transform, TransformStamped},
};

/// A view waits so long for a transform of its camera before it is tracked, nanoseconds.
/// derived: publishers of transforms send ten times a second and more
const WAIT_NANOS: i64 = 500_000_000;
/// The frame of the twin: the pipeline tracks it anew, so it is not the frame of the published map.
const TWIN_FRAMES: [&str; 2] = ["world", "twin_world"];

impl Collector {
    /// Number of the views' map.
    #[must_use]
    pub(crate) fn map_number(&self) -> u64 {
        self.tracking.map
    }

    /// Number of the map, where the kept views of this state are tracked; `None`: their poses were given.
    #[must_use]
    pub(crate) fn tracked_map(&self) -> Option<u64> {
        (self.tracking.kept == Some(true)).then_some(self.tracking.map)
    }

    /// Begins another map: earlier views say nothing any more.
    pub(crate) fn begin_map(&mut self) {
        self.tracking.map += 1;
        self.tracking.to_track.clear();
    }

    /// Views to track; they are given once.
    pub(crate) fn take_to_track(&mut self) -> Vec<ToTrack> {
        std::mem::take(&mut self.tracking.to_track)
    }

    /// Frame of the twin, where it is not the one of the recorded poses.
    #[must_use]
    pub(crate) fn twin_frame(&self) -> Option<&'static str> {
        let root = self.optical_frame().map(|optical| self.tf.root_of_frame(&optical));
        let free = TWIN_FRAMES.into_iter().find(|f| root.as_deref() != Some(f));
        free.filter(|_| self.tracking.is_on)
    }

    /// Whether a set gets its pose by tracking; then it is taken.
    pub(super) fn is_to_track(&mut self, set: &Matched<Picture>, optical: &str) -> bool {
        let is_posed = self.tf.moving_root(optical).is_some();
        let late = set.stamp_nanos.saturating_add(WAIT_NANOS) <= self.newest_nanos;
        let on = match (self.settings.tracking, self.tracking.kept) {
            (TrackCamera::Never, _) => false,
            (TrackCamera::Always, _) => true,
            // A named frame or topic of poses goes first.
            (TrackCamera::Auto, _) if self.settings.poses_asked => false,
            // A state is of one kind: the pipeline tracks all of its views or none.
            (TrackCamera::Auto, Some(tracked)) => tracked,
            (TrackCamera::Auto, None) => !is_posed && (self.tracking.is_on || late),
        };
        self.tracking.is_on = on;
        on && self.infos[0].is_some()
    }

    pub(super) fn hand_over(&mut self, set: Matched<Picture>) {
        self.tracking.to_track.push(ToTrack {
            map: self.tracking.map,
            stamp_nanos: set.stamp_nanos,
            images: set.images,
            infos: self.infos.clone(),
        });
    }

    /// Takes a tracked view; returns it, with the transform to publish, where it has a place.
    ///
    /// # Errors
    /// If the disk refuses; then the state is not collected any further.
    pub(crate) fn accept_tracked(
        &mut self,
        tracked: Tracked,
        now_nanos: i64,
    ) -> Result<Option<(Seen, Option<TransformStamped>)>, BagWriteError> {
        if tracked.map != self.tracking.map {
            return Ok(None);
        }
        let pixels = match tracked.outcome {
            Outcome::Placed(placed) => placed.0,
            // It may connect to later views: the pipeline will know.
            Outcome::Lost(why) if !why.is_blind() => {
                self.keep_unplaced(tracked.view.stamp_nanos, tracked.view.images, now_nanos)?;
                return Ok(None);
            }
            Outcome::Lost(_) => return Ok(None),
            Outcome::Broken(why) => {
                self.counts.broken += 1;
                self.problem = Some(why);
                return Ok(None);
            }
        };
        self.world_frame = Some(self.settings.map_frame.clone());
        let transform = self.camera_transform(&tracked.view);
        let seen = self.keep_if_new(tracked.view, now_nanos, true, Some(pixels));
        let seen = self.unless_failed(seen)?;
        Ok(seen.map(|seen| (seen, transform)))
    }

    /// Records a view without a pose, where it may show something new.
    ///
    /// # Errors
    /// If the disk refuses; then the state is not collected any further.
    pub(crate) fn keep_unplaced(
        &mut self,
        stamp_nanos: i64,
        images: [Option<Picture>; 3],
        now_nanos: i64,
    ) -> Result<(), BagWriteError> {
        let Phase::Collecting(state) = self.phase else { return Ok(()) };
        // With automatic states views are held back while the object may move: one without a pose cannot be
        // watched.
        if self.settings.hold > 0 || !self.keyframes[state].keep_unplaced(stamp_nanos, &self.settings.rule) {
            return Ok(());
        }
        self.tracking.kept = Some(true);
        self.counts.kept += 1;
        let view = View { stamp_nanos, images, world_from_camera: Pose::identity() };
        self.held.push_back(Held { view, around: Vec::new(), now_nanos });
        let written = self.write_held(0);
        self.unless_failed(written)
    }

    /// From the map to the top of the camera's own frames, none of them gets a second parent.
    fn camera_transform(&mut self, view: &View) -> Option<TransformStamped> {
        let map = &self.settings.map_frame;
        let (_, optical) = view.images[0].as_ref()?.header().checked()?;
        let root = self.tf.root_of_frame(&optical);
        let optical_from_root = match root == optical {
            true => Pose::identity(),
            // The transform of a moving frame may not be there yet: then this view is not published.
            false => self.tf.lookup(&optical, &root, view.stamp_nanos, self.settings.max_gap_nanos).ok()?,
        };
        if root == *map {
            self.problem = Some(format!("frame `{map}` has its own place on /tf; name another world_frame"));
            return None;
        }
        self.tf.disown(map, &root);
        Some(TransformStamped {
            header: Header { stamp: Time::from_nanos(view.stamp_nanos), frame_id: map.clone() },
            child_frame_id: root,
            transform: Transform::from_pose(&(view.world_from_camera * optical_from_root)),
        })
    }
}
