//! The tracked trajectory of a state's camera.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::{
    adjust::Adjustment,
    closure::{close_loops, join_pieces},
    imu::{Accelerometer, MeasuredUp, NoGravity, measured_up},
    keyframes::{Keyframe, KeyframeEdge},
    observation::Observation,
    pose_graph::pose_graph,
    tracker::Tracker,
};
use crate::poses::{pairs::Matches, pose_noise::PoseNoise, surfels::Surfels};
use common::stop::{Stop, Stopped};
use geometry::Pose;
use numeric::statistics::median;

/// Summary of a tracked trajectory.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrackingFindings {
    /// Number of views.
    pub views: usize,
    /// Views with a pose.
    pub tracked: usize,
    /// Stretches of lost views, by the index of the first and the last one.
    pub lost: Vec<[usize; 2]>,
    /// Number of keyframes.
    pub keyframes: usize,
    /// Number of compared keyframe pairs: during tracking, and in loop closure.
    pub pairs: [usize; 2],
    /// Root mean square motion of the keyframes in the final adjustment, meters.
    pub closed_m: f64,
    /// Median standard deviation of a keyframe relative to its neighbors, in the least determined direction,
    /// meters.
    pub least_known_m: f64,
}

/// The tracked trajectory of a state's camera.
pub struct Track {
    /// Stamp of every view, nanoseconds.
    pub stamps_nanos: Vec<i64>,
    /// Pose of every view; `None` if it was lost.
    pub poses: Vec<Option<Pose>>,
    /// The up direction in the map, where accelerations were recorded.
    pub measured_up: Option<Result<MeasuredUp, NoGravity>>,
    /// Counts and errors.
    pub findings: TrackingFindings,
    /// Observations of the keyframes.
    pub(super) observations: Vec<Observation>,
    /// Poses of the keyframes.
    pub(super) key_poses: Vec<Pose>,
}

impl Tracker {
    /// Closes loops, joins pieces and adjusts all keyframes; only the piece with the most views remains.
    ///
    /// # Errors
    /// [`Stopped`].
    pub fn finish(mut self, stop: &Stop) -> Result<Track, Stopped> {
        let seed = self.seed();
        join_pieces(&mut self.keyframes, seed, stop)?;
        let closures = close_loops(&mut self.keyframes, seed, stop)?;
        let members = self.keyframes.of_piece(self.largest_piece());
        let place = |k: usize| members.binary_search(&k).ok();
        let edges: Vec<KeyframeEdge> = self
            .keyframes
            .edges
            .iter()
            .filter_map(|e| {
                Some(KeyframeEdge { frames: [place(e.frames[0])?, place(e.frames[1])?], ..e.clone() })
            })
            .collect();
        let start: Vec<Pose> = members.iter().map(|&k| self.keyframes.all[k].pose).collect();
        let near = pose_graph(&start, &edges, stop)?;
        let mut observations = Vec::new();
        for (k, Keyframe { observation, .. }) in self.keyframes.all.into_iter().enumerate() {
            if place(k).is_some() {
                observations.push(observation);
            }
        }
        let key_poses = adjusted_together(&observations, &near, &edges, stop)?;
        let poses: Vec<Option<Pose>> = self
            .views
            .iter()
            .map(|v| {
                let v = (*v)?;
                Some(key_poses[place(v.keyframe)?] * v.keyframe_from_camera)
            })
            .collect();
        let moved = start
            .iter()
            .zip(&key_poses)
            .map(|(a, b)| (a.translation.vector - b.translation.vector).norm_squared());
        let findings = TrackingFindings {
            views: poses.len(),
            tracked: poses.iter().flatten().count(),
            lost: stretches_without_pose(&poses),
            keyframes: key_poses.len(),
            pairs: [edges.iter().filter(|e| !e.closure).count(), closures],
            closed_m: (moved.sum::<f64>() / key_poses.len().max(1) as f64).sqrt(),
            least_known_m: median(self.least_known_m).unwrap_or(0.0),
        };
        let stamps_nanos = self.stamps_nanos;
        Ok(Track { stamps_nanos, poses, measured_up: None, findings, observations, key_poses })
    }
}

impl Track {
    /// The up direction in the map from an accelerometer.
    ///
    /// # Errors
    /// [`NoGravity`].
    pub fn up_of(&self, accelerometer: &Accelerometer) -> Result<MeasuredUp, NoGravity> {
        let views = self.stamps_nanos.iter().zip(&self.poses);
        let placed: Vec<(i64, Pose)> = views.filter_map(|(t, p)| Some((*t, (*p)?))).collect();
        measured_up(&placed, accelerometer)
    }
}

/// Keyframe poses adjusted by surfels and landmarks, starting from the pose graph.
fn adjusted_together(
    observations: &[Observation],
    near: &[Pose],
    edges: &[KeyframeEdge],
    stop: &Stop,
) -> Result<Vec<Pose>, Stopped> {
    let surfels: Vec<Surfels> = observations.iter().map(|o| o.surfels.clone()).collect();
    let mut pairs: Vec<[usize; 2]> = edges.iter().map(|e| e.frames).collect();
    pairs.sort_unstable();
    pairs.dedup();
    let matches: Matches = edges.iter().map(|e| (e.frames, e.matches.clone())).collect();
    let adjustment = Adjustment {
        surfels: &surfels,
        fixed: 1,
        pairs: &pairs,
        matches: &matches,
        start: PoseNoise::EXPECTED,
        stop,
    };
    if near.len() < 2 {
        return Ok(near.to_vec());
    }
    Ok(adjustment.solve_near(near)?.map_or_else(|| near.to_vec(), |a| a.poses))
}

/// Stretches of views without a pose: index of the first and the last.
fn stretches_without_pose(poses: &[Option<Pose>]) -> Vec<[usize; 2]> {
    let mut all: Vec<[usize; 2]> = Vec::new();
    for view in (0..poses.len()).filter(|&v| poses[v].is_none()) {
        match all.last_mut().filter(|s| s[1] + 1 == view) {
            Some(stretch) => stretch[1] = view,
            None => all.push([view, view]),
        }
    }
    all
}

impl fmt::Display for TrackingFindings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { views, tracked, keyframes, pairs: [on_the_way, behind], .. } = self;
        write!(
            f,
            "camera poses were tracked: {tracked} of {views} views, by {keyframes} keyframes, {on_the_way} \
             pairs on the way and {behind} that close loops; a keyframe is known to {:.2} mm against its \
             neighbors (one standard deviation, in its least known direction); closing moved \
             keyframes by {:.1} mm",
            1e3 * self.least_known_m,
            1e3 * self.closed_m
        )
    }
}
