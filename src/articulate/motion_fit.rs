//! Motion of one part from all its evidence: robust Gauss-Newton on distance fields and lifted matches.
//!
//! Residuals of a motion `T = state1_from_state0`, each divided by its standard deviation:
//! - a surface point `x` of state 0: the other state's signed distance `d1(T x)`;
//! - a surface point `y` of state 1: `d0(T^-1 y)`, both by as much more as the readings lie above the one surface and not above the other;
//! - a lifted match: `point1 - T point0`, whitened by the covariances of both ends.
//!
//! Rows are derivatives by a left perturbation `T <- exp(v, w) T`, i.e. `d(T x) = v + w x (T x)`. Residuals are thinned
//! to the number of independent ones, so that the information matrix can be read as an inverse covariance.

use std::{collections::BTreeMap, ops::Range};

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Point3, Vector3, Vector6};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::SurfaceSamples;
use crate::geometry::{Grid3, Pose, exp_so3, shift_and_turn};

/// Settings of the refinement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RefineConfig {
    /// Gauss-Newton iterations at most.
    pub iterations: usize,
    /// Robust scale (Geman-McClure), in standard deviations.
    pub robust_sigmas: f64,
    /// Distances beyond this share of the object's extent say nothing about a correspondence.
    pub reach: f64,
    /// Smallest cosine between a warped normal and the other surface's normal.
    pub normal_cosine: f64,
    /// Length over which errors of a reconstructed surface are correlated, in grid spacings.
    pub correlation_spacings: f64,
    /// Standard deviation of a match's pixel, pixels.
    pub match_pixel_sigma: f64,
}

impl Default for RefineConfig {
    fn default() -> Self {
        Self { iterations: 30, robust_sigmas: 2.5, reach: 0.03, normal_cosine: 0.5, correlation_spacings: 3.0, match_pixel_sigma: 1.0 }
    }
}

/// A lifted match with the covariance of `point1 - T point0` for a motion near the current one.
#[derive(Clone, Debug)]
pub struct MatchEvidence {
    /// World point in state 0, metres.
    pub point0: Point3<f64>,
    /// World point in state 1, metres.
    pub point1: Point3<f64>,
    /// Covariance of point 0, square metres.
    pub covariance0: Matrix3<f64>,
    /// Covariance of point 1, square metres.
    pub covariance1: Matrix3<f64>,
    /// Share of an independent observation (matches of one feature in many frame pairs share one).
    pub share: f64,
}

/// All that is known about the motion of one part.
#[derive(Clone, Copy)]
pub struct MotionEvidence<'a> {
    /// Surface points of the part in each state.
    pub surfaces: [&'a SurfaceSamples; 2],
    /// Signed distance of each state's whole surface, metres.
    pub sdf: [&'a Grid3<f32>; 2],
    /// What is added to the distance of every surface point, metres, where fused surfaces lie off their readings; none where empty.
    pub offsets_m: [&'a [f64]; 2],
    /// Where each state was seen.
    pub visible: [&'a Grid3<bool>; 2],
    /// Matches on the part.
    pub matches: &'a [MatchEvidence],
    /// Area that one independent surface residual covers, square metres, and the area of each surface.
    pub independent_area_m2: f64,
    /// Area of the part's surface in each state, square metres.
    pub areas_m2: [f64; 2],
    /// Largest distance that counts, metres.
    pub reach_m: f64,
    /// Side of the blocks of the surface over which errors may run together, metres.
    pub block_m: f64,
    /// Displacement of fused surfaces that runs together over a side of the part and leaves no residual, metres, and the size
    /// of the pieces that share it, metres.
    pub displacement_m: f64,
    /// See [`Self::displacement_m`].
    pub piece_m: f64,
}

/// Quadratic model of the cost around a motion: `cost + 2 g.x + x.H x` for a left perturbation `x = (v, w)`.
#[derive(Clone, Debug)]
pub struct Quadratic {
    /// Information matrix.
    pub information: Matrix6<f64>,
    /// Half the gradient.
    pub gradient: Vector6<f64>,
    /// Robust cost in independent residuals.
    pub cost: f64,
    /// Surface points and matches that agree with the motion (within the robust scale).
    pub inliers: usize,
    /// Surface points and matches with something to say.
    pub tried: usize,
    /// Sum of squared inlier surface distances, square metres, and their number.
    pub squared_m2: f64,
    /// Number of inlier surface points.
    pub surface_inliers: usize,
    /// Independent residuals.
    pub independent: f64,
    /// Sums of the rows times residuals over blocks of the surface, by block; matches are blocks of their own.
    pub block_gradients: BTreeMap<[i64; 4], Vector6<f64>>,
    /// What a displacement of one piece of a surface adds to the gradient, by place, side and state.
    pub displaced: BTreeMap<[i64; 5], Vector6<f64>>,
}

impl Default for Quadratic {
    fn default() -> Self {
        Self {
            information: Matrix6::zeros(),
            gradient: Vector6::zeros(),
            cost: 0.0,
            inliers: 0,
            tried: 0,
            squared_m2: 0.0,
            surface_inliers: 0,
            independent: 0.0,
            block_gradients: BTreeMap::new(),
            displaced: BTreeMap::new(),
        }
    }
}

impl Quadratic {
    /// Adds one residual `r` (in standard deviations) with its row, robustly, as `share` of an observation; its weight.
    fn add(&mut self, r: f64, row: &Vector6<f64>, share: f64, scale: f64, block: [i64; 4]) -> f64 {
        let k = scale * scale;
        let u = k / (k + r * r);
        let w = share * u * u;
        self.information += row * row.transpose() * w;
        self.gradient += row * (r * w);
        *self.block_gradients.entry(block).or_default() += row * (r * w);
        self.cost += share * r * r * u;
        self.independent += share;
        w
    }

    fn merge(mut self, o: Self) -> Self {
        self.information += o.information;
        self.gradient += o.gradient;
        self.cost += o.cost;
        self.inliers += o.inliers;
        self.tried += o.tried;
        self.squared_m2 += o.squared_m2;
        self.surface_inliers += o.surface_inliers;
        self.independent += o.independent;
        for (block, gradient) in o.block_gradients {
            *self.block_gradients.entry(block).or_default() += gradient;
        }
        for (piece, gradient) in o.displaced {
            *self.displaced.entry(piece).or_default() += gradient;
        }
        self
    }

    /// Covariance of the gradient by displacements of the surfaces' pieces.
    #[must_use]
    pub fn displacements(&self) -> Matrix6<f64> {
        self.displaced.values().map(|g| g * g.transpose()).sum()
    }

    /// Factor by which the squared errors of a model's parameters exceed what independent residuals would give: the
    /// cluster-robust covariance (Liang and Zeger 1986) over blocks of the surface against the inverse information,
    /// averaged over the parameters; at least 1. Errors of a reconstructed surface that run together over a block do not
    /// average out within it. `tangent` is 6 x parameters.
    #[must_use]
    pub fn dispersion(&self, tangent: &DMatrix<f64>) -> f64 {
        let parameters = tangent.ncols();
        let blocks = self.block_gradients.len();
        let Some(covariance) = (tangent.transpose() * self.information * tangent).cholesky().map(|c| c.inverse()) else { return 1.0 };
        if blocks <= parameters {
            return 1.0;
        }
        let mut spread = DMatrix::zeros(parameters, parameters);
        for gradient in self.block_gradients.values() {
            let g = tangent.transpose() * gradient;
            spread += &g * g.transpose();
        }
        let small_sample = blocks as f64 / (blocks - parameters) as f64;
        (small_sample * (covariance * spread).trace() / parameters as f64).max(1.0)
    }

    /// Root mean square distance of the inlier surface points, metres.
    #[must_use]
    pub fn rms_m(&self) -> f64 {
        (self.squared_m2 / self.surface_inliers.max(1) as f64).sqrt()
    }
}

/// Kind of a block of matches; those of surfaces are numbered by state.
const MATCHES: i64 = 2;

/// Points per parallel task; fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 1024;

impl MotionEvidence<'_> {
    /// Robust quadratic model of the cost at a motion. `sigma_m` is the standard deviation of a surface residual.
    #[must_use]
    pub fn linearise(&self, motion: &Pose, sigma_m: f64, config: &RefineConfig) -> Quadratic {
        let mut q = Quadratic::default();
        for state in [0, 1] {
            let share = (self.areas_m2[state] / self.independent_area_m2 / self.surfaces[state].points.len().max(1) as f64).min(1.0);
            let parts: Vec<Quadratic> = self.surfaces[state]
                .points
                .par_chunks(CHUNK)
                .enumerate()
                .map(|(chunk, points)| {
                    self.linearise_surface(state, chunk * CHUNK..chunk * CHUNK + points.len(), motion, sigma_m, share, config)
                })
                .collect();
            q = parts.into_iter().fold(q, Quadratic::merge);
        }
        self.linearise_matches(&mut q, motion, config);
        q
    }

    fn linearise_surface(
        &self,
        state: usize,
        points: Range<usize>,
        motion: &Pose,
        sigma_m: f64,
        share: f64,
        config: &RefineConfig,
    ) -> Quadratic {
        let mut q = Quadratic::default();
        let warp = if state == 0 { *motion } else { motion.inverse() };
        let (sdf, visible) = (self.sdf[1 - state], self.visible[1 - state]);
        // A point without a partner costs as much as the worst partner: leaving the evidence must not pay.
        let missing = share * config.robust_sigmas * config.robust_sigmas;
        for i in points {
            let (x, n) = (&self.surfaces[state].points[i], &self.surfaces[state].normals[i]);
            let y = warp * x;
            let seen = visible.nearest(&y).is_some_and(|i| visible.values[i]);
            let (d, g) = sdf.sample_with_gradient(&y);
            let (d, g) = (f64::from(d), g.cast::<f64>());
            let norm = g.norm();
            if !seen || norm < 0.3 || d.abs() > self.reach_m {
                q.cost += missing;
                continue;
            }
            q.tried += 1;
            if g.dot(&(warp * n)) < config.normal_cosine * norm {
                q.cost += missing;
                continue;
            }
            // Towards state 1 the point moves with the perturbation; towards state 0 the perturbation acts before the
            // inverse: d(T^-1 y) = -R^T (v + w x y).
            let (lever, slope) = if state == 0 { (y.coords, g) } else { (x.coords, -(motion.rotation * g)) };
            let w = lever.cross(&slope);
            let row = Vector6::new(slope.x, slope.y, slope.z, w.x, w.y, w.z) / sigma_m;
            let d = d + self.offset_m(state, i);
            let r = d / sigma_m;
            if r.abs() < config.robust_sigmas {
                q.inliers += 1;
                q.surface_inliers += 1;
                q.squared_m2 += d * d;
            }
            let weight = q.add(r, &row, share, config.robust_sigmas, self.block(x, state as i64));
            *q.displaced.entry(self.piece(x, n, state as i64)).or_default() += row * (weight * self.displacement_m / sigma_m);
        }
        q
    }

    fn offset_m(&self, state: usize, point: usize) -> f64 {
        self.offsets_m[state].get(point).copied().unwrap_or(0.0)
    }

    /// The block of a point: states, and surfaces against matches, are kept apart by `kind`.
    fn block(&self, x: &Point3<f64>, kind: i64) -> [i64; 4] {
        let [a, b, c] = [x.x, x.y, x.z].map(|x| (x / self.block_m).floor() as i64);
        [a, b, c, kind]
    }

    /// The piece of the surface that a point is on: place, side, state.
    fn piece(&self, x: &Point3<f64>, normal: &Vector3<f64>, state: i64) -> [i64; 5] {
        let [a, b, c] = [x.x, x.y, x.z].map(|x| (x / self.piece_m).floor() as i64);
        let axis = normal.iamax();
        [a, b, c, 2 * axis as i64 + i64::from(normal[axis] > 0.0), state]
    }

    fn linearise_matches(&self, q: &mut Quadratic, motion: &Pose, config: &RefineConfig) {
        let rotation = motion.rotation.to_rotation_matrix();
        for m in self.matches {
            let y = motion * m.point0;
            let covariance = m.covariance1 + rotation.matrix() * m.covariance0 * rotation.matrix().transpose();
            let Some(whiten) = covariance.try_inverse().and_then(|i| i.cholesky()).map(|c| c.l().transpose()) else { continue };
            let residual = whiten * (m.point1 - y);
            q.tried += 1;
            let distance = residual.norm();
            q.inliers += usize::from(distance < 2.0 * config.robust_sigmas);
            // One robust weight a match: the three rows fade together.
            let k = 4.0 * config.robust_sigmas * config.robust_sigmas;
            let u = k / (k + distance * distance);
            let weight = m.share * u * u;
            let move_by = whiten;
            let turn_by = -whiten * y.coords.cross_matrix();
            let block = q.block_gradients.entry(self.block(&m.point0, MATCHES)).or_default();
            for i in 0..3 {
                let (a, b) = (move_by.row(i), turn_by.row(i));
                let row = -Vector6::new(a[0], a[1], a[2], b[0], b[1], b[2]);
                q.information += row * row.transpose() * weight;
                q.gradient += row * (residual[i] * weight);
                *block += row * (residual[i] * weight);
            }
            q.cost += m.share * distance * distance * u;
            q.independent += 3.0 * m.share;
        }
    }

    /// Standard deviation of the surface residuals at a motion, from their median absolute value, metres.
    #[must_use]
    pub fn surface_sigma_m(&self, motion: &Pose, floor_m: f64) -> f64 {
        let mut all: Vec<f64> = Vec::new();
        for state in [0, 1] {
            let warp = if state == 0 { *motion } else { motion.inverse() };
            let (sdf, visible) = (self.sdf[1 - state], self.visible[1 - state]);
            all.extend(self.surfaces[state].points.iter().enumerate().filter_map(|(i, x)| {
                let y = warp * x;
                let d = (f64::from(sdf.sample(&y)) + self.offset_m(state, i)).abs();
                (d < self.reach_m && visible.nearest(&y).is_some_and(|i| visible.values[i])).then_some(d)
            }));
        }
        if all.is_empty() {
            return floor_m.max(self.reach_m / 3.0);
        }
        let middle = all.len() / 2;
        let (_, median, _) = all.select_nth_unstable_by(middle, f64::total_cmp);
        (*median * 1.4826).max(floor_m)
    }
}

/// A family of motions with few parameters: free (6), revolute (5), prismatic (3).
pub trait MotionModel: Sized {
    /// Number of parameters.
    fn dimension(&self) -> usize;
    /// The model moved by a step of its parameters.
    fn stepped(&self, step: &DVector<f64>) -> Self;
    /// The rigid motion.
    fn motion(&self) -> Pose;

    /// Left perturbation of the motion per unit of each parameter, 6 x dimension (central differences).
    fn tangent(&self) -> DMatrix<f64> {
        const H: f64 = 1e-6;
        let n = self.dimension();
        let mut t = DMatrix::zeros(6, n);
        for k in 0..n {
            let mut e = DVector::zeros(n);
            e[k] = H;
            let plus = Self::stepped(self, &e).motion();
            let minus = Self::stepped(self, &-e).motion();
            t.column_mut(k).copy_from(&(left_difference(&plus, &minus) / (2.0 * H)));
        }
        t
    }
}

/// Left perturbation (translation 3, rotation 3) that leads from a motion to one near it.
pub(super) fn left_difference(to: &Pose, from: &Pose) -> Vector6<f64> {
    shift_and_turn(&(to * from.inverse()))
}

/// Any rigid motion.
#[derive(Clone, Copy, Debug)]
pub struct FreeMotion(pub Pose);

impl MotionModel for FreeMotion {
    fn dimension(&self) -> usize {
        6
    }

    fn stepped(&self, s: &DVector<f64>) -> Self {
        Self(Pose::from_parts(Vector3::new(s[0], s[1], s[2]).into(), exp_so3(&Vector3::new(s[3], s[4], s[5]))) * self.0)
    }

    fn motion(&self) -> Pose {
        self.0
    }
}

/// A refined motion.
#[derive(Clone, Debug)]
pub struct Refined<M> {
    /// The fitted model.
    pub model: M,
    /// Quadratic model of the cost at the end.
    pub quadratic: Quadratic,
    /// Covariance of the model's parameters; `None` where some direction is not observed.
    pub covariance: Option<DMatrix<f64>>,
    /// Standard deviation of a surface residual, metres.
    pub sigma_m: f64,
}

/// Levenberg-Marquardt over a motion model; `sigma_m` is the surface residuals' standard deviation.
#[must_use]
pub fn refine<M: MotionModel>(start: M, evidence: &MotionEvidence, sigma_m: f64, config: &RefineConfig) -> Refined<M> {
    let linearise = |model: &M| evidence.linearise(&model.motion(), sigma_m, config);
    let equations = |model: &M, q: &Quadratic| {
        let t = model.tangent();
        (t.transpose() * q.information * &t, t.transpose() * q.gradient)
    };
    let (model, q) = minimise(start, config.iterations, linearise, |q| q.cost, equations, M::stepped);
    let t = model.tangent();
    let covariance = (t.transpose() * q.information * &t).cholesky().map(|c| c.inverse());
    Refined { model, quadratic: q, covariance, sigma_m }
}

/// Levenberg-Marquardt: the model of a lower cost that steps lead to, with its linearization. `equations` gives information and
/// half the gradient in the model's parameters.
pub(super) fn minimise<M, Q>(
    mut model: M,
    iterations: usize,
    linearise: impl Fn(&M) -> Q,
    cost: impl Fn(&Q) -> f64,
    equations: impl Fn(&M, &Q) -> (DMatrix<f64>, DVector<f64>),
    stepped: impl Fn(&M, &DVector<f64>) -> M,
) -> (M, Q) {
    let mut q = linearise(&model);
    let mut damping = 1e-4;
    for _ in 0..iterations {
        let (h, g) = equations(&model, &q);
        let mut damped = h.clone();
        (0..h.nrows()).for_each(|k| damped[(k, k)] += damping * h[(k, k)] + 1e-12);
        let Some(step) = damped.cholesky().map(|c| -c.solve(&g)) else { break };
        let next = stepped(&model, &step);
        let trial = linearise(&next);
        let (before, after) = (cost(&q), cost(&trial));
        if after <= before {
            (model, q, damping) = (next, trial, damping * 0.3);
            if before - after < 1e-9 * before.max(1e-12) {
                break;
            }
        } else {
            damping *= 8.0;
            if damping > 1e8 {
                break;
            }
        }
    }
    (model, q)
}
