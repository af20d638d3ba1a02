//! The choice of kept views.

use super::{Collector, Held, Phase, Seen, View};
use crate::keyframes::Verdict;
use capture::RgbdFrame;
use io::BagWriteError;

impl Collector {
    /// Keeps a view if it is new. Tracked views are decoded and written without transforms.
    pub(super) fn keep_if_new(
        &mut self,
        view: View,
        now_nanos: i64,
        pixels: bool,
        tracked: Option<RgbdFrame>,
    ) -> Result<Option<Seen>, BagWriteError> {
        // By the pose alone, before decoding, since most views show nothing new.
        let verdict = match self.phase {
            Phase::Collecting(state) => self.keyframes[state].verdict_on(
                view.stamp_nanos,
                &view.world_from_camera,
                &self.settings.rule,
            ),
            Phase::Idle => Verdict::Known,
        };
        let keep = verdict == Verdict::Keep;
        let is_tracked = tracked.is_some();
        let decoded = if is_tracked {
            tracked
        } else if keep || pixels {
            let seen_by = self.camera_of_images(&view.images);
            match view.frame(&mut self.eye, &seen_by, &self.settings.topics) {
                Ok(frame) => Some(frame),
                Err(why) => {
                    self.counts.broken += 1;
                    self.problem = Some(why.to_string());
                    return Ok(None);
                }
            }
        } else {
            None
        };
        self.counts.count_verdict(verdict, self.phase != Phase::Idle);
        if let (true, Phase::Collecting(state)) = (keep, self.phase) {
            self.keyframes[state].keep_view(view.stamp_nanos, view.world_from_camera);
            self.tracking.kept = Some(is_tracked);
            // Stored now, as transforms are dropped after some seconds and the view may be held longer.
            let frame = view.images[0].as_ref().and_then(|p| p.header().checked()).filter(|_| !is_tracked);
            let around = frame.map_or_else(Vec::new, |(stamp, frame)| self.tf.samples_around(&frame, stamp));
            self.held.push_back(Held { view, around, now_nanos });
            self.write_held(self.settings.hold)?;
        }
        Ok(decoded.map(|frame| Seen { frame, kept: keep }))
    }
}
