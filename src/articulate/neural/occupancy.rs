//! Occupancy moved back from one state into the other (docs/method.md 12.7), and its loss against the
//! occupancy there (docs/method.md 12.8).
//!
//! A point `x` of the `here` state has, in the other state, the candidates `x_i = T_i^-1 x`. `m_i` is the
//! part probability of a candidate times the occupancy there, and `O(x) = sum_i m_i` is the occupancy due to
//! all parts moved here.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::neural::{
    config::ArticulationConfig,
    loss_term::{CHUNK, LossTerm},
    motion_params::{MotionGradient, Motions, Way},
    state_model::Volume,
};

/// A candidate in occupied space: only these depend on the segmentation.
#[derive(Clone, Copy)]
pub(crate) struct Candidate {
    /// Index of the point `x`.
    pub point: usize,
    /// Index of the part.
    pub part: usize,
    /// `x_i` in the other state, normalised.
    pub image: Point3<f64>,
    occupancy: f64,
    by_image: Vector3<f64>,
}

/// Points of one state with their candidates in the other.
pub(crate) struct BackwardFlow<'a> {
    points: &'a [Point3<f64>],
    /// Weight of every point; the mean over the points of `weight * f` estimates the mean of `f`.
    weights: Option<&'a [f64]>,
    motions: &'a Motions,
    /// The direction from here to the other state.
    way: Way,
    /// Candidates, sorted by point and then by part.
    pub candidates: Vec<Candidate>,
}

impl<'a> BackwardFlow<'a> {
    /// Finds the candidates of points; `way` leads from their state to `other`.
    pub(crate) fn gather(
        points: &'a [Point3<f64>],
        weights: Option<&'a [f64]>,
        other: &Volume<'_>,
        motions: &'a Motions,
        way: Way,
    ) -> Self {
        let mut flow = Self { points, weights, motions, way, candidates: Vec::new() };
        let found: Vec<Vec<Candidate>> = (0..points.len().div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let chunk = chunk * CHUNK..((chunk + 1) * CHUNK).min(points.len());
                chunk.flat_map(|point| flow.candidates_of(point, other)).collect()
            })
            .collect();
        flow.candidates = found.concat();
        flow
    }

    /// The candidates of one point; none for a point without weight.
    fn candidates_of(&self, point: usize, other: &Volume<'_>) -> Vec<Candidate> {
        let mut found = Vec::new();
        if self.weight(point) == 0.0 {
            return found;
        }
        for part in 0..self.motions.parts.len() {
            let image = self.motions.apply(part, self.way, &self.points[point]);
            let (occupancy, by_image) = other.occupancy(&image);
            // An empty candidate adds nothing, whatever its part probability.
            if occupancy > 0.0 {
                found.push(Candidate { point, part, image, occupancy, by_image });
            }
        }
        found
    }

    fn weight(&self, point: usize) -> f64 {
        self.weights.map_or(1.0, |w| w[point])
    }

    /// `O(x)` of every point; `probabilities` are those of the candidates' images, `parts` a candidate.
    pub(crate) fn occupancy(&self, probabilities: &[f32]) -> Vec<f64> {
        let mut sums = vec![0.0; self.points.len()];
        for (c, p) in self.candidates.iter().zip(probabilities.chunks_exact(self.motions.parts.len())) {
            sums[c.point] += f64::from(p[c.part]) * c.occupancy;
        }
        sums
    }

    /// Mean over the points of a loss of `O(x)`, given together with its derivative.
    pub(crate) fn occupancy_mean_loss(
        &self,
        probabilities: &[f32],
        loss: impl Fn(usize, f64) -> (f64, f64) + Sync,
    ) -> LossTerm {
        let parts = self.motions.parts.len();
        let share = 1.0 / self.points.len().max(1) as f64;
        let predicted = self.occupancy(probabilities);
        // Computed once per point, as several of its candidates need the derivative.
        let each: Vec<(f64, f64)> = predicted.par_iter().enumerate().map(|(k, o)| loss(k, *o)).collect();
        let mut term = LossTerm::zero(self.candidates.len(), parts);
        term.value = each.iter().enumerate().map(|(k, (value, _))| share * self.weight(k) * value).sum();
        for (k, (c, p)) in self.candidates.iter().zip(probabilities.chunks_exact(parts)).enumerate() {
            let by_o = share * self.weight(c.point) * each[c.point].1;
            term.by_probabilities[k * parts + c.part] = (by_o * c.occupancy) as f32;
            let by_image = c.by_image * (by_o * f64::from(p[c.part]));
            term.by_motions.add(self.motions, c.part, self.way, &self.points[c.point], &by_image);
        }
        term
    }

    /// Gradient by the motions through the query points of the segmentation.
    pub(crate) fn by_motions(&self, by_images: &[[f32; 3]]) -> MotionGradient {
        let mut total = MotionGradient::zero(self.motions.parts.len());
        for (c, g) in self.candidates.iter().zip(by_images) {
            let by_image = Vector3::new(g[0], g[1], g[2]).cast();
            total.add(self.motions, c.part, self.way, &self.points[c.point], &by_image);
        }
        total
    }
}

/// Occupancy consistency: the mean of `v (O(x) - target(x))^2`, where `v` is 1 if the point was seen here and
/// one of its candidates in the other state, else the unseen weight. The target is the occupancy of the
/// points' own state.
pub(crate) fn occupancy_loss(
    flow: &BackwardFlow<'_>,
    probabilities: &[f32],
    here: &Volume<'_>,
    other: &Volume<'_>,
    config: &ArticulationConfig,
) -> LossTerm {
    flow.occupancy_mean_loss(probabilities, |k, predicted| {
        let x = &flow.points[k];
        // docs/method.md (12.17).
        let error = predicted - here.occupancy(x).0;
        // True for most points; visibility is queried only where it counts.
        if error == 0.0 {
            return (0.0, 0.0);
        }
        let seen = here.is_visible(x)
            && (0..flow.motions.parts.len()).any(|i| other.is_visible(&flow.motions.apply(i, flow.way, x)));
        let v = if seen { 1.0 } else { config.unseen_weight };
        (v * error * error, 2.0 * v * error)
    })
}
