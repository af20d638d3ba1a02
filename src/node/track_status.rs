//! Quality of the live camera tracking, with advice for the person who carries the camera.

use std::{collections::VecDeque, time::Instant};

use super::live_tracking::{Outcome, Tracked};
use capture::{LiveView, Lost};

/// Time span of the rates, seconds. chosen: long enough to count, short enough to be current
const RATE_SECS: f64 = 2.0;
/// Share of dropped views above which to advise slower motion; several views dropped between two tracked ones
/// count once. chosen: half
const DROPPED_SHARE: f64 = 0.5;

/// Current quality of the tracking.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct TrackStatus {
    /// Located views per second.
    pub views_hz: f64,
    /// Share of the last view's surface that agrees with the map; 0 while the camera is lost.
    pub inliers: f64,
    /// Standard deviation of the last position, meters; infinite while the camera is lost.
    pub error_m: f64,
    /// Number of views that could not be located.
    pub lost: u64,
    /// Number of views dropped because the tracker was busy.
    pub dropped: u64,
    /// Number of views in the map.
    pub keyframes: usize,
    /// Advice; empty if none is needed.
    pub hint: String,
}

/// Counts tracked views.
#[derive(Debug, Default)]
pub(crate) struct TrackWatch {
    /// Times of located views.
    placed: VecDeque<Instant>,
    offered: VecDeque<Instant>,
    last: Option<(i64, LiveView)>,
    why: Option<(i64, Lost)>,
    keyframes: (usize, bool),
    lost: u64,
    dropped: u64,
}

impl TrackWatch {
    /// Counts a view that was sent to the tracker, or dropped because it was busy.
    pub(crate) fn count_offered(&mut self, taken: bool, now: Instant) {
        self.offered.push_back(now);
        self.dropped += u64::from(!taken);
        forget_old(&mut self.offered, now);
    }

    /// Counts a tracked view.
    pub(crate) fn count_tracked(&mut self, tracked: &Tracked, now: Instant) {
        self.keyframes = tracked.keyframes;
        match &tracked.outcome {
            Outcome::Placed(placed) => {
                let found = &placed.1;
                self.placed.push_back(now);
                (self.last, self.why) = (Some((tracked.view.stamp_nanos, *found)), None);
            }
            Outcome::Lost(why) => {
                self.lost += 1;
                self.why = Some((tracked.view.stamp_nanos, *why));
            }
            Outcome::Broken(_) => {}
        }
    }

    /// Whether the last view could not be located.
    #[must_use]
    pub(crate) fn is_lost(&self) -> bool {
        self.why.is_some()
    }

    /// Starts another map.
    pub(crate) fn begin_map(&mut self) {
        (self.last, self.why, self.keyframes) = (None, None, (0, false));
        (self.placed, self.offered) = Default::default();
    }

    /// Current quality of the tracking; `None` before the first view.
    pub(crate) fn status(&mut self, now: Instant) -> Option<TrackStatus> {
        forget_old(&mut self.placed, now);
        forget_old(&mut self.offered, now);
        let (inliers, error_m) = match (&self.last, &self.why) {
            (Some((_, found)), None) => (found.inliers, found.error_m),
            (_, Some(_)) => (0.0, f64::INFINITY),
            (None, None) => return None,
        };
        Some(TrackStatus {
            views_hz: self.placed.len() as f64 / RATE_SECS,
            inliers,
            error_m,
            lost: self.lost,
            dropped: self.dropped,
            keyframes: self.keyframes.0,
            hint: self.advice_for_carrier(),
        })
    }

    fn advice_for_carrier(&self) -> String {
        let busy = (self.placed.len() as f64) < (1.0 - DROPPED_SHARE) * self.offered.len() as f64;
        match (&self.why, &self.last) {
            (Some((stamp, why)), Some((seen, _))) => {
                let seconds = (stamp - seen) as f64 * 1e-9;
                format!("lost: {}; look back at what was in view {seconds:.1} s ago", why.remedy())
            }
            (Some((_, why)), None) => format!("not begun: {}", why.remedy()),
            (None, Some((_, view))) if view.is_fast && busy => {
                "move slower: the views between are not looked at in time".to_owned()
            }
            (None, Some((_, view))) if view.is_fast => "move slower".to_owned(),
            (None, _) if self.keyframes.1 => format!(
                "the map is full ({} keyframes): stay where you were, or end the state",
                self.keyframes.0
            ),
            (None, _) => String::new(),
        }
    }
}

/// Drops times outside the time span.
fn forget_old(times: &mut VecDeque<Instant>, now: Instant) {
    while times.front().is_some_and(|t| now.duration_since(*t).as_secs_f64() > RATE_SECS) {
        times.pop_front();
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::view::View;
    use capture::RgbdFrame;
    use geometry::{Intrinsics, Pose};

    fn tracked(stamp_secs: f64, outcome: Outcome) -> Tracked {
        let view = View {
            stamp_nanos: (1e9 * stamp_secs) as i64,
            images: [None, None, None],
            world_from_camera: Pose::identity(),
        };
        Tracked { map: 0, view, outcome, keyframes: (3, false) }
    }

    fn placed(stamp_secs: f64, is_fast: bool) -> Tracked {
        let found = LiveView { world_from_camera: Pose::identity(), inliers: 0.97, error_m: 0.001, is_fast };
        let intrinsics = Intrinsics { width: 1, height: 1, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 };
        let frame = RgbdFrame {
            id: String::new(),
            stamp_nanos: 0,
            intrinsics,
            world_from_camera: Pose::identity(),
            rgb: vec![[0; 3]],
            depth_m: vec![1.0],
            mask: None,
            readings: Vec::new(),
        };
        tracked(stamp_secs, Outcome::Placed(Box::new((frame, found))))
    }

    #[test]
    fn who_carries_the_camera_learns_what_to_do() {
        let mut watch = TrackWatch::default();
        let begin = Instant::now();
        let at = |secs: f64| begin + Duration::from_secs_f64(secs);
        assert_eq!(watch.status(begin), None);
        for k in 0..20 {
            watch.count_offered(true, at(0.1 * f64::from(k)));
            watch.count_tracked(&placed(100.0 + 0.1 * f64::from(k), false), at(0.1 * f64::from(k)));
        }
        let good = watch.status(at(1.9)).unwrap();
        assert_eq!((good.views_hz, good.inliers, good.hint.as_str(), good.keyframes), (10.0, 0.97, "", 3));
        watch.count_tracked(&placed(102.0, true), at(2.0));
        assert_eq!(watch.status(at(2.0)).unwrap().hint, "move slower");
        (0..40).for_each(|_| watch.count_offered(false, at(2.05)));
        let busy = watch.status(at(2.05)).unwrap();
        assert!(busy.hint.contains("not looked at in time") && busy.dropped == 40, "{busy:?}");
        watch.count_tracked(&tracked(103.5, Outcome::Lost(Lost::Dark)), at(2.1));
        let lost = watch.status(at(2.1)).unwrap();
        assert_eq!(lost.hint, "lost: give more light; look back at what was in view 1.5 s ago");
        assert!(lost.error_m.is_infinite() && lost.lost == 1);
        watch.begin_map();
        assert_eq!(watch.status(at(2.2)), None);
        watch.count_tracked(&tracked(104.0, Outcome::Lost(Lost::Blank)), at(2.3));
        assert!(watch.status(at(2.3)).unwrap().hint.starts_with("not begun: keep corners"));
        // Nothing comes any more.
        watch.count_tracked(&placed(105.0, false), at(2.4));
        assert_eq!(watch.status(at(10.0)).unwrap().views_hz, 0.0);
    }
}
