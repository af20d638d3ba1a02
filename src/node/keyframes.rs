//! Selection of views that differ from all kept ones; this bounds the memory of a long recording.

use geometry::Pose;

/// Least time between kept views without a pose, nanoseconds.
/// derived: at 0.35 m/s, a hand moves a camera by 7 cm in this time
const UNPLACED_NANOS: u64 = 200_000_000;

/// Rule for a view to be new.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct KeyframeRule {
    /// Least distance from every kept view, meters ...
    pub translation_m: f64,
    /// ... or least rotation from it, radians.
    pub rotation_rad: f64,
    /// Most views per state.
    pub most: usize,
}

/// The kept views of one state.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Keyframes {
    poses: Vec<Pose>,
    last_stamp_nanos: Option<i64>,
    /// Number of kept views without a pose, and the stamp of the last one.
    unplaced: usize,
    last_unplaced_nanos: Option<i64>,
}

/// The verdict on a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// The view is kept.
    Keep,
    /// It is similar to a kept view.
    Known,
    /// The state has the largest allowed number of views.
    Full,
    /// Its stamp is not after the last kept view's, as time jumped back.
    Late,
}

impl Keyframes {
    /// Number of kept views.
    #[must_use]
    pub(crate) fn len(&self) -> usize {
        self.poses.len() + self.unplaced
    }

    /// Decides whether a view is kept.
    #[must_use]
    pub(crate) fn verdict_on(
        &self,
        stamp_nanos: i64,
        world_from_camera: &Pose,
        rule: &KeyframeRule,
    ) -> Verdict {
        // After a backward jump, kept views stay and older ones are dropped.
        if self.last_stamp_nanos.is_some_and(|last| stamp_nanos <= last) {
            return Verdict::Late;
        }
        // Compared with all kept views, as a camera that returns shows nothing new.
        let is_known = self.poses.iter().any(|p| {
            let away = (p.translation.vector - world_from_camera.translation.vector).norm();
            away < rule.translation_m && p.rotation.angle_to(&world_from_camera.rotation) < rule.rotation_rad
        });
        match is_known {
            true => Verdict::Known,
            false if self.len() >= rule.most => Verdict::Full,
            false => Verdict::Keep,
        }
    }

    /// Keeps a view without a pose if enough time has passed since the last kept one; returns whether it did.
    pub(crate) fn keep_unplaced(&mut self, stamp_nanos: i64, rule: &KeyframeRule) -> bool {
        let is_near = |s: Option<i64>| s.is_some_and(|s| stamp_nanos.abs_diff(s) < UNPLACED_NANOS);
        let near = is_near(self.last_stamp_nanos) || is_near(self.last_unplaced_nanos);
        let keep = !near && self.len() < rule.most;
        if keep {
            self.unplaced += 1;
            self.last_unplaced_nanos = Some(stamp_nanos);
        }
        keep
    }

    /// Removes the last `count` kept views.
    pub(crate) fn forget_last(&mut self, count: usize) {
        self.poses.truncate(self.poses.len().saturating_sub(count));
    }

    /// Keeps a view.
    pub(crate) fn keep_view(&mut self, stamp_nanos: i64, world_from_camera: Pose) {
        self.poses.push(world_from_camera);
        self.last_stamp_nanos = Some(stamp_nanos);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn views_without_poses_are_kept_by_their_time() {
        let rule = KeyframeRule { translation_m: 0.1, rotation_rad: 0.2, most: 4 };
        let mut kept = Keyframes::default();
        kept.keep_view(1_000_000_000, Pose::identity());
        let tenths = [10, 11, 12, 13, 14, 13, 16, 18];
        let found = tenths.map(|t| kept.keep_unplaced(t * 100_000_000, &rule));
        assert_eq!(found, [false, false, true, false, true, false, true, false]);
        assert_eq!(kept.len(), 4);
    }

    #[test]
    fn a_view_is_kept_once() {
        let rule = KeyframeRule { translation_m: 0.1, rotation_rad: 0.2, most: 3 };
        let mut kept = Keyframes::default();
        let mut offer = |stamp, x: f64, turn: f64| {
            let pose = Pose::new(Vector3::new(x, 0.0, 0.0), Vector3::new(0.0, turn, 0.0));
            let verdict = kept.verdict_on(stamp, &pose, &rule);
            if verdict == Verdict::Keep {
                kept.keep_view(stamp, pose);
            }
            verdict
        };
        assert_eq!(offer(1, 0.0, 0.0), Verdict::Keep);
        assert_eq!(offer(2, 0.05, 0.1), Verdict::Known);
        assert_eq!(offer(3, 0.05, 0.3), Verdict::Keep);
        assert_eq!(offer(4, 0.11, 0.0), Verdict::Keep);
        assert_eq!(offer(4, 0.5, 0.0), Verdict::Late);
        assert_eq!(offer(5, 0.5, 0.0), Verdict::Full);
        assert_eq!(offer(6, 0.0, 0.0), Verdict::Known);
    }
}
