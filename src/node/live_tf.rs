//! Recent transforms: looked up as in a recording, dropped after some time, and stored as messages for the
//! recording.

use std::collections::BTreeMap;

use capture::{CaptureError, TfBuffer};
use geometry::Pose;
use io::ros2msg::{TfMessage, TransformStamped};

/// Time for which a transform is stored, nanoseconds.
const MEMORY_NANOS: i64 = 10_000_000_000;
/// Most stored samples per frame.
const MAX_SAMPLES: usize = 20_000;
/// Most frames.
const MAX_FRAMES: usize = 1000;

/// Transforms of the last seconds.
#[derive(Debug, Default)]
pub(crate) struct LiveTf {
    buffer: TfBuffer,
    /// Moving transforms, by child frame and stamp.
    moving: BTreeMap<String, BTreeMap<i64, TransformStamped>>,
    /// Static transforms, by child frame.
    fixed: BTreeMap<String, TransformStamped>,
    newest_nanos: i64,
    /// Number of rejected transforms: no unit quaternion, not finite, or too many frames.
    pub refused: u64,
    /// Number of backward jumps of the stamps by more than the stored time.
    pub jumps: u64,
    /// Frame whose pose comes from its own topic.
    pub overridden: Option<String>,
    /// Parent and child of transforms that the node itself publishes, and receives again.
    own: Vec<[String; 2]>,
}

impl LiveTf {
    /// Adds the transforms of `/tf`.
    pub(crate) fn add_message(&mut self, message: &TfMessage) {
        for t in &message.transforms {
            let child = t.child_frame_id.trim_start_matches('/');
            let parent = t.header.frame_id.trim_start_matches('/');
            let is_own = self.own.iter().any(|o| *o == [parent, child]);
            // The pose topic defines this frame; /tf may contain another estimate.
            if self.overridden.as_deref() != Some(child) && !is_own {
                self.add_one(t);
            }
        }
    }

    /// Adds one sample of a moving transform.
    pub(crate) fn add_one(&mut self, t: &TransformStamped) {
        let child = t.child_frame_id.trim_start_matches('/').to_owned();
        let (Some((stamp, parent)), Some(pose)) = (t.header.checked(), t.transform.checked()) else {
            self.refused += 1;
            return;
        };
        if !self.has_room(&child) {
            return;
        }
        // As in tf2, a backward time jump invalidates everything before it.
        if stamp < self.newest_nanos - MEMORY_NANOS {
            self.jumps += 1;
            self.forget_after(i64::MIN);
        }
        self.newest_nanos = self.newest_nanos.max(stamp);
        // One parent per frame, as in tf2; a moving frame is no longer static.
        self.fixed.remove(&child);
        self.buffer.add(&parent, &child, stamp, pose);
        let samples = self.moving.entry(child).or_default();
        samples.insert(stamp, t.clone());
        // Relative to the newest stamp, since replays may run at any speed.
        let horizon = self.newest_nanos - MEMORY_NANOS;
        while samples.len() > MAX_SAMPLES || samples.keys().next().is_some_and(|first| *first < horizon) {
            samples.pop_first();
        }
        self.buffer.forget_before(horizon, MAX_SAMPLES);
    }

    /// Adds the transforms of `/tf_static`.
    pub(crate) fn add_static(&mut self, message: &TfMessage) {
        for t in &message.transforms {
            let child = t.child_frame_id.trim_start_matches('/').to_owned();
            match (t.header.checked(), t.transform.checked()) {
                (Some((_, parent)), Some(pose)) if self.has_room(&child) => {
                    self.buffer.add_static(&parent, &child, pose);
                    self.fixed.insert(child, t.clone());
                }
                _ => self.refused += 1,
            }
        }
    }

    fn has_room(&mut self, child: &str) -> bool {
        let room = self.moving.contains_key(child)
            || self.fixed.contains_key(child)
            || self.moving.len() + self.fixed.len() < MAX_FRAMES;
        self.refused += u64::from(!room);
        room
    }

    /// Drops samples with a later stamp, after time jumped back to this one, so that nothing is interpolated
    /// towards them.
    pub(crate) fn forget_after(&mut self, stamp_nanos: i64) {
        // Rebuilt, since the buffer cannot drop late samples.
        self.buffer = TfBuffer::default();
        for (child, t) in &self.fixed {
            if let (Some((_, parent)), Some(pose)) = (t.header.checked(), t.transform.checked()) {
                self.buffer.add_static(&parent, child, pose);
            }
        }
        self.newest_nanos = 0;
        self.moving.retain(|child, samples| {
            samples.retain(|stamp, _| *stamp <= stamp_nanos);
            for (stamp, t) in &*samples {
                if let (Some((_, parent)), Some(pose)) = (t.header.checked(), t.transform.checked()) {
                    self.buffer.add(&parent, child, *stamp, pose);
                    self.newest_nanos = self.newest_nanos.max(*stamp);
                }
            }
            !samples.is_empty()
        });
    }

    /// The root of a frame's chain, if a transform on the way is moving.
    #[must_use]
    pub(crate) fn moving_root(&self, frame: &str) -> Option<String> {
        let chain = self.buffer.chain_of_frame(frame);
        (chain.moves && chain.root != frame).then_some(chain.root)
    }

    /// The root of a frame's chain.
    #[must_use]
    pub(crate) fn root_of_frame(&self, frame: &str) -> String {
        self.buffer.chain_of_frame(frame).root
    }

    /// Ignores from now on a transform that the node itself publishes.
    pub(crate) fn disown(&mut self, parent: &str, child: &str) {
        let own = [parent, child].map(str::to_owned);
        if !self.own.contains(&own) {
            self.own.push(own);
        }
    }

    /// `target_from_source` at a stamp, never extrapolated.
    ///
    /// # Errors
    /// As [`TfBuffer::lookup`].
    pub(crate) fn lookup(
        &self,
        target: &str,
        source: &str,
        stamp_nanos: i64,
        max_gap_nanos: i64,
    ) -> Result<Pose, CaptureError> {
        self.buffer.lookup(target, source, stamp_nanos, max_gap_nanos)
    }

    /// For every frame above the given one, the samples on either side of a stamp: what a recording needs for
    /// the same lookup.
    #[must_use]
    pub(crate) fn samples_around(&self, frame: &str, stamp_nanos: i64) -> Vec<TransformStamped> {
        let mut found = Vec::new();
        let mut frame = frame.to_owned();
        // Frames may form a loop.
        for _ in 0..MAX_FRAMES {
            let parent = match (self.moving.get(&frame), self.fixed.get(&frame)) {
                (Some(samples), _) => {
                    let before = samples.range(..=stamp_nanos).next_back();
                    let after = samples.range(stamp_nanos..).next();
                    // A sample exactly at the stamp is both; it is written once.
                    let same = before.map(|e| e.0) == after.map(|e| e.0);
                    found.extend(before.into_iter().chain(after.filter(|_| !same)).map(|(_, t)| t.clone()));
                    before.or(after).map(|(_, t)| t.header.frame_id.clone())
                }
                (None, Some(t)) => Some(t.header.frame_id.clone()),
                (None, None) => None,
            };
            match parent {
                Some(parent) => frame = parent.trim_start_matches('/').to_owned(),
                None => break,
            }
        }
        found
    }

    /// All static transforms.
    #[must_use]
    pub(crate) fn static_transforms(&self) -> Vec<TransformStamped> {
        self.fixed.values().cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use io::ros2msg::{Header, Time, Transform};

    const S: i64 = 1_000_000_000;

    fn sample(parent: &str, child: &str, stamp_nanos: i64, x: f64) -> TransformStamped {
        let header = Header { stamp: Time::from_nanos(stamp_nanos), frame_id: parent.into() };
        TransformStamped {
            header,
            child_frame_id: child.into(),
            transform: Transform::from_pose(&Pose::translation(x, 0.0, 0.0)),
        }
    }

    fn live() -> LiveTf {
        let mut tf = LiveTf::default();
        tf.add_static(&TfMessage { transforms: vec![sample("link", "optical", 0, 1.0)] });
        for i in 0..30 {
            tf.add_one(&sample("world", "link", S * (100 + i), i as f64));
        }
        tf
    }

    #[test]
    fn what_is_written_gives_the_same_lookup() {
        let tf = live();
        let stamp = 122 * S + S / 4;
        let pose = tf.lookup("world", "optical", stamp, 2 * S).unwrap();
        assert!((pose.translation.vector.x - 23.25).abs() < 1e-12);
        let around = tf.samples_around("optical", stamp);
        assert_eq!(around.iter().map(|t| t.header.stamp.sec).collect::<Vec<_>>(), [122, 123]);
        let mut written = LiveTf::default();
        written.add_static(&TfMessage { transforms: tf.static_transforms() });
        written.add_message(&TfMessage { transforms: around });
        assert_eq!(written.lookup("world", "optical", stamp, 2 * S).unwrap(), pose);
        assert_eq!(tf.samples_around("optical", 122 * S).len(), 1);
    }

    #[test]
    fn old_samples_are_forgotten_and_nothing_is_extrapolated() {
        let tf = live();
        assert!(tf.lookup("world", "optical", 105 * S, 2 * S).is_err());
        assert!(tf.lookup("world", "optical", 130 * S, 2 * S).is_err());
        assert_eq!(tf.moving_root("optical").as_deref(), Some("world"));
    }

    #[test]
    fn time_that_runs_back_starts_anew() {
        let mut tf = live();
        tf.add_one(&sample("world", "link", 50 * S, 0.0));
        tf.add_one(&sample("world", "link", 51 * S, 1.0));
        assert_eq!(tf.jumps, 1);
        assert!(
            (tf.lookup("world", "optical", 50 * S + S / 2, 2 * S).unwrap().translation.vector.x - 1.5).abs()
                < 1e-12
        );
        assert!(tf.lookup("world", "optical", 122 * S + S / 2, 2 * S).is_err());
    }

    #[test]
    fn what_is_later_than_a_jump_is_forgotten_and_the_rest_stays() {
        let mut tf = live();
        tf.forget_after(120 * S);
        assert!(tf.lookup("world", "optical", 120 * S + S / 2, 2 * S).is_err());
        assert!(
            (tf.lookup("world", "optical", 119 * S + S / 2, 2 * S).unwrap().translation.vector.x - 20.5)
                .abs()
                < 1e-12
        );
        // Another path from here on.
        tf.add_one(&sample("world", "link", 121 * S, 0.0));
        assert!(
            (tf.lookup("world", "optical", 120 * S + S / 2, 2 * S).unwrap().translation.vector.x - 11.0)
                .abs()
                < 1e-12
        );
    }

    #[test]
    fn what_the_node_publishes_itself_does_not_come_back() {
        let mut tf = LiveTf::default();
        tf.disown("map", "link");
        tf.add_message(&TfMessage { transforms: vec![sample("map", "link", S, 1.0)] });
        assert_eq!((tf.root_of_frame("link").as_str(), tf.moving_root("link")), ("link", None));
        tf.add_message(&TfMessage { transforms: vec![sample("odom", "link", S, 1.0)] });
        assert_eq!(tf.moving_root("link").as_deref(), Some("odom"));
    }

    #[test]
    fn broken_transforms_are_counted() {
        let mut tf = live();
        let mut broken = sample("world", "link", 130 * S, 1.0);
        broken.transform.rotation.w = 0.1;
        tf.add_one(&broken);
        assert_eq!(tf.refused, 1);
    }
}
