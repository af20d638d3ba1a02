//! Refines motions with the surfaces of both states and the lifted matches: robust point-to-plane
//! Gauss-Newton. See docs/method.md (6.9).

use nalgebra::{Matrix6, Point3, Vector3, Vector6};
use rayon::prelude::*;

use crate::{observations::LiftedMatch, pair::surface_pair::SurfacePair};
use geometry::{Pose, exp_so3};

/// Surface residuals beyond this many standard deviations lose their weight (Geman-McClure).
/// derived: nine tenths of the efficiency of least squares where errors are normal
const SURFACE_SIGMAS: f64 = 2.9;
/// Match residuals beyond this many standard deviations lose their weight (Geman-McClure); the limit is lower
/// because more of them are wrong.
/// tuned: shared/bags
const MATCH_SIGMAS: f64 = 2.0;
/// Number of samples that count as one: on a smooth surface their errors are correlated.
/// tuned: shared/bags
pub(crate) const SAMPLES_PER_READING: f64 = 12.0;
/// Number of Gauss-Newton steps for one set of correspondences.
const STEPS: usize = 3;
/// Damping relative to the mean diagonal: it holds unobserved directions.
/// chosen: too small to move an observed direction
const DAMPING: f64 = 1e-5;

/// A residual `normal . (point - T source)` in the frame of state 1, or its three components for a match.
pub(crate) struct Correspondence {
    /// Point of state 0, to be moved.
    pub source: Point3<f64>,
    /// The point in state 1 to which it should move.
    pub target: Point3<f64>,
    /// Surface normal, in the frame of state 1 or, where `normal_moves`, of state 0.
    pub normal: Vector3<f64>,
    pub normal_moves: bool,
}

/// A correspondence under a motion, in the frame of state 1.
pub(crate) struct MovedCorrespondence {
    /// The moved source point.
    pub point: Point3<f64>,
    pub normal: Vector3<f64>,
    /// Distance of the moved point from the plane, meters.
    pub residual_m: f64,
}

impl Correspondence {
    pub(crate) fn under(&self, motion: &Pose) -> MovedCorrespondence {
        let point = motion * self.source;
        let normal = if self.normal_moves { motion * self.normal } else { self.normal };
        MovedCorrespondence { point, normal, residual_m: normal.dot(&(point - self.target)) }
    }
}

/// Correspondences of the samples with the label of a motion, from both states.
pub(crate) fn correspondences(
    pair: &SurfacePair<'_>,
    labels: [&[u8]; 2],
    motion: &Pose,
    label: u8,
) -> Vec<Correspondence> {
    let mut all = Vec::new();
    for state in 0..2 {
        let these = pair.samples[state];
        let others = pair.samples[1 - state];
        let other_from_this = if state == 0 { *motion } else { motion.inverse() };
        let found: Vec<Correspondence> = (0..these.points.len())
            .into_par_iter()
            .filter(|&i| labels[state][i] == label)
            .filter_map(|i| {
                let point = these.points[i];
                let j = pair.moved_and_nearest(state, i, &other_from_this).1?;
                // A sample of another part is not a partner.
                if labels[1 - state][j] != label {
                    return None;
                }
                Some(if state == 0 {
                    Correspondence {
                        source: point,
                        target: others.points[j],
                        normal: others.normals[j],
                        normal_moves: false,
                    }
                } else {
                    Correspondence {
                        source: others.points[j],
                        target: point,
                        normal: others.normals[j],
                        normal_moves: true,
                    }
                })
            })
            .collect();
        all.extend(found);
    }
    all
}

/// Normal equations of a small motion about a center.
struct System {
    center: Point3<f64>,
    matrix: Matrix6<f64>,
    right: Vector6<f64>,
}

impl System {
    /// Adds `weight * (residual + jacobian . step)^2` with the jacobian of `normal . (T' p - q)` by a left
    /// step (rotation, translation) of a point moved to `moved`.
    fn add(&mut self, moved: &Point3<f64>, normal: &Vector3<f64>, residual: f64, weight: f64) {
        let turn = (moved - self.center).cross(normal);
        let row = Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z);
        self.matrix += row * row.transpose() * weight;
        self.right -= row * (residual * weight);
    }

    /// The motion after the minimizing step.
    fn stepped_motion(mut self, motion: &Pose) -> Option<Pose> {
        let damping = DAMPING * self.matrix.diagonal().mean();
        (0..6).for_each(|k| self.matrix[(k, k)] += damping);
        let x = self.matrix.cholesky()?.solve(&self.right);
        Some(
            small_motion(
                &self.center,
                &x.fixed_rows::<3>(0).into_owned(),
                &x.fixed_rows::<3>(3).into_owned(),
            ) * motion,
        )
    }
}

/// The small motion that turns by a rotation vector about a center and then shifts.
pub(crate) fn small_motion(center: &Point3<f64>, turn: &Vector3<f64>, shift_m: &Vector3<f64>) -> Pose {
    let rotation = exp_so3(turn);
    Pose::from_parts((center.coords - rotation * center.coords + shift_m).into(), rotation)
}

/// Refines one motion. `pair` gives the standard deviations of the residuals, `matches` are those of the
/// motion. Returns the motion unchanged if too little supports it.
pub(crate) fn refined_motion(
    pair: &SurfacePair<'_>,
    labels: [&[u8]; 2],
    matches: &[LiftedMatch],
    motion: &Pose,
    label: u8,
) -> Pose {
    let planes = correspondences(pair, labels, motion, label);
    // There are six unknowns, and each of these gives at least one equation.
    if planes.len() + matches.len() < 6 {
        return *motion;
    }
    let mut motion = *motion;
    for _ in 0..STEPS {
        // About the middle, turn and shift are nearly independent, so damping affects both alike.
        let sum: Vector3<f64> =
            planes.iter().map(|p| p.target.coords).chain(matches.iter().map(|m| m.point1.coords)).sum();
        let center = Point3::from(sum / (planes.len() + matches.len()) as f64);
        let mut system = System { center, matrix: Matrix6::zeros(), right: Vector6::zeros() };
        let sigma = pair.scales.plane_m;
        for p in &planes {
            let MovedCorrespondence { point, normal, residual_m } = p.under(&motion);
            let z = residual_m / (SURFACE_SIGMAS * sigma);
            // The weight of docs/method.md (1.5), divided by the number of samples with correlated errors.
            let weight = (sigma * (1.0 + z * z)).powi(-2) / SAMPLES_PER_READING;
            // Where the normal moves with the source, `R n . (T p - q)` turns with the target point.
            system.add(if p.normal_moves { &p.target } else { &point }, &normal, residual_m, weight);
        }
        for m in matches {
            let moved = motion * m.point0;
            let offset = moved - m.point1;
            let z = offset.norm() / (MATCH_SIGMAS * m.sigma_m);
            let weight = (m.sigma_m * (1.0 + z * z)).powi(-2);
            // A match fixes all three components: three planes along the axes.
            for k in 0..3 {
                system.add(&moved, &Vector3::ith(k, 1.0), offset[k], weight);
            }
        }
        match system.stepped_motion(&motion) {
            Some(next) => motion = next,
            None => break,
        }
    }
    motion
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        pair::surface_pair::SurfacePair,
        samples::synthetic::{Scene, camera_ring},
    };

    #[test]
    fn a_disturbed_motion_returns_to_the_truth_on_surfaces_alone() {
        let cameras = camera_ring(10);
        let scene = Scene::box_with_lid_and_drawer();
        let (s0, t0) = scene.surface(0, &cameras, 0.008);
        let (s1, t1) = scene.surface(1, &cameras, 0.008);
        let pair = SurfacePair::new([&s0, &s1], [None, None], 0.025);
        let truth = scene.truth(1);
        let mut motion =
            Pose::new(Vector3::new(0.003, -0.002, 0.003), Vector3::new(0.01, 0.005, -0.01)) * truth;
        for _ in 0..15 {
            motion = refined_motion(&pair, [&t0, &t1], &[], &motion, 1);
        }
        let corner = Point3::new(0.2, -0.15, 0.23);
        assert!(
            (motion * corner - truth * corner).norm() < 5e-4,
            "{}",
            (motion * corner - truth * corner).norm()
        );
        assert!(motion.rotation.angle_to(&truth.rotation) < 2e-3);
    }

    #[test]
    fn the_jacobian_is_that_of_the_residual() {
        let motion = Pose::new(Vector3::new(0.1, 0.2, -0.3), Vector3::new(0.4, -0.2, 0.7));
        let center = Point3::new(0.3, 0.1, 0.2);
        let p = Point3::new(0.5, -0.2, 0.3);
        let q = Point3::new(0.4, 0.3, 0.1);
        let n = Vector3::new(0.3, 0.5, 0.8).normalize();
        for moves in [false, true] {
            let residual = |m: &Pose| if moves { (m * n).dot(&(m * p - q)) } else { n.dot(&(m * p - q)) };
            let normal = if moves { motion * n } else { n };
            let moved = motion * p;
            let mut system = System { center, matrix: Matrix6::zeros(), right: Vector6::zeros() };
            system.add(if moves { &q } else { &moved }, &normal, -1.0, 1.0);
            for k in 0..6 {
                let step = |h: f64| {
                    let rotation = exp_so3(&Vector3::from_fn(|i, _| if i == k { h } else { 0.0 }));
                    let shift = Vector3::from_fn(|i, _| if i + 3 == k { h } else { 0.0 });
                    Pose::from_parts((center.coords - rotation * center.coords + shift).into(), rotation)
                        * motion
                };
                let numeric = (residual(&step(1e-6)) - residual(&step(-1e-6))) / 2e-6;
                assert!(
                    (system.right[k] - numeric).abs() < 1e-8,
                    "{k} {moves}: {} {numeric}",
                    system.right[k]
                );
            }
        }
    }
}
