//! Evidence from two states for the motion of one part: surface distances and lifted matches, as robust
//! residuals of a motion. See docs/method.md (8.1).
//!
//! Residuals of a motion `T = state1_from_state0`, each divided by its standard deviation:
//! - a surface point `x` of state 0: the other state's signed distance `d1(T x)`;
//! - a surface point `y` of state 1: `d0(T^-1 y)`; both are corrected where readings lie above one surface
//!   and not above the other;
//! - a lifted match: `point1 - T point0`, whitened by the covariances of both ends.
//!
//! Rows are derivatives by a left perturbation `T <- exp(v, w) T`, i.e. `d(T x) = v + w x (T x)`. Residuals
//! are weighted down to the number of independent ones, so the information matrix is an inverse
//! covariance.

use std::ops::{Range, RangeInclusive};

use nalgebra::{Matrix3, Point3, Vector3, Vector6};
use rayon::prelude::*;

use crate::{
    joints::{
        drawn_residuals::DrawnResiduals,
        quadratic::{Block, DisplacedPatch, Quadratic, Source},
    },
    observations::SurfaceSamples,
};
use geometry::{Grid3, Pose};
use numeric::statistics::{SIGMAS_PER_MAD, median};

/// Robust scale (Geman-McClure), in standard deviations.
/// chosen: 1 % of the errors of a normal distribution are larger
pub(crate) const ROBUST_SIGMAS: f64 = 2.5;
/// Least cosine between a moved normal and the other surface's normal.
/// chosen: 60 degrees; beyond, it is another face or the back of a wall
const NORMAL_COSINE: f64 = 0.5;

/// A lifted match with the covariance of `point1 - T point0` for a motion near the current one.
#[derive(Clone, Debug)]
pub struct MatchEvidence {
    /// World point in state 0, meters.
    pub point0: Point3<f64>,
    /// World point in state 1, meters.
    pub point1: Point3<f64>,
    /// Covariance of point 0, square meters.
    pub covariance0: Matrix3<f64>,
    /// Covariance of point 1, square meters.
    pub covariance1: Matrix3<f64>,
    /// Share in an independent observation (matches of one feature in many frame pairs share one).
    pub share: f64,
}

/// All evidence for the motion of one part.
#[derive(Clone, Copy)]
pub struct MotionEvidence<'a> {
    /// Surface points of the part in each state.
    pub surfaces: [&'a SurfaceSamples; 2],
    /// Signed distance of each state's whole surface, meters.
    pub sdf: [&'a Grid3<f32>; 2],
    /// Correction of the distance of every surface point, meters, where fused surfaces lie off their
    /// readings; empty for none.
    pub offsets_m: [&'a [f64]; 2],
    /// Where each state was seen.
    pub visible: [&'a Grid3<bool>; 2],
    /// Matches on the part.
    pub matches: &'a [MatchEvidence],
    /// Area of one independent surface residual, square meters.
    pub independent_area_m2: f64,
    /// Area of the part's surface in each state, square meters.
    pub areas_m2: [f64; 2],
    /// Largest distance that counts, meters.
    pub reach_m: f64,
    /// Side of the cubic blocks within which surface errors are correlated, meters.
    pub block_m: f64,
    /// Displacement of the fused surface that a whole side of the part shares and no residual shows, meters.
    pub displacement_m: f64,
    /// Size of the patches that are displaced as one, meters.
    pub patch_m: f64,
    /// Changes of the residuals by drawn errors of poses and depth.
    pub drawn: &'a DrawnResiduals,
}

/// Plausible slopes of a signed distance near a surface. Midway between two surfaces the slope is far below
/// one. Where a state saw empty space but not the surface behind it, the field jumps from inside to outside:
/// the jump looks like a surface some millimeters in front of the true one.
///
/// chosen: between nodes a distance changes by at most its length along each axis, root 3 in all; 0.3 is
/// below one by more than noise
const SLOPES: RangeInclusive<f64> = 0.3..=1.733;

/// Points per parallel task; fixed, so sums do not depend on the number of threads.
const CHUNK: usize = 1024;

impl MotionEvidence<'_> {
    /// Robust quadratic model of the cost at a motion. `sigma_m` is the standard deviation of a surface
    /// residual.
    pub fn linearise(&self, motion: &Pose, sigma_m: f64) -> Quadratic {
        self.linearise_drawn(motion, sigma_m, 0)
    }

    /// Changes of half the gradient of [`Self::linearise`] by drawn errors of poses and depth, per draw.
    pub fn drawn_gradients(&self, motion: &Pose, sigma_m: f64) -> Vec<Vector6<f64>> {
        match self.drawn.draw_count() {
            0 => Vec::new(),
            count => self.linearise_drawn(motion, sigma_m, count).drawn,
        }
    }

    fn linearise_drawn(&self, motion: &Pose, sigma_m: f64, draws: usize) -> Quadratic {
        let mut q = Quadratic::with_draws(draws);
        for state in [0, 1] {
            let parts: Vec<Quadratic> = self.surfaces[state]
                .points
                .par_chunks(CHUNK)
                .enumerate()
                .map(|(chunk, points)| {
                    self.linearise_surface(
                        state,
                        chunk * CHUNK..chunk * CHUNK + points.len(),
                        motion,
                        sigma_m,
                        draws,
                    )
                })
                .collect();
            // Merged in the order of the chunks, as sums of floats depend on it.
            q = parts.into_iter().fold(q, Quadratic::merge);
        }
        self.linearise_matches(&mut q, motion);
        q
    }

    fn linearise_surface(
        &self,
        state: usize,
        points: Range<usize>,
        motion: &Pose,
        sigma_m: f64,
        draws: usize,
    ) -> Quadratic {
        let mut q = Quadratic::with_draws(draws);
        let source = [Source::Surface0, Source::Surface1][state];
        let warp = if state == 0 { *motion } else { motion.inverse() };
        let share = self.independent_share(state);
        // A point without a partner costs as much as the worst partner: losing evidence must not pay.
        let missing = share * ROBUST_SIGMAS * ROBUST_SIGMAS;
        for i in points {
            let x = &self.surfaces[state].points[i];
            let n = &self.surfaces[state].normals[i];
            let y = warp * x;
            let Some((d, g)) = self.signed_distance(1 - state, &y) else {
                q.cost += missing;
                continue;
            };
            q.tried += 1;
            // The back of a thin wall is as near as its front, but faces away.
            if g.dot(&(warp * n)) < NORMAL_COSINE * g.norm() {
                q.cost += missing;
                continue;
            }
            // The perturbation moves the point towards state 1; towards state 0 it acts before the inverse:
            // d(T^-1 y) = -R^T (v + w x y). docs/method.md (8.4).
            let (lever, slope) = if state == 0 { (y.coords, g) } else { (x.coords, -(motion.rotation * g)) };
            let w = lever.cross(&slope);
            // A side that poses leave open by millimeters is no outlier of the others.
            let sigma_m = sigma_m.hypot(self.drawn.variance_of_point_m2(state, i).sqrt());
            let row = Vector6::new(slope.x, slope.y, slope.z, w.x, w.y, w.z) / sigma_m;
            let d = d + self.offset_m(state, i);
            let r = d / sigma_m;
            if r.abs() < ROBUST_SIGMAS {
                q.inliers += 1;
                q.surface_inliers += 1;
                q.squared_m2 += d * d;
            }
            let weight =
                q.add_residual(r, &row, share, ROBUST_SIGMAS, Block::block_of(x, self.block_m, source));
            // The change of the gradient by a displacement of the patch, e_c of docs/method.md (8.12).
            *q.displaced.entry(DisplacedPatch::patch_of(x, n, self.patch_m, source)).or_default() +=
                row * (weight * self.displacement_m / sigma_m);
            for (sum, change_m) in q.drawn.iter_mut().zip(self.drawn.of_point(state, i)) {
                *sum += row * (weight * f64::from(*change_m) / sigma_m);
            }
        }
        q
    }

    /// Signed distance of a point from the surface of a state, meters, and its gradient; `None` where they
    /// are unknown.
    fn signed_distance(&self, state: usize, y: &Point3<f64>) -> Option<(f64, Vector3<f64>)> {
        let visible = self.visible[state];
        // Checked first, as it costs least.
        if !visible.nearest_node(y).is_some_and(|i| visible.values[i]) {
            return None;
        }
        let (d, g) = self.sdf[state].sample_with_gradient(y);
        let d = f64::from(d);
        let g = g.cast::<f64>();
        (SLOPES.contains(&g.norm()) && d.abs() <= self.reach_m).then_some((d, g))
    }

    /// Share of a sample of a state in an independent observation: samples closer than the correlation length
    /// of the errors are not independent.
    fn independent_share(&self, state: usize) -> f64 {
        let independent = self.areas_m2[state] / self.independent_area_m2;
        (independent / self.surfaces[state].points.len().max(1) as f64).min(1.0)
    }

    fn offset_m(&self, state: usize, point: usize) -> f64 {
        self.offsets_m[state].get(point).copied().unwrap_or(0.0)
    }

    fn linearise_matches(&self, q: &mut Quadratic, motion: &Pose) {
        let rotation = motion.rotation.to_rotation_matrix();
        for (number, m) in self.matches.iter().enumerate() {
            let y = motion * m.point0;
            let covariance = m.covariance1
                + rotation.matrix() * m.covariance0 * rotation.matrix().transpose()
                + self.drawn.covariance_of_match_m2(number);
            // The transposed factor of docs/method.md (8.1); it whitens the residual by the errors of both
            // ends.
            let Some(whiten) = covariance.try_inverse().and_then(|i| i.cholesky()).map(|c| c.l().transpose())
            else {
                continue;
            };
            let residual = whiten * (m.point1 - y);
            q.tried += 1;
            let distance = residual.norm();
            q.inliers += usize::from(distance < 2.0 * ROBUST_SIGMAS);
            // One robust weight per match: its three rows fade together.
            let k = 4.0 * ROBUST_SIGMAS * ROBUST_SIGMAS;
            let u = k / (k + distance * distance);
            let weight = m.share * u * u;
            let move_by = whiten;
            let turn_by = -whiten * y.coords.cross_matrix();
            let block = q
                .block_gradients
                .entry(Block::block_of(&m.point0, self.block_m, Source::Matches))
                .or_default();
            for i in 0..3 {
                let a = move_by.row(i);
                let b = turn_by.row(i);
                // The residual is the measured point less the moved one: its slope is negative.
                let row = -Vector6::new(a[0], a[1], a[2], b[0], b[1], b[2]);
                q.information += row * row.transpose() * weight;
                q.gradient += row * (residual[i] * weight);
                *block += row * (residual[i] * weight);
            }
            for (sum, change_m) in q.drawn.iter_mut().zip(self.drawn.of_match(number)) {
                let pull = whiten.transpose() * (whiten * change_m.cast::<f64>()) * weight;
                let turn = y.coords.cross(&pull);
                *sum -= Vector6::new(pull.x, pull.y, pull.z, turn.x, turn.y, turn.z);
            }
            q.cost += m.share * distance * distance * u;
            q.independent += 3.0 * m.share;
        }
    }

    /// Standard deviation of the surface residuals at a motion, from their median absolute value, meters.
    pub fn surface_sigma_m(&self, motion: &Pose, floor_m: f64) -> f64 {
        let mut all: Vec<f64> = Vec::new();
        for state in [0, 1] {
            let warp = if state == 0 { *motion } else { motion.inverse() };
            all.extend(self.surfaces[state].points.iter().enumerate().filter_map(|(i, x)| {
                let (d, _) = self.signed_distance(1 - state, &(warp * x))?;
                Some((d + self.offset_m(state, i)).abs())
            }));
        }
        // Without any partner, the scale is a third of the reach.
        median(all).map_or(self.reach_m / 3.0, |m| m * SIGMAS_PER_MAD).max(floor_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joints::free_motion::FreeFit;
    use geometry::{SceneBox, exp_so3};

    /// Half the sides of a panel, meters.
    const HALF: Vector3<f64> = Vector3::new(0.2, 0.012, 0.15);

    fn panel_distance(p: &Point3<f64>) -> f64 {
        let q = p.coords.abs() - HALF;
        q.map(|x| x.max(0.0)).norm() + q.max().min(0.0)
    }

    /// What a state shows that saw the panel's lower side, and space above it down to `empty_m` over the
    /// upper side, which it did not read: the distance from the lower side, inside below that, outside above.
    fn half_seen(p: &Point3<f64>, empty_m: f64) -> f64 {
        let above_lower_m = p.y + HALF.y;
        let over = p.x.abs() < HALF.x && p.z.abs() < HALF.z && above_lower_m > HALF.y;
        if !over {
            panel_distance(p)
        } else if p.y < HALF.y + empty_m {
            -above_lower_m
        } else {
            above_lower_m
        }
    }

    /// Both sides of the panel.
    fn sides() -> SurfaceSamples {
        let mut samples = SurfaceSamples::default();
        for (side, i) in [-1.0, 1.0].into_iter().flat_map(|s| (0..400).map(move |i| (s, i))) {
            let at = |k: i32| (f64::from(k) - 9.5) / 10.0;
            samples.points.push(Point3::new(HALF.x * at(i % 20), side * HALF.y, HALF.z * at(i / 20)));
            samples.normals.push(Vector3::y() * side);
            samples.colors.push([0.5; 3]);
        }
        samples
    }

    #[test]
    fn space_seen_empty_in_front_of_a_side_that_was_not_read_moves_nothing() {
        let scene = SceneBox::around_box(&Point3::new(-0.3, -0.3, -0.3), &Point3::new(0.3, 0.3, 0.3));
        let field = |distance: &dyn Fn(&Point3<f64>) -> f64| {
            let mut grid = Grid3::over_scene(&scene, 201, 0.0f32);
            (0..grid.values.len()).for_each(|i| grid.values[i] = distance(&grid.position_of_index(i)) as f32);
            grid
        };
        let sdf = [field(&panel_distance), field(&|p| half_seen(p, 0.004))];
        let samples = sides();
        let down: Vec<usize> = (0..samples.points.len()).filter(|&i| samples.normals[i].y < 0.0).collect();
        let lower = samples.chosen_samples(&down);
        let seen = Grid3::over_scene(&scene, 201, true);
        let drawn = DrawnResiduals::default();
        let evidence = MotionEvidence {
            surfaces: [&samples, &lower],
            sdf: [&sdf[0], &sdf[1]],
            visible: [&seen, &seen],
            matches: &[],
            independent_area_m2: 1e-3,
            areas_m2: [0.24, 0.12],
            reach_m: 0.025,
            block_m: 0.08,
            offsets_m: [&[]; 2],
            displacement_m: 0.0,
            patch_m: 0.2,
            drawn: &drawn,
        };
        let start =
            Pose::from_parts(Vector3::new(0.0, 0.003, 0.0).into(), exp_so3(&Vector3::new(0.0, 0.0, 0.01)));
        let found = FreeFit::new(&start, &evidence);
        for corner in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            let corner = Point3::new(corner.0 * HALF.x, 0.0, corner.1 * HALF.z);
            let off_m = (found.motion * corner - corner).y.abs();
            assert!(off_m < 3e-4, "{off_m} {}", found.sigma_m);
        }
    }
}
