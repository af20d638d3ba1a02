//! Keyframes, by which other frames are located, and the edges between them.

use nalgebra::{Matrix6, Vector3};
use rayon::prelude::*;

use super::{
    locate::{Known, Located, mean_depth_m},
    observation::Observation,
};
use common::stop::{Stop, Stopped};
use geometry::Pose;

/// A frame by which others are located.
pub(super) struct Keyframe {
    /// Index of the view.
    pub view: usize,
    pub observation: Observation,
    /// Index of the piece of the track.
    pub piece: usize,
    /// Pose of its camera in the piece's frame.
    pub pose: Pose,
    /// Mean depth of its surface, meters.
    pub depth_m: f64,
}

/// Relative pose of two keyframes.
#[derive(Clone)]
pub(super) struct KeyframeEdge {
    pub frames: [usize; 2],
    pub first_from_second: Pose,
    /// Information about the second pose, in its camera's frame.
    pub information: Matrix6<f64>,
    /// Matching landmarks.
    pub matches: Vec<[u32; 2]>,
    /// Whether it was found by appearance instead of tracking.
    pub closure: bool,
}

/// All keyframes of a state.
#[derive(Default)]
pub(super) struct Keyframes {
    pub all: Vec<Keyframe>,
    pub edges: Vec<KeyframeEdge>,
}

impl Keyframe {
    pub fn new(view: usize, observation: Observation, piece: usize, pose: Pose) -> Self {
        let depth_m = mean_depth_m(&observation.surfels);
        Self { view, observation, piece, pose, depth_m }
    }

    pub fn known(&self) -> Known<'_> {
        Known { observation: &self.observation, pose: self.pose, matches: None }
    }
}

/// Difference of two cameras' views of points at a depth, radians: the angle between their axes plus the
/// angle that their distance subtends.
pub(super) fn view_distance_rad(a: &Pose, b: &Pose, depth_m: f64) -> f64 {
    let [axis_a, axis_b] = [a, b].map(|p| p.rotation * Vector3::z());
    let turned = axis_a.dot(&axis_b).clamp(-1.0, 1.0).acos();
    turned + (a.translation.vector - b.translation.vector).norm() / depth_m
}

impl Keyframes {
    /// Keyframes of a piece, nearest views first.
    pub fn nearest(&self, piece: usize, pose: &Pose) -> Vec<usize> {
        let mut order: Vec<(f64, usize)> = (0..self.all.len())
            .filter(|&k| self.all[k].piece == piece)
            .map(|k| (view_distance_rad(&self.all[k].pose, pose, self.all[k].depth_m), k))
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        order.into_iter().map(|(_, k)| k).collect()
    }

    /// Keyframes of a piece that look most similar to a frame, the most similar first.
    pub fn most_alike(
        &self,
        candidates: &[usize],
        new: &Observation,
        count: usize,
        stop: &Stop,
    ) -> Result<Vec<(usize, Known<'_>)>, Stopped> {
        let mut alike: Vec<(Vec<[u32; 2]>, usize)> = candidates
            .par_iter()
            .map(|&k| stop.check().map(|()| (self.all[k].observation.matches_with(new), k)))
            .collect::<Result<_, Stopped>>()?;
        alike.sort_by(|a, b| b.0.len().cmp(&a.0.len()).then(b.1.cmp(&a.1)));
        let piece = alike.first().map(|(_, k)| self.all[*k].piece);
        let of_piece = alike.into_iter().filter(|(_, k)| Some(self.all[*k].piece) == piece).take(count);
        Ok(of_piece
            .map(|(matches, k)| (k, Known { matches: Some(matches), ..self.all[k].known() }))
            .collect())
    }

    /// Adds edges between a new keyframe and its neighbors.
    pub fn add_edges(&mut self, known: &[usize], number: usize, located: &Located, closure: bool) {
        for (at, &k) in known.iter().enumerate() {
            // A neighbor without common surface gives no edge.
            if located.overlaps[at].agreeing > 0 {
                self.edges.push(KeyframeEdge {
                    frames: [k, number],
                    first_from_second: self.all[k].pose.inverse() * located.pose,
                    information: located.by_known[at],
                    matches: located.matches[at].clone(),
                    closure,
                });
            }
        }
    }

    /// Indices of the keyframes of a piece.
    pub fn of_piece(&self, piece: usize) -> Vec<usize> {
        (0..self.all.len()).filter(|&k| self.all[k].piece == piece).collect()
    }

    /// Whether two keyframes were compared.
    pub fn has_edge(&self, [i, j]: [usize; 2]) -> bool {
        self.edges.iter().any(|e| e.frames == [i, j] || e.frames == [j, i])
    }

    /// Merges a piece into another by the motion between their frames.
    pub fn merge_piece(&mut self, piece: usize, into: usize, into_from_piece: &Pose) {
        for keyframe in self.all.iter_mut().filter(|k| k.piece == piece) {
            keyframe.piece = into;
            keyframe.pose = into_from_piece * keyframe.pose;
        }
    }
}
