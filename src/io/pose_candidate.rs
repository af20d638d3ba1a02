//! The poses that a source gives the views of a recording.

use super::{
    bag_index::BagIndex, lags::Lags, poses::PoseSource, synchronize::OTHER_CLOCK_NANOS, views::Views,
};
use capture::{CaptureConfig, CaptureError, TfBuffer, stamp_secs};
use common::note::{Note, NoteCode};
use geometry::Pose;

/// Fewest views with poses, where there are as many.
/// derived: fewer than these are not even refined (`capture::poses`)
const LEAST_POSED: usize = 3;

/// The poses that a source gives the views of a recording.
#[derive(Clone, Debug)]
pub struct PoseCandidate {
    /// The transforms, on the clock of the images.
    pub source: PoseSource,
    /// The frame that they are of, and where they come from.
    pub name: String,
    /// Pose of the optical frame in every view; `None` where there is none.
    pub poses: Vec<Option<Pose>>,
    /// Why the first view without a pose has none.
    first_failure: Option<String>,
    /// Time by which the stamps of the poses were moved to the clock of the images, nanoseconds.
    shift_nanos: i64,
}

/// How far the stamps of a frame are behind those of the images, if on another clock, nanoseconds.
fn clock_shift(child: &str, index: &BagIndex, topic_lag: Option<Option<i64>>, image_lag: Option<i64>) -> i64 {
    let lag = match topic_lag {
        Some(lag) if !index.tf_lags.contains_key(child) => lag,
        _ => index.tf_lags.get(child).and_then(Lags::median_nanos),
    };
    let behind = lag.unwrap_or(0) - image_lag.unwrap_or(0);
    if behind.abs() > OTHER_CLOCK_NANOS { behind } else { 0 }
}

impl PoseCandidate {
    /// The poses of all views by a source: at their stamps or, where these are of another clock, at the
    /// times of recording.
    pub fn of_source(
        mut source: PoseSource,
        views: &Views,
        index: &BagIndex,
        config: &CaptureConfig,
    ) -> Self {
        let gap = (config.tf_max_gap_secs * 1e9) as i64;
        let delay = (config.pose_delay_secs * 1e9) as i64;
        let stamps: Vec<i64> = views.views.iter().map(|v| v.stamp_nanos + delay).collect();
        let mut found = poses_at(&source, &stamps, gap);
        let mut shift_nanos = 0;
        if found.0.iter().all(Option::is_none) {
            let image_lag = index.images.get(&views.topics.color).and_then(|i| i.lags.median_nanos());
            // What has no stamp is on the clock of recording already.
            let topic_lag = index.poses.get(&source.origin).map(|p| p.lags.median_nanos());
            let shift_of_child = |child: &str| clock_shift(child, index, topic_lag, image_lag);
            let mut most = 0;
            for child in moving_of_chain(&source.tf, &source.optical) {
                let shift = shift_of_child(&child);
                if shift.abs() > i64::abs(most) {
                    most = shift;
                }
            }
            if most != 0 {
                source.tf.shift(shift_of_child);
                let shifted = poses_at(&source, &stamps, gap);
                if shifted.0.iter().any(Option::is_some) {
                    shift_nanos = most;
                    found = shifted;
                }
            }
        }
        let (poses, first_failure) = found;
        Self {
            name: format!("poses of `{}` in `{}` from {}", source.optical, source.world, source.origin),
            source,
            poses,
            first_failure,
            shift_nanos,
        }
    }

    /// Number of views with a pose.
    pub fn count(&self) -> usize {
        self.poses.iter().flatten().count()
    }

    /// Whether enough of `all` views have a pose.
    pub fn is_enough(&self, all: usize) -> bool {
        self.count() >= LEAST_POSED.min(all)
    }

    /// The error of a recording to whose `all` views it gives too few poses.
    pub fn error(&self, state: usize, all: usize) -> CaptureError {
        // Reported as the cause: a missing pose is only its symptom.
        if self.source.invalid > 0 && self.count() == 0 {
            return CaptureError::InvalidPoses {
                topic: self.source.origin.clone(),
                count: self.source.invalid,
            };
        }
        CaptureError::NoPoses { state, frames: all, first: self.first_failure.clone().unwrap_or_default() }
    }

    /// Warnings about its losses and its clock.
    pub fn warnings(&self, state: usize, all: usize) -> Vec<Note> {
        let mut warnings = Vec::new();
        let failures = all - self.count();
        if let Some(first) = self.first_failure.as_ref().filter(|_| failures > 0) {
            let text = format!(
                "state {state}: {failures} of {all} frames have no camera pose and are not used (first: \
                 {first})"
            );
            warnings.push(Note::new(NoteCode::PosesMissing, text));
        }
        if self.source.invalid > 0 {
            let text = format!(
                "state {state}: {} transforms from {} are invalid (NaN, or no unit quaternion) and are not \
                 used",
                self.source.invalid, self.source.origin
            );
            warnings.push(Note::new(NoteCode::TransformsInvalid, text));
        }
        if self.shift_nanos != 0 {
            let text = format!(
                "state {state}: {} have stamps that are {:.3} s off those of the images by the times of \
                 recording, by which they were moved; give both one clock",
                self.source.origin,
                stamp_secs(-self.shift_nanos)
            );
            warnings.push(Note::new(NoteCode::ClocksDiffer, text));
        }
        warnings
    }
}

/// Poses at stamps, and why the first stamp without one has none.
fn poses_at(source: &PoseSource, stamps: &[i64], gap_nanos: i64) -> (Vec<Option<Pose>>, Option<String>) {
    let mut poses = Vec::with_capacity(stamps.len());
    let mut first = None;
    for &stamp in stamps {
        // (2.2), at the stamp of the color image; nothing is extrapolated.
        match source.tf.lookup(&source.world, &source.optical, stamp, gap_nanos) {
            Ok(pose) => poses.push(Some(pose)),
            Err(error) => {
                first.get_or_insert_with(|| error.to_string());
                poses.push(None);
            }
        }
    }
    (poses, first)
}

/// The frames of a chain upwards whose transforms move.
fn moving_of_chain(tf: &TfBuffer, frame: &str) -> Vec<String> {
    tf.chain_frames(frame).into_iter().filter(|f| tf.is_moving(f)).map(str::to_owned).collect()
}
