//! State of the search for motions in unexplained surface, and how much a motion is worth.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::{
    pair::{surface_pair::SurfacePair, unexplained::Unexplained},
    propose::{
        agreement::{gains_by_motion, rough_agreement, sharp_agreement},
        patch::faces_of_open,
        slid_panel::join_slid,
    },
    samples::{
        hinge::{axis_of_turn, axis_off_m, hinge_score},
        slip::{Slip, least_slips},
        spacing::SETTLED,
    },
};
use geometry::Pose;

/// Worth of a turn about an axis in thin air relative to a turn about a hinge: links in a chain may turn so.
/// tuned: shared/bags
const DETACHED: f64 = 0.1;

/// State of the search for motions.
pub(crate) struct Search<'a, 'b> {
    pub pair: &'a SurfacePair<'b>,
    pub extent_m: f64,
    pub left: Unexplained,
    /// Unexplained samples of each state, grouped by plane.
    pub faces: [Vec<Vec<usize>>; 2],
    /// Motions known so far; the first is the static part's.
    pub bodies: Vec<Pose>,
}

impl<'a, 'b> Search<'a, 'b> {
    pub(crate) fn new(pair: &'a SurfacePair<'b>, motions: &[Pose], extent_m: f64) -> Self {
        // Surface that a slid panel covers in both states is opened before faces are grown over it.
        let mut left = Unexplained::left_by_motions(pair, motions);
        join_slid(&mut left, pair);
        let faces = [0, 1].map(|s| faces_of_open(pair, s, &left.open[s]));
        Self { pair, extent_m, left, faces, bodies: motions.to_vec() }
    }
}

impl Search<'_, '_> {
    /// Number of samples a motion explains, weighted by the hinge score, and unweighted. See
    /// docs/method.md (6.10).
    pub(crate) fn hinged_worth(&self, motion: &Pose) -> (f64, f64) {
        let gains = gains_by_motion(self.pair, motion, &self.left, &self.faces);
        let total: f64 = gains.iter().flatten().sum();
        (
            total
                * attachment_score(
                    self.pair,
                    motion,
                    &self.bodies,
                    &gains[0],
                    &self.left.open[0],
                    self.extent_m,
                ),
            total,
        )
    }

    /// The weighted worth from some of the samples, for a motion up to a step off.
    pub(crate) fn rough_worth(&self, motion: &Pose) -> f64 {
        let (total, gains) =
            self.total_by(motion, 7, |s, i, t| rough_agreement(self.pair, &self.left, s, i, t));
        self.hinge_weighed(motion, total, &gains)
    }

    /// The weighted worth from some of the samples, without tolerance beyond edges of the surface.
    pub(crate) fn sharp_worth(&self, motion: &Pose) -> f64 {
        let (total, gains) = self.sharp_total(motion);
        self.hinge_weighed(motion, total, &gains)
    }

    /// The same unweighted, with the gain of every sample of state 0.
    pub(crate) fn sharp_total(&self, motion: &Pose) -> (f64, Vec<f64>) {
        self.total_by(motion, 5, |s, i, t| sharp_agreement(self.pair, &self.left, s, i, t))
    }

    /// A total weighted by the hinge score; `gains` are those of the samples of state 0.
    fn hinge_weighed(&self, motion: &Pose, total: f64, gains: &[f64]) -> f64 {
        total * attachment_score(self.pair, motion, &self.bodies, gains, &self.left.open[0], self.extent_m)
    }

    /// Sum of `says` over every few samples of each face, with the gain of every sample of state 0.
    fn total_by(
        &self,
        motion: &Pose,
        every: usize,
        says: impl Fn(usize, usize, &Pose) -> f64,
    ) -> (f64, Vec<f64>) {
        let mut total = 0.0;
        let mut gains = vec![0.0; self.left.open[0].len()];
        for s in 0..2 {
            let other_from_this = if s == 0 { *motion } else { motion.inverse() };
            for face in &self.faces[s] {
                let values: Vec<(usize, f64)> =
                    face.iter().step_by(every).map(|&i| (i, says(s, i, &other_from_this))).collect();
                let sum: f64 = values.iter().map(|v| v.1).sum();
                // A face that contradicts the motion belongs to something else, and counts nothing.
                total += sum.max(0.0);
                if s == 0 && sum > 0.0 {
                    values.iter().for_each(|(i, v)| gains[*i] = *v);
                }
            }
        }
        (total, gains)
    }

    /// The best motion reached by steps along slips, with its worth. A point-to-plane fit leaves slips of the
    /// surface within itself free (Gelfand and Guibas 2004); they show only at edges. Steps are halved if
    /// none helps.
    pub(crate) fn climbed_motion(
        &self,
        motion: &Pose,
        mut slips: [Slip; 3],
        worth_of: impl Fn(&Pose) -> f64 + Sync,
        anew: impl Fn(&Pose) -> Option<[Slip; 3]>,
    ) -> (f64, Pose) {
        let mut best = *motion;
        let mut step_m = 2.0 * self.pair.reach_m;
        let mut worth = worth_of(&best);
        while step_m > SETTLED * self.pair.reach_m {
            // Only along slips: the surface fixes all other directions of a refined motion.
            let moves: Vec<Pose> =
                slips.iter().flat_map(|slip| [step_m, -step_m].map(|m| slip.motion_by(m) * best)).collect();
            let tried: Vec<(f64, Pose)> = moves.into_par_iter().map(|p| (worth_of(&p), p)).collect();
            let (next, pose) =
                tried.into_iter().fold((f64::NEG_INFINITY, best), |a, b| if b.0 > a.0 { b } else { a });
            if next > worth {
                (worth, best) = (next, pose);
            } else {
                step_m *= 0.5;
                // The motion may now explain other surface, which has other slips.
                slips = anew(&best).unwrap_or(slips);
            }
        }
        (worth, best)
    }

    /// Center of the surface of state 0 that a motion explains.
    pub(crate) fn explained_center(&self, motion: &Pose) -> Point3<f64> {
        let explained = self.explained_samples(motion);
        let points = &self.pair.samples[0].points;
        Point3::from(
            explained.iter().map(|&i| points[i].coords).sum::<Vector3<f64>>() / explained.len().max(1) as f64,
        )
    }

    /// Samples of state 0 that a motion explains.
    fn explained_samples(&self, motion: &Pose) -> Vec<usize> {
        let [gains, _] = gains_by_motion(self.pair, motion, &self.left, &self.faces);
        (0..gains.len()).filter(|&i| gains[i] > 0.0).collect()
    }

    /// Points and normals of the surface that a motion explains, moved by it.
    pub(crate) fn moved_surface(&self, motion: &Pose) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
        let samples = self.pair.samples[0];
        self.explained_samples(motion)
            .into_iter()
            .map(|i| (motion * samples.points[i], motion * samples.normals[i]))
            .unzip()
    }

    /// Slips of the surface that a motion explains, moved by it.
    pub(crate) fn slips_of(&self, motion: &Pose) -> Option<[Slip; 3]> {
        let (points, normals) = self.moved_surface(motion);
        least_slips(&points, &normals)
    }

    /// Removes the samples that a motion explains from the unexplained ones.
    pub(crate) fn take_explained(&mut self, motion: &Pose) {
        let explained = gains_by_motion(self.pair, motion, &self.left, &self.faces);
        for s in 0..2 {
            for (i, _) in explained[s].iter().enumerate().filter(|(_, g)| **g > 0.0) {
                self.left.open[s][i] = false;
                self.left.moved[s][i] = false;
            }
        }
        // The motion is now that of a known body, to which others may be attached.
        self.bodies.push(*motion);
    }
}

/// How well a turn could be that of a hinge, from [`DETACHED`] to 1: its axis, relative to one of the
/// `bodies`, is close to both the moving surface (of positive `gains`) and surface that other motions
/// explain. 1 for slides.
fn attachment_score(
    pair: &SurfacePair<'_>,
    motion: &Pose,
    bodies: &[Pose],
    gains: &[f64],
    open: &[bool],
    extent_m: f64,
) -> f64 {
    const EVERY: usize = 13;
    let points = &pair.samples[0].points;
    let moving: Vec<Point3<f64>> =
        points.iter().zip(gains).filter(|(_, g)| **g > 0.0).map(|(p, _)| *p).collect();
    let others: Vec<Point3<f64>> =
        points.iter().zip(open).filter(|(_, o)| !**o).map(|(p, _)| *p).step_by(EVERY).collect();
    // The best over the bodies: a part is attached to one.
    let mut best = 0.0;
    for body in bodies {
        let score = axis_of_turn(&(body.inverse() * motion)).map_or(1.0, |screw| {
            let off_m = axis_off_m(&screw.point, &screw.direction, &moving, &others);
            DETACHED + (1.0 - DETACHED) * hinge_score(off_m, extent_m)
        });
        best = f64::max(best, score);
    }
    best
}
