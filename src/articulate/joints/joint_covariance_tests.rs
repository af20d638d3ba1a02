//! Covariances against docs/method.md (8.11) to (8.13), written out with the motions of all states stacked.

use nalgebra::{Point3, Unit, Vector3};

use super::*;
use crate::{
    MotionEvidence, ParentMotion, SurfaceSamples,
    joints::{
        drawn_residuals::DrawnResiduals,
        joint_fit::{JointMotion, PartPlace, Residuals},
        joint_motion::PlacedJoint,
        quadratic::{Block, DisplacedPatch, Quadratic},
        surface_draws::SurfaceDraws,
    },
};
use geometry::{Grid3, Pose};

const DISPERSION: f64 = 1.7;
const STATES: usize = 2;

/// Six numbers of no particular kind.
fn six(seed: usize) -> Vector6<f64> {
    Vector6::from_fn(|i, _| (1.0 + 1.7 * seed as f64 + 2.3 * i as f64 + 0.61 * (seed * i) as f64).sin())
}

fn parent(k: usize, draws: usize) -> ParentMotion {
    ParentMotion {
        state1_from_state0: Pose::new(
            Vector3::new(0.1, 0.02 * k as f64, -0.05),
            Vector3::new(0.1, 0.2, 0.05),
        ),
        covariance: Matrix6::from_diagonal(&six(20 + k).map(|x| 1e-6 * (1.5 + x))),
        drawn: (0..draws).map(|d| six(30 + 10 * k + d) * 1e-3).collect(),
    }
}

/// What residuals say of motion `k`: an information of full rank, blocks and patches.
fn quadratic(k: usize) -> Quadratic {
    let rows: Vec<Vector6<f64>> = (0..9).map(|i| six(100 + 10 * k + i)).collect();
    let information: Matrix6<f64> = rows.iter().map(|r| r * r.transpose()).sum();
    let at = Point3::new(0.05, 0.05, 0.05);
    let block = |source: Source| Block::block_of(&at, 0.1, source);
    Quadratic {
        information: information * 1e4,
        block_gradients: [Source::Surface0, Source::Surface1, Source::Matches]
            .into_iter()
            .enumerate()
            // Alike in both motions, as errors of state 0 make them.
            .map(|(s, source)| (block(source), six(200 + s) * (1.0 + 0.1 * k as f64)))
            .collect(),
        displaced: (0..3)
            .map(|i| {
                let at = Point3::new(0.3 * f64::from(i), 0.0, 0.0);
                (
                    DisplacedPatch::patch_of(&at, &Vector3::z(), 0.1, Source::Surface0),
                    six(50 + 5 * k + i as usize) * 3.0,
                )
            })
            .collect(),
        ..Quadratic::default()
    }
}

/// The test of a joint that was fitted to two motions of its part, whose parents moved by two draws.
fn of_joint(freedom: Freedom, positions: [f64; STATES], test: impl Fn(&JointFit, &FreeFits)) {
    let samples = SurfaceSamples::default();
    let draws = SurfaceDraws::alike(0, &[Vector3::zeros(); 2]);
    let nothing = &[draws.clone(), draws];
    let drawn = DrawnResiduals::new(nothing, [&samples, &samples], &[], &Pose::identity(), 0.1);
    let grid = |dims| Grid3 { origin: Point3::origin(), spacing_m: 1.0, dims, values: vec![0.0f32; 8] };
    let sdf = grid([2; 3]);
    let seen = Grid3 { origin: Point3::origin(), spacing_m: 1.0, dims: [2; 3], values: vec![true; 8] };
    let evidence = MotionEvidence {
        surfaces: [&samples; 2],
        sdf: [&sdf; 2],
        visible: [&seen; 2],
        matches: &[],
        independent_area_m2: 1e-3,
        areas_m2: [0.1; 2],
        reach_m: 0.05,
        block_m: 0.1,
        offsets_m: [&[]; 2],
        displacement_m: 0.0,
        patch_m: 0.1,
        drawn: &drawn,
    };
    let parents = [0, 1].map(|k| parent(k, 2));
    let motions = parents.each_ref().map(|parent| JointMotion { start: Pose::identity(), parent, evidence });
    let joint = PlacedJoint {
        freedom,
        direction: Unit::new_normalize(Vector3::new(0.2, 0.9, -0.3)),
        point: Point3::new(0.1, 0.2, 0.3),
        pitch_m_per_rad: if freedom == Freedom::Helix { 0.05 } else { 0.0 },
        positions: positions.to_vec(),
    };
    let tangents: Vec<_> =
        (0..STATES).map(|k| joint.motion_tangent(k, &parents[k].state1_from_state0)).collect();
    let quadratics: Vec<_> = (0..STATES).map(quadratic).collect();
    let information =
        tangents.iter().zip(&quadratics).fold(
            DMatrix::<f64>::zeros(joint.dimension(), joint.dimension()),
            |sum: DMatrix<f64>, (t, q)| sum + t.transpose() * q.information * t,
        );
    let inverse = information.try_inverse();
    let found = FreeFits {
        residuals: Residuals { motions: &motions, sigma_m: vec![1e-3; STATES] },
        free: Vec::new(),
        dispersion: DISPERSION,
        count: 100.0,
        place: PartPlace { middle: Point3::origin(), radius_m: 0.3 },
    };
    test(&JointFit { joint, quadratics, tangents, inverse }, &found);
}

/// Blocks along the diagonal.
fn stacked(of: impl Fn(usize) -> Matrix6<f64>) -> DMatrix<f64> {
    let mut all = DMatrix::<f64>::zeros(6 * STATES, 6 * STATES);
    (0..STATES).for_each(|k| all.fixed_view_mut::<6, 6>(6 * k, 6 * k).copy_from(&of(k)));
    all
}

/// What a fit makes of gradients of both motions, 6 rows each: `(sum B^T H B)^-1 B^T`.
struct Response {
    inverse: DMatrix<f64>,
    by_gradient: DMatrix<f64>,
    by_motion: DMatrix<f64>,
}

impl Response {
    fn of(fit: &JointFit) -> Self {
        let n = fit.joint.dimension();
        let tangents = DMatrix::from_fn(6 * STATES, n, |r, c| fit.tangents[r / 6][(r % 6, c)]);
        let information = stacked(|k| fit.quadratics[k].information);
        let inverse = (tangents.transpose() * &information * &tangents).try_inverse().unwrap();
        let by_gradient = &inverse * tangents.transpose();
        Self { by_motion: &by_gradient * information, by_gradient, inverse }
    }

    /// (8.11), of this evidence: the block of state 1 is apart in both sums.
    fn shared(&self, fit: &JointFit) -> f64 {
        let gradients = |source: usize| {
            [0, 1].map(|k| fit.tangents[k].transpose() * (six(200 + source) * (1.0 + 0.1 * k as f64)))
        };
        let square = |g: &DVector<f64>| g * g.transpose();
        let apart = |source: usize| gradients(source).iter().map(square).reduce(|a, b| a + b).unwrap();
        let joined = |source: usize| square(&(&gradients(source)[0] + &gradients(source)[1]));
        let variance = |sum: DMatrix<f64>| -> f64 {
            let robust = &self.inverse * sum * &self.inverse;
            (0..fit.joint.axis_dimension()).map(|i| robust[(i, i)] / self.inverse[(i, i)]).sum()
        };
        (variance(joined(0) + joined(2) + apart(1)) / variance(apart(0) + apart(1) + apart(2))).max(1.0)
    }

    fn own(&self, fit: &JointFit) -> DMatrix<f64> {
        let displaced = |k: usize| -> Matrix6<f64> {
            (0..3).map(|i| six(50 + 5 * k + i) * 3.0).map(|g| g * g.transpose()).sum()
        };
        &self.inverse * DISPERSION * self.shared(fit)
            + &self.by_gradient * stacked(displaced) * self.by_gradient.transpose()
    }

    fn drawn(&self, draw: usize) -> DVector<f64> {
        let of_parents = DVector::from_fn(6 * STATES, |r, _| parent(r / 6, 2).drawn[draw][r % 6]);
        -(&self.by_motion * of_parents)
    }

    fn total(&self, fit: &JointFit) -> DMatrix<f64> {
        let of_parents = stacked(|k| parent(k, 2).covariance);
        let draws = [0, 1].map(|d| self.drawn(d)).map(|d| &d * d.transpose());
        self.own(fit)
            + &self.by_motion * of_parents * self.by_motion.transpose()
            + (&draws[0] + &draws[1]) / 2.0
    }
}

fn assert_near(found: &DMatrix<f64>, expected: &DMatrix<f64>) {
    // By deviations, as radians and meters differ in size.
    let n = expected.nrows();
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let scale = (expected[(i, i)] * expected[(j, j)]).sqrt().max(1e-12);
        assert!((found[(i, j)] - expected[(i, j)]).abs() < 1e-6 * scale, "{i} {j}: {found} {expected}");
    }
}

#[test]
fn a_covariance_is_made_of_residuals_displacements_parents_and_draws() {
    for freedom in [Freedom::Slide, Freedom::Turn, Freedom::Helix] {
        of_joint(freedom, [0.4, 0.5], |fit, found| {
            let covariance = JointCovariance::new(fit, found);
            let response = Response::of(fit);
            let shared = response.shared(fit);
            assert!(shared > 1.05, "{shared}");
            assert!((covariance.dispersion / (DISPERSION * shared) - 1.0).abs() < 1e-9);
            let own = response.own(fit);
            let total = response.total(fit);
            assert_near(covariance.own.as_ref().unwrap(), &own);
            assert_near(covariance.total.as_ref().unwrap(), &total);
            for k in 0..STATES {
                let at = fit.joint.axis_dimension() + k;
                assert!((covariance.position_std(k) / total[(at, at)].sqrt() - 1.0).abs() < 1e-9);
                let t = &fit.tangents[k];
                let own: DMatrix<f64> = t * &own * t.transpose();
                let motion = own + stacked(|_| parent(k, 2).covariance).view((0, 0), (6, 6));
                let found = covariance.motion_covariance(k);
                assert_near(&DMatrix::from_fn(6, 6, |r, c| found[(r, c)]), &motion);
                for draw in 0..2 {
                    let expected = t * response.drawn(draw) + parent(k, 2).drawn[draw];
                    let found = covariance.drawn_motion(k)[draw];
                    assert!((found - Vector6::from_fn(|r, _| expected[r])).amax() < 1e-9, "{found}");
                }
                assert_eq!(covariance.drawn_motion(k).len(), 2);
            }
        });
    }
}

/// (direction, point, motion, pitch) of a joint, the axis turned round where the motion is negative.
fn axis_of(joint: &PlacedJoint, farthest: usize, sign: f64) -> DVector<f64> {
    let d = joint.direction.into_inner() * sign;
    let p = joint.point;
    let motion = joint.positions[farthest] * sign;
    DVector::from_vec(vec![d.x, d.y, d.z, p.x, p.y, p.z, motion, joint.pitch_m_per_rad])
}

#[test]
fn the_axis_has_the_covariance_that_its_parameters_give_it() {
    for freedom in [Freedom::Slide, Freedom::Turn, Freedom::Helix] {
        for (positions, farthest) in [([0.4, 0.7], 1), ([0.4, -0.7], 1), ([-0.9, 0.7], 0)] {
            of_joint(freedom, positions, |fit, found| {
                let covariance = JointCovariance::new(fit, found);
                let n = fit.joint.dimension();
                let sign = positions[farthest].signum();
                let mut slopes = DMatrix::<f64>::zeros(8, n);
                for i in 0..n {
                    let mut step = DVector::<f64>::zeros(n);
                    step[i] = 1e-6;
                    let moved =
                        [1.0, -1.0].map(|s| axis_of(&fit.joint.stepped(&(&step * s)), farthest, sign));
                    slopes.column_mut(i).copy_from(&((&moved[0] - &moved[1]) / 2e-6));
                }
                let expected = &slopes * covariance.total.as_ref().unwrap() * slopes.transpose();
                let found = covariance.axis_covariance(farthest);
                assert_near(&DMatrix::from_fn(8, 8, |r, c| found[(r, c)]), &expected);
            });
        }
    }
}

#[test]
fn what_is_not_observed_has_no_bound() {
    of_joint(Freedom::Turn, [0.4, -0.7], |fit, found| {
        let open = JointFit {
            joint: fit.joint.clone(),
            quadratics: fit.quadratics.clone(),
            tangents: fit.tangents.clone(),
            inverse: None,
        };
        let covariance = JointCovariance::new(&open, found);
        assert_eq!((covariance.dispersion, covariance.position_std(0)), (DISPERSION, f64::INFINITY));
        assert!(covariance.axis_covariance(1).iter().all(|c| *c == f64::INFINITY));
        assert!(
            covariance.motion_covariance(1) == parent(1, 2).covariance
                && covariance.drawn_motion(0).is_empty()
        );
    });
}

#[test]
fn errors_of_one_motion_are_shared_with_none() {
    of_joint(Freedom::Turn, [0.4, 0.5], |fit, _| {
        let mut alone = JointFit {
            joint: fit.joint.clone(),
            quadratics: fit.quadratics.clone(),
            tangents: fit.tangents.clone(),
            inverse: fit.inverse.clone(),
        };
        alone.quadratics[1].block_gradients.clear();
        assert!((shared_error(&alone) - 1.0).abs() < 1e-12);
        // What goes against each other in two motions makes the axis no surer.
        let turned = |q: &mut Quadratic| q.block_gradients.values_mut().for_each(|g| *g = -*g);
        let mut opposed = JointFit { quadratics: fit.quadratics.clone(), ..alone };
        turned(&mut opposed.quadratics[1]);
        assert_eq!(shared_error(&opposed), 1.0);
        opposed.quadratics.iter_mut().for_each(|q| q.block_gradients.clear());
        assert_eq!(shared_error(&opposed), 1.0);
    });
}
