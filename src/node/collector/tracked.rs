//! Views without a camera pose: before tracking, and after it.
//!
//! They are recorded without a pose: the pipeline tracks them as in any bag, with all views available, and
//! aligns the states. A live pose is less accurate and would be a second way to get one.

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

/// Time a view waits for a transform of its camera before it is tracked, nanoseconds.
/// derived: publishers of transforms send at least ten times a second
const WAIT_NANOS: i64 = 500_000_000;
/// Frames for the twin: it differs from that of the published map, since the pipeline tracks anew.
const TWIN_FRAMES: [&str; 2] = ["world", "twin_world"];

impl Collector {
    /// Number of the current map.
    #[must_use]
    pub(crate) fn map_number(&self) -> u64 {
        self.tracking.map
    }

    /// Number of the current map if the kept views of this state are tracked; `None` if their poses were
    /// given.
    #[must_use]
    pub(crate) fn tracked_map(&self) -> Option<u64> {
        (self.tracking.kept == Some(true)).then_some(self.tracking.map)
    }

    /// Changes whether the camera is tracked. A state being collected stays as it began: the pipeline tracks
    /// all or none of its views.
    pub(crate) fn set_tracking(&mut self, tracking: TrackCamera) {
        self.settings.tracking = tracking;
    }

    /// Starts another map; earlier views no longer count.
    pub(crate) fn begin_map(&mut self) {
        self.tracking.map += 1;
        self.tracking.to_track.clear();
    }

    /// Removes and returns the views to be tracked.
    pub(crate) fn take_to_track(&mut self) -> Vec<ToTrack> {
        std::mem::take(&mut self.tracking.to_track)
    }

    /// Frame of the twin, if it differs from that of the recorded poses.
    #[must_use]
    pub(crate) fn twin_frame(&self) -> Option<&'static str> {
        let root = self.optical_frame().map(|optical| self.tf.root_of_frame(&optical));
        let free = TWIN_FRAMES.into_iter().find(|f| root.as_deref() != Some(f));
        free.filter(|_| self.tracking.is_on)
    }

    /// Whether a set is to be tracked; if so, it is taken over.
    pub(super) fn is_to_track(&mut self, set: &Matched<Picture>, optical: &str) -> bool {
        let is_posed = self.tf.moving_root(optical).is_some();
        let late = set.stamp_nanos.saturating_add(WAIT_NANOS) <= self.newest_nanos;
        let tracking = match self.phase {
            Phase::Idle => self.settings.tracking,
            Phase::Collecting(_) => self.tracking.in_state,
        };
        let on = match (tracking, self.tracking.kept) {
            (TrackCamera::Never, _) => false,
            (TrackCamera::Always, _) => true,
            // A given frame or topic of poses has priority.
            (TrackCamera::Auto, _) if self.settings.poses_asked => false,
            // A state is of one kind.
            (TrackCamera::Auto, Some(tracked)) => tracked,
            (TrackCamera::Auto, None) => !is_posed && (self.tracking.is_on || late),
        };
        self.tracking.is_on = on;
        on && self.infos[0].is_some()
    }

    pub(super) fn hand_over(&mut self, set: Matched<Picture>) {
        let seen_by = self.camera_of_images(&set.images);
        self.tracking.to_track.push(ToTrack {
            map: self.tracking.map,
            stamp_nanos: set.stamp_nanos,
            images: set.images,
            seen_by,
        });
    }

    /// Handles a tracked view; returns it with the transform to publish, if it has a pose.
    ///
    /// # Errors
    /// If writing fails; the state is then no longer collected.
    pub(crate) fn accept_tracked(
        &mut self,
        tracked: Tracked,
        now_nanos: i64,
    ) -> Result<Option<(Seen, Option<TransformStamped>)>, BagWriteError> {
        if tracked.map != self.tracking.map {
            return Ok(None);
        }
        let frame = match tracked.outcome {
            Outcome::Placed(placed) => placed.0,
            // Later views may connect to it, which the pipeline will find.
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
        let seen = self.keep_if_new(tracked.view, now_nanos, true, Some(frame));
        let seen = self.unless_failed(seen)?;
        Ok(seen.map(|seen| (seen, transform)))
    }

    /// Records a view without a pose if it may show something new.
    ///
    /// # Errors
    /// If writing fails; the state is then no longer collected.
    pub(crate) fn keep_unplaced(
        &mut self,
        stamp_nanos: i64,
        images: [Option<Picture>; 3],
        now_nanos: i64,
    ) -> Result<(), BagWriteError> {
        let Phase::Collecting(state) = self.phase else { return Ok(()) };
        // Automatic states hold views back in case the object moves, which cannot be checked for a view
        // without a pose.
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

    /// Transform from the map to the root of the camera's own frames, so that no frame gets a second parent.
    fn camera_transform(&mut self, view: &View) -> Option<TransformStamped> {
        let map = &self.settings.map_frame;
        let (_, optical) = view.images[0].as_ref()?.header().checked()?;
        let root = self.tf.root_of_frame(&optical);
        let optical_from_root = match root == optical {
            true => Pose::identity(),
            // If the transform of a moving frame is not known yet, this view is not published.
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
