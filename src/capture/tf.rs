//! Frame transforms over time: chains and interpolation, with errors for missing parts.
//!
//! Every frame has at most one parent (REP-105). A moving transform is known at its samples; between close
//! samples the translation is interpolated linearly and the rotation by slerp. Nothing is extrapolated.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

use super::{CaptureError, error::stamp_secs};
use geometry::Pose;

/// Most frames in a chain.
const MAX_DEPTH: usize = 64;

/// Most frames with a parent; a robot has a few hundred.
pub const MAX_TF_FRAMES: usize = 10_000;

/// Most parents of one frame kept for the error message.
const MAX_PARENTS: usize = 8;

/// Transform from a frame to its parent, `parent_from_child`.
#[derive(Clone, Debug)]
enum Edge {
    Static(Pose),
    /// Samples by stamp in nanoseconds; shared by copies of a buffer.
    Moving(Arc<BTreeMap<i64, Pose>>),
}

impl Edge {
    fn add(&mut self, stamp_nanos: i64, parent_from_child: Pose) {
        match self {
            Self::Moving(samples) => _ = Arc::make_mut(samples).insert(stamp_nanos, parent_from_child),
            // A frame in both topics counts as moving.
            Self::Static(_) => {
                *self = Self::Moving(Arc::new(BTreeMap::from([(stamp_nanos, parent_from_child)])));
            }
        }
    }

    /// Number of samples; 0 of a static transform.
    fn samples(&self) -> usize {
        match self {
            Self::Moving(samples) => samples.len(),
            Self::Static(_) => 0,
        }
    }
}

/// Transforms of a recording.
#[derive(Clone, Debug, Default)]
pub struct TfBuffer {
    /// Parent and transform, by child.
    edges: BTreeMap<String, (String, Edge)>,
    /// Frames with more than one parent, and these parents.
    conflicts: BTreeMap<String, BTreeSet<String>>,
    /// Transforms of such frames to the parents that were not first, by child and parent.
    further: BTreeMap<(String, String), Edge>,
    /// Number of invalid transforms that were dropped.
    pub invalid: usize,
    /// Number of dropped transforms of frames beyond [`MAX_TF_FRAMES`].
    pub surplus: usize,
}

/// End of the chain upwards from a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chain {
    /// The frame without a parent.
    pub root: String,
    /// Whether some transform of the chain changes with time.
    pub moves: bool,
}

/// Why a frame has no pose in its parent at a stamp.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
enum StepFault {
    #[error("`{child}` has several parents ({parents}); let one node publish it")]
    Parents { child: String, parents: String },
    #[error("`{0}` has no parent")]
    NoParent(String),
    #[error("`{0}` turns by half a turn between two samples")]
    HalfTurn(String),
    #[error(
        "a gap of {gap_s:.3} s in the transforms of `{child}`, more than capture.tf_max_gap_secs = {most_s}"
    )]
    Gap { child: String, gap_s: f64, most_s: f64 },
    #[error("the transforms of `{child}` end at {at_s:.6} s")]
    Ended { child: String, at_s: f64 },
    #[error("the transforms of `{child}` begin at {at_s:.6} s")]
    NotBegun { child: String, at_s: f64 },
    #[error("no transform of `{0}`")]
    NoSample(String),
}

impl TfBuffer {
    /// Adds a transform for all times.
    pub fn add_static(&mut self, parent: &str, child: &str, parent_from_child: Pose) {
        if self.accept(parent, child) {
            self.edges.insert(child.to_owned(), (parent.to_owned(), Edge::Static(parent_from_child)));
        } else if self.has_further_parent(parent, child) {
            let key = (child.to_owned(), parent.to_owned());
            self.further.insert(key, Edge::Static(parent_from_child));
        }
    }

    /// Adds a sample of a moving transform.
    pub fn add(&mut self, parent: &str, child: &str, stamp_nanos: i64, parent_from_child: Pose) {
        if !self.accept(parent, child) {
            if self.has_further_parent(parent, child) {
                let key = (child.to_owned(), parent.to_owned());
                let edge = self.further.entry(key).or_insert_with(|| Edge::Moving(Arc::default()));
                edge.add(stamp_nanos, parent_from_child);
            }
            return;
        }
        let (_, edge) = self
            .edges
            .entry(child.to_owned())
            .or_insert_with(|| (parent.to_owned(), Edge::Moving(Arc::default())));
        edge.add(stamp_nanos, parent_from_child);
    }

    /// Whether a parent is one of several that a frame is known to have.
    fn has_further_parent(&self, parent: &str, child: &str) -> bool {
        self.conflicts.get(child).is_some_and(|parents| parents.contains(parent))
    }

    fn accept(&mut self, parent: &str, child: &str) -> bool {
        if parent == child || parent.is_empty() || child.is_empty() {
            self.invalid += 1;
            return false;
        }
        match self.edges.get(child) {
            Some((known, _)) if known != parent => {
                // Reported only when the frame is looked up: an unused frame may have two parents.
                let parents = self.conflicts.entry(child.to_owned()).or_default();
                if parents.len() < MAX_PARENTS {
                    parents.extend([known.clone(), parent.to_owned()]);
                }
                false
            }
            None if self.edges.len() >= MAX_TF_FRAMES => {
                self.surplus += 1;
                false
            }
            _ => true,
        }
    }

    /// These transforms with one parent for every frame of the chain upwards from `frame`: a buffer for each
    /// choice where frames have several parents, those with most samples first.
    #[must_use]
    pub fn with_one_parent(&self, frame: &str) -> Vec<Self> {
        let chain = self.ancestors(frame);
        let Some(&child) = chain.iter().find(|f| self.conflicts.contains_key(**f)) else {
            return vec![self.clone()];
        };
        let Some((first, edge)) = self.edges.get(child) else { return vec![self.clone()] };
        let mut choices: Vec<(&String, &Edge)> = vec![(first, edge)];
        choices.extend(self.further.iter().filter(|((c, _), _)| c == child).map(|((_, p), edge)| (p, edge)));
        // By name among equals, so that all states choose alike.
        choices.sort_by_key(|(parent, edge)| (std::cmp::Reverse(edge.samples()), parent.to_owned()));
        let mut all = Vec::new();
        for (parent, edge) in choices.into_iter().take(MAX_PARENTS) {
            let mut chosen = self.clone();
            chosen.conflicts.remove(child);
            chosen.edges.insert(child.to_owned(), (parent.clone(), edge.clone()));
            all.extend(chosen.with_one_parent(frame));
            if all.len() >= MAX_PARENTS {
                all.truncate(MAX_PARENTS);
                break;
            }
        }
        all
    }

    /// The static transforms: parent, child, `parent_from_child`.
    pub fn static_transforms(&self) -> impl Iterator<Item = (&str, &str, Pose)> {
        self.edges.iter().filter_map(|(child, (parent, edge))| match edge {
            Edge::Static(pose) => Some((parent.as_str(), child.as_str(), *pose)),
            Edge::Moving(_) => None,
        })
    }

    /// The frames of a chain upwards, from the frame itself.
    #[must_use]
    pub fn chain_frames<'a>(&'a self, frame: &'a str) -> Vec<&'a str> {
        self.ancestors(frame)
    }

    /// Whether the pose of a frame in its parent changes with time.
    #[must_use]
    pub fn is_moving(&self, frame: &str) -> bool {
        matches!(self.edges.get(frame), Some((_, Edge::Moving(_))))
    }

    /// Stamps of the samples of a frame whose pose in its parent changes with time, nanoseconds; none of
    /// others.
    #[must_use]
    pub fn stamps_of(&self, frame: &str) -> Vec<i64> {
        match self.edges.get(frame) {
            Some((_, Edge::Moving(samples))) => samples.keys().copied().collect(),
            _ => Vec::new(),
        }
    }

    /// Whether a frame has a parent.
    #[must_use]
    pub fn has_parent(&self, frame: &str) -> bool {
        self.edges.contains_key(frame)
    }

    /// Frames whose pose in their parent changes with time and that carry no other such frame, by name.
    #[must_use]
    pub fn moving_ends(&self) -> Vec<&str> {
        let moving = || self.edges.iter().filter(|(_, (_, edge))| matches!(edge, Edge::Moving(_)));
        let carriers: BTreeSet<&str> =
            moving().flat_map(|(child, _)| self.ancestors(child).into_iter().skip(1)).collect();
        moving().map(|(child, _)| child.as_str()).filter(|child| !carriers.contains(child)).collect()
    }

    /// Frames that are fixed to a frame by static transforms below it, by name.
    #[must_use]
    pub fn fixed_below(&self, frame: &str) -> Vec<&str> {
        self.edges.keys().map(String::as_str).filter(|child| self.is_fixed_below(child, frame)).collect()
    }

    fn is_fixed_below(&self, child: &str, frame: &str) -> bool {
        let chain = self.ancestors(child);
        let Some(place) = chain.iter().position(|f| *f == frame) else { return false };
        place > 0 && chain[..place].iter().all(|f| matches!(self.edges.get(*f), Some((_, Edge::Static(_)))))
    }

    /// Moves the samples of all moving transforms in time, each by the number of nanoseconds for its frame.
    pub fn shift(&mut self, by_nanos: impl Fn(&str) -> i64) {
        for (child, (_, edge)) in &mut self.edges {
            if let Edge::Moving(samples) = edge {
                let by = by_nanos(child);
                *samples = Arc::new(samples.iter().map(|(t, pose)| (t.saturating_add(by), *pose)).collect());
            }
        }
    }

    /// Sets the parent and samples of a frame from elsewhere (a pose topic), in place of the known ones.
    pub fn replace(&mut self, parent: &str, child: &str, samples: BTreeMap<i64, Pose>) {
        self.conflicts.remove(child);
        self.edges.insert(child.to_owned(), (parent.to_owned(), Edge::Moving(Arc::new(samples))));
    }

    /// Drops samples before a stamp, and the oldest of a frame with more than `most`.
    pub fn forget_before(&mut self, stamp_nanos: i64, most: usize) {
        for edge in self.edges.values_mut().map(|(_, edge)| edge).chain(self.further.values_mut()) {
            let Edge::Moving(samples) = edge else { continue };
            let samples = Arc::make_mut(samples);
            while samples.len() > most || samples.keys().next().is_some_and(|first| *first < stamp_nanos) {
                samples.pop_first();
            }
        }
    }

    /// The chain upwards from a frame; a frame without a parent is its own root.
    #[must_use]
    pub fn chain_of_frame(&self, frame: &str) -> Chain {
        let mut chain = Chain { root: frame.to_owned(), moves: false };
        for _ in 0..MAX_DEPTH {
            let Some((parent, edge)) = self.edges.get(&chain.root) else { break };
            chain.moves |= matches!(edge, Edge::Moving(_));
            chain.root = parent.clone();
        }
        chain
    }

    /// One line per frame: `parent -> child (static)` or with the number of samples and their time span.
    #[must_use]
    pub fn describe(&self) -> Vec<String> {
        let mut lines = Vec::with_capacity(self.edges.len());
        for (child, (parent, edge)) in &self.edges {
            lines.push(match edge {
                Edge::Static(_) => format!("{parent} -> {child} (static)"),
                Edge::Moving(samples) => {
                    let span = samples.keys().next().zip(samples.keys().next_back());
                    let (first, last) = span.map_or((0.0, 0.0), |(a, b)| (stamp_secs(*a), stamp_secs(*b)));
                    format!("{parent} -> {child} ({} samples, {first:.3} to {last:.3} s)", samples.len())
                }
            });
        }
        lines
    }

    /// `target_from_source` at a stamp, through the frames' nearest common ancestor.
    ///
    /// # Errors
    /// [`CaptureError::NoTransform`] names target, source, stamp and the missing part: the chain, a sample on
    /// either side of the stamp, or samples at most `max_gap_nanos` apart.
    pub fn lookup(
        &self,
        target: &str,
        source: &str,
        stamp_nanos: i64,
        max_gap_nanos: i64,
    ) -> Result<Pose, CaptureError> {
        let fail = |reason: String| no_transform(target, source, stamp_nanos, reason);
        let from_source = self.ancestors(source);
        let from_target = self.ancestors(target);
        // Not through the root: transforms above the common ancestor cancel, and may be missing.
        let Some(common) = from_source.iter().find(|f| from_target.contains(f)) else {
            return Err(fail(format!(
                "the frames are not connected (`{source}` ends at `{}`, `{target}` at `{}`)",
                from_source.last().copied().unwrap_or_default(),
                from_target.last().copied().unwrap_or_default()
            )));
        };
        let mut poses = [Pose::identity(); 2];
        for (pose, chain) in poses.iter_mut().zip([&from_target, &from_source]) {
            for frame in chain.iter().take_while(|f| *f != common) {
                let step = self.parent_from_child(frame, stamp_nanos, max_gap_nanos);
                *pose = step.map_err(|e| fail(e.to_string()))? * *pose;
            }
        }
        let [common_from_target, common_from_source] = poses;
        Ok(common_from_target.inverse() * common_from_source)
    }

    /// The frame and its ancestors.
    fn ancestors<'a>(&'a self, frame: &'a str) -> Vec<&'a str> {
        std::iter::successors(Some(frame), |f| self.edges.get(*f).map(|(parent, _)| parent.as_str()))
            .take(MAX_DEPTH)
            .collect()
    }

    /// `parent_from_child` of one frame at a stamp.
    fn parent_from_child(&self, child: &str, stamp: i64, max_gap: i64) -> Result<Pose, StepFault> {
        let frame = || child.to_owned();
        if let Some(parents) = self.conflicts.get(child) {
            let names: Vec<_> = parents.iter().map(String::as_str).collect();
            return Err(StepFault::Parents { child: frame(), parents: names.join(", ") });
        }
        let samples = match self.edges.get(child) {
            None => return Err(StepFault::NoParent(frame())),
            Some((_, Edge::Static(pose))) => return Ok(*pose),
            Some((_, Edge::Moving(samples))) => samples,
        };
        let before = samples.range(..=stamp).next_back();
        let after = samples.range(stamp..).next();
        match (before, after) {
            // At a sample no interpolation is needed, however far the next one is.
            (Some((t0, a)), Some((t1, _))) if t0 == t1 => Ok(*a),
            (Some((t0, a)), Some((t1, b))) if t1 - t0 <= max_gap => {
                let share = (stamp - t0) as f64 / (t1 - t0) as f64;
                // A half turn between samples has no unique path.
                // docs/method.md (2.2).
                a.try_lerp_slerp(b, share, 1e-9).ok_or_else(|| StepFault::HalfTurn(frame()))
            }
            (Some((t0, _)), Some((t1, _))) => Err(StepFault::Gap {
                child: frame(),
                gap_s: stamp_secs(t1 - t0),
                most_s: stamp_secs(max_gap),
            }),
            (Some((last, _)), None) => Err(StepFault::Ended { child: frame(), at_s: stamp_secs(*last) }),
            (None, Some((first, _))) => Err(StepFault::NotBegun { child: frame(), at_s: stamp_secs(*first) }),
            (None, None) => Err(StepFault::NoSample(frame())),
        }
    }
}

fn no_transform(target: &str, source: &str, stamp_nanos: i64, reason: String) -> CaptureError {
    CaptureError::NoTransform {
        target: target.to_owned(),
        source_frame: source.to_owned(),
        stamp_secs: stamp_secs(stamp_nanos),
        reason,
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, UnitQuaternion, Vector3};

    use super::*;

    const S: i64 = 1_000_000_000;

    fn buffer() -> TfBuffer {
        let mut tf = TfBuffer::default();
        tf.add_static("link", "optical", Pose::new(Vector3::new(0.1, 0.0, 0.0), Vector3::new(0.0, 0.0, 0.5)));
        tf.add("world", "link", 10 * S, Pose::new(Vector3::zeros(), Vector3::zeros()));
        tf.add("world", "link", 12 * S, Pose::new(Vector3::new(2.0, 0.0, 0.0), Vector3::new(0.0, 0.0, 1.0)));
        tf
    }

    #[test]
    fn a_chain_is_interpolated_at_the_stamp() {
        let pose = buffer().lookup("world", "optical", 10 * S + S / 2, 5 * S).unwrap();
        let link = Pose::new(Vector3::new(0.5, 0.0, 0.0), Vector3::new(0.0, 0.0, 0.25));
        let expected = link * Pose::new(Vector3::new(0.1, 0.0, 0.0), Vector3::new(0.0, 0.0, 0.5));
        let p = Point3::new(0.3, -0.2, 1.0);
        assert!((pose * p - expected * p).norm() < 1e-12);
        assert!(pose.rotation.angle_to(&UnitQuaternion::from_scaled_axis(Vector3::z() * 0.75)) < 1e-9);
        let back = buffer().lookup("optical", "world", 10 * S + S / 2, 5 * S).unwrap();
        assert!((back * pose).translation.vector.norm() < 1e-12);
    }

    #[test]
    fn two_branches_meet_at_their_common_ancestor() {
        let mut tf = buffer();
        tf.add_static("link", "other", Pose::translation(0.0, 1.0, 0.0));
        // At a stamp far outside the samples: link does not move against itself.
        let pose = tf.lookup("other", "optical", 99 * S, S).unwrap();
        assert!((pose.translation.vector - Vector3::new(0.1, -1.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn nothing_is_extrapolated_and_the_error_names_everything() {
        let tf = buffer();
        for (stamp, words) in [(13 * S, "end at 12"), (9 * S, "begin at 10")] {
            let text = tf.lookup("world", "optical", stamp, 5 * S).unwrap_err().to_string();
            assert!(text.contains("optical") && text.contains("world") && text.contains(words), "{text}");
            assert!(text.contains(&format!("{:.6}", stamp_secs(stamp))), "{text}");
        }
        assert!(tf.lookup("world", "optical", 11 * S, S).unwrap_err().to_string().contains("gap of 2.000 s"));
        assert!(tf.lookup("map", "optical", 11 * S, S).unwrap_err().to_string().contains("not connected"));
        // Exactly at a sample there is nothing to interpolate.
        assert!(tf.lookup("world", "optical", 12 * S, S).is_ok());
    }

    #[test]
    fn a_frame_has_one_parent() {
        let mut tf = buffer();
        tf.add("odom", "link", 11 * S, Pose::identity());
        assert!(
            tf.lookup("world", "optical", 11 * S, 5 * S)
                .unwrap_err()
                .to_string()
                .contains("several parents (odom, world)")
        );
        tf.add_static("a", "a", Pose::identity());
        assert_eq!(tf.invalid, 1);
        // Each parent can be chosen; the one with most samples comes first.
        tf.add("odom", "link", 12 * S, Pose::identity());
        tf.add("odom", "link", 13 * S, Pose::identity());
        let roots: Vec<String> =
            tf.with_one_parent("optical").iter().map(|t| t.chain_of_frame("optical").root).collect();
        assert_eq!(roots, ["odom", "world"]);
        assert!(tf.with_one_parent("optical")[1].lookup("world", "optical", 11 * S, 5 * S).is_ok());
    }

    #[test]
    fn frames_that_move_at_the_end_of_a_chain_and_those_fixed_to_them() {
        let mut tf = buffer();
        tf.add_static("optical", "infra", Pose::identity());
        tf.add("link", "tool", 11 * S, Pose::identity());
        assert_eq!(tf.moving_ends(), ["tool"]);
        assert_eq!(tf.fixed_below("link"), ["infra", "optical"]);
        tf.shift(|_| -10 * S);
        assert!(tf.lookup("world", "link", S, 5 * S).is_ok());
    }

    #[test]
    fn loops_end() {
        let mut tf = TfBuffer::default();
        tf.add_static("a", "b", Pose::identity());
        tf.add_static("b", "a", Pose::identity());
        assert!(tf.lookup("world", "a", 0, S).is_err());
        assert!(!tf.chain_of_frame("a").moves);
    }

    #[test]
    fn a_pose_topic_takes_the_place_of_the_tree() {
        let mut tf = buffer();
        tf.replace("map", "optical", BTreeMap::from([(S, Pose::translation(1.0, 2.0, 3.0))]));
        assert_eq!(tf.chain_of_frame("optical"), Chain { root: "map".into(), moves: true });
        assert_eq!(tf.lookup("map", "optical", S, S).unwrap().translation.z, 3.0);
    }
}
