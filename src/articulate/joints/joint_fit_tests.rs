//! Fits to matches alone, of which the information is known in closed form.

use nalgebra::{Matrix3, Matrix6xX, Unit, Vector3};

use super::*;
use crate::{
    MatchEvidence, SurfaceSamples,
    joints::{
        drawn_residuals::DrawnResiduals, free_motion::free_motion, joint_motion::Freedom,
        surface_draws::SurfaceDraws,
    },
};
use geometry::{Grid3, Screw};

/// Variance of every coordinate of both ends of a match.
const VARIANCE_M2: f64 = 1e-6;
const PLACE: PartPlace = PartPlace { middle: Point3::new(0.3, 0.1, -0.2), radius_m: 0.4 };

/// Corners of a box, of which the other state shows where some motions take them, a little off.
fn matches(motion: &Pose, error_m: f64, count: usize) -> Vec<MatchEvidence> {
    let corner = |i: usize| {
        let side = |bit: usize| if i >> bit & 1 == 1 { 0.5 } else { -0.3 };
        Point3::new(0.3 + 0.4 * side(0), 0.1 + 0.3 * side(1), -0.2 + 0.5 * side(2))
    };
    let of = |i: usize| {
        let error = Vector3::from_fn(|k, _| (2.3 * (i * 3 + k) as f64).sin()) * error_m;
        MatchEvidence {
            point0: corner(i),
            point1: motion * corner(i) + error,
            covariance0: Matrix3::identity() * VARIANCE_M2,
            covariance1: Matrix3::identity() * VARIANCE_M2,
            share: 1.0,
        }
    };
    (0..count).map(of).collect()
}

/// What surrounds matches in evidence without any surface.
struct Empty {
    samples: SurfaceSamples,
    sdf: Grid3<f32>,
    seen: Grid3<bool>,
    drawn: DrawnResiduals,
}

impl Empty {
    /// With so many draws, all of which displace the other end of each of some matches by `draws`.
    fn new(matches: &[MatchEvidence], draws: &[Vector3<f32>]) -> Self {
        let grid =
            |spacing_m| Grid3 { origin: Point3::origin(), spacing_m, dims: [2; 3], values: vec![true; 8] };
        let sdf = Grid3 { origin: Point3::origin(), spacing_m: 1.0, dims: [2; 3], values: vec![0.0; 8] };
        let ends: Vec<[Point3<f64>; 2]> = matches.iter().map(|m| [m.point0, m.point1]).collect();
        let points = |state: usize| SurfaceSamples {
            points: ends.iter().map(|e| e[state]).collect(),
            normals: vec![Vector3::z(); ends.len()],
            colors: vec![[0.5; 3]; ends.len()],
        };
        let still = vec![Vector3::zeros(); draws.len()];
        let both = [SurfaceDraws::alike(ends.len(), &still), SurfaceDraws::alike(ends.len(), draws)];
        let first = points(0);
        let second = points(1);
        let drawn = DrawnResiduals::new(&both, [&first, &second], &ends, &Pose::identity(), 0.01);
        Self { samples: SurfaceSamples::default(), sdf, seen: grid(1.0), drawn }
    }

    fn evidence<'a>(&'a self, matches: &'a [MatchEvidence]) -> MotionEvidence<'a> {
        MotionEvidence {
            surfaces: [&self.samples; 2],
            sdf: [&self.sdf; 2],
            visible: [&self.seen; 2],
            matches,
            independent_area_m2: 1e-3,
            areas_m2: [0.1; 2],
            reach_m: 0.06,
            // One block a corner.
            block_m: 0.05,
            offsets_m: [&[]; 2],
            displacement_m: 0.0,
            patch_m: 0.1,
            drawn: &self.drawn,
        }
    }
}

pub fn direction() -> Unit<Vector3<f64>> {
    Unit::new_normalize(Vector3::new(0.2, 0.9, -0.3))
}

pub fn screw(angle_rad: f64, advance_m: f64) -> Pose {
    Screw { direction: direction(), point: Point3::new(0.1, 0.0, 0.3), angle_rad, advance_m }.to_motion()
}

/// The test of the fits of a part that moved so on parents that moved themselves.
pub fn of_motions(relative: &[Pose], errors_m: &[f64], draws: usize, test: impl Fn(&FreeFits, &[Pose])) {
    let parents: Vec<ParentMotion> = (0..relative.len())
        .map(|k| ParentMotion {
            state1_from_state0: Pose::new(
                Vector3::new(0.1, 0.02 * k as f64, 0.0),
                Vector3::new(0.1, 0.2, 0.0),
            ),
            covariance: Matrix6::identity() * 1e-6,
            drawn: (0..draws).map(|d| Vector6::from_fn(|i, _| 1e-3 * (i + d + k) as f64)).collect(),
        })
        .collect();
    let world: Vec<Pose> = relative.iter().zip(&parents).map(|(m, p)| p.state1_from_state0 * m).collect();
    let all: Vec<Vec<MatchEvidence>> =
        world.iter().zip(errors_m).map(|(m, error_m)| matches(m, *error_m, 8)).collect();
    let shift = vec![Vector3::new(0.0, 0.0, 2e-3); draws];
    let around: Vec<Empty> = all.iter().map(|m| Empty::new(m, &shift)).collect();
    let off = Pose::new(Vector3::new(0.002, -0.001, 0.001), Vector3::new(0.003, 0.001, -0.002));
    let motions: Vec<JointMotion> = (0..relative.len())
        .map(|k| JointMotion {
            start: off * world[k],
            parent: &parents[k],
            evidence: around[k].evidence(&all[k]),
        })
        .collect();
    test(&FreeFits::new(&motions, PLACE), &world);
}

/// Information of a motion by the matches alone: of each the identity and a turn about the origin, by the
/// variances of both ends and the covariance of what poses leave open.
fn information(motion: &Pose, open_m2: &Matrix3<f64>) -> Matrix6<f64> {
    let covariance = Matrix3::identity() * (2.0 * VARIANCE_M2) + open_m2;
    let inverse = covariance.try_inverse().expect("both ends have variances");
    let rows: Vec<Matrix6xX<f64>> = matches(motion, 0.0, 8)
        .iter()
        .map(|m| {
            let mut rows = Matrix6xX::zeros(3);
            rows.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
            rows.fixed_view_mut::<3, 3>(3, 0).copy_from(&m.point1.coords.cross_matrix());
            rows
        })
        .collect();
    rows.iter().map(|r| r * inverse * r.transpose()).sum()
}

#[test]
fn free_motions_are_found_and_weighed_by_what_bears_them_out() {
    let relative = [screw(0.4, 0.0), screw(-0.2, 0.01)];
    of_motions(&relative, &[0.004, 0.0], 0, |found, world| {
        // Errors of one motion make its own scale, and count by its residuals in that of all.
        let [first, second] = &found.free[..] else { panic!("two motions") };
        assert!(first.dispersion > 2.0 && (second.dispersion - 1.0).abs() < 1e-6, "{}", first.dispersion);
        assert_eq!((first.independent_residuals(), second.independent_residuals()), (24.0, 24.0));
        let expected = 0.5 * (first.dispersion + second.dispersion);
        assert!((found.dispersion - expected).abs() < 1e-9);
        assert!((found.count - 48.0 / expected).abs() < 1e-9);
        let off = second.motion * world[1].inverse();
        assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-9, "{off}");
        let off = found.relative_motion(1) * relative[1].inverse();
        assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-9, "{off}");
        // Without a surface, three deviations fit into the reach.
        assert!((second.sigma_m - 0.02).abs() < 1e-12, "{}", second.sigma_m);
        assert_eq!(found.place.radius_m, PLACE.radius_m);
    });
    // Where no match is, at least two readings count.
    let one = matches(&screw(0.4, 0.0), 0.0, 1);
    let around = Empty::new(&one, &[]);
    let still = ParentMotion::static_part();
    let motion = JointMotion { start: screw(0.4, 0.0), parent: &still, evidence: around.evidence(&[]) };
    let motions = [motion];
    let found = FreeFits::new(&motions, PLACE);
    assert_eq!((found.free[0].independent_residuals(), found.count), (2.0, 2.0));
}

#[test]
fn a_free_motion_is_known_as_well_as_its_matches() {
    let motion = screw(0.4, 0.01);
    let eight = matches(&motion, 0.0, 8);
    let draws = [Vector3::new(2e-3, 0.0, 0.0), Vector3::new(0.0, 0.0, -1e-3)];
    let around = Empty::new(&eight, &draws);
    let found = free_motion(&motion, &around.evidence(&eight));
    let open_m2 = Matrix3::from_diagonal(&Vector3::new(2e-6, 0.0, 0.5e-6));
    let expected = information(&motion, &open_m2).try_inverse().unwrap();
    assert!((found.covariance - expected).amax() < 1e-6 * expected.amax(), "{}", found.covariance);
    // Where every match of the other state is displaced, so is the motion, without a turn.
    assert_eq!(found.drawn.len(), 2);
    for (drawn, draw) in found.drawn.iter().zip(draws) {
        let shift = Vector6::new(f64::from(draw.x), f64::from(draw.y), f64::from(draw.z), 0.0, 0.0, 0.0);
        assert!((drawn - shift).amax() < 1e-6, "{drawn} {draw}");
    }
    assert_eq!(
        (found.drawn_perturbation(1), found.drawn_perturbation(2)),
        (found.drawn[1], Vector6::zeros())
    );
    // Errors beyond the stated ones widen it.
    let rough = matches(&motion, 0.004, 8);
    let around = Empty::new(&rough, &[]);
    let evidence = around.evidence(&rough);
    let fit = FreeFit::new(&motion, &evidence);
    let wide = free_motion(&motion, &evidence).covariance;
    let alone = fit.quadratic.information.try_inverse().unwrap();
    assert!(fit.dispersion > 2.0 && (wide - alone * fit.dispersion).amax() < 1e-6 * wide.amax(), "{wide}");
    // Without a match nothing is observed.
    let none = free_motion(&motion, &around.evidence(&[]));
    assert!(none.covariance == Matrix6::zeros() && none.drawn.is_empty());
    let still = ParentMotion::static_part();
    assert!(still.state1_from_state0 == Pose::identity() && still.covariance == Matrix6::zeros());
}

#[test]
fn one_joint_is_fitted_to_all_motions() {
    let relative = [screw(0.4, 0.0), screw(-0.25, 0.0)];
    of_motions(&relative, &[0.0; 2], 0, |found, world| {
        let turn = found.fitted_turn().unwrap();
        assert!(turn.joint.freedom == Freedom::Turn && turn.joint.direction.angle(&direction()) < 1e-6);
        assert!(
            (turn.joint.positions[0] - 0.4).abs() < 1e-6 && (turn.joint.positions[1] + 0.25).abs() < 1e-6
        );
        assert!(turn.cost() < 1e-6, "{}", turn.cost());
        // Its information is that of both motions in its parameters.
        let expected = (0..2).fold(DMatrix::<f64>::zeros(6, 6), |sum: DMatrix<f64>, k: usize| {
            let tangent = turn.joint.motion_tangent(k, &found.parent_motion(k).state1_from_state0);
            sum + tangent.transpose() * information(&world[k], &Matrix3::zeros()) * tangent
        });
        let inverse = turn.inverse.as_ref().unwrap();
        assert!(
            (inverse * &expected - DMatrix::<f64>::identity(6, 6)).amax() < 1e-4,
            "{}",
            inverse * expected
        );
        assert!(turn.tangents.len() == 2 && turn.quadratics.len() == 2);
        // A slide explains neither; a helix both, without a thread.
        let costs = |fit: &JointFit| fit.quadratics.iter().map(|q| q.cost).sum::<f64>();
        let slide = found.fitted_slide();
        assert!(slide.cost() == costs(&slide) && slide.cost() > 50.0, "{}", slide.cost());
        let helix = found.fitted_helix().unwrap();
        assert!(helix.cost() < 1e-6 && helix.joint.pitch_m_per_rad.abs() < 1e-6);
    });
    // A thread, and motions that do not turn.
    of_motions(&[screw(0.5, 0.02), screw(-0.25, -0.01)], &[0.0; 2], 0, |found, _| {
        let helix = found.fitted_helix().unwrap();
        assert!((helix.joint.pitch_m_per_rad - 0.04).abs() < 1e-6 && helix.cost() < 1e-6);
        assert!(found.fitted_turn().unwrap().cost() > 10.0);
    });
    of_motions(&[screw(0.0, 0.1), screw(0.0, -0.05)], &[0.0; 2], 0, |found, _| {
        let slide = found.fitted_slide();
        assert!(
            slide.joint.direction.angle(&direction()) < 1e-6
                || slide.joint.direction.angle(&-direction()) < 1e-6
        );
        assert!(
            slide.cost() < 1e-6 && (slide.joint.positions[0] + 2.0 * slide.joint.positions[1]).abs() < 1e-6
        );
        assert!(found.fitted_turn().is_none() && found.fitted_helix().is_none());
    });
}

#[test]
fn what_is_held_stays_and_the_rest_suits_it() {
    of_motions(&[screw(0.4, 0.0), screw(-0.25, 0.0)], &[0.0; 2], 0, |found, _| {
        let best = found.fitted_turn().unwrap();
        let mut start = best.joint.clone();
        start.direction = Unit::new_normalize(direction().into_inner() + Vector3::x() * 0.01);
        start.positions[0] += 0.05;
        let held = found.residuals.fitted_joint(start.clone(), 2);
        assert_eq!(held.joint.direction, start.direction);
        // Nothing near it with this direction costs less.
        for i in 2..6 {
            for by in [1e-4, -1e-4] {
                let mut step = DVector::<f64>::zeros(6);
                step[i] = by;
                let other = held.joint.stepped(&step);
                let cost: f64 = found.residuals.at_joint(&other).iter().map(|q| q.cost).sum();
                assert!(cost > held.cost(), "{i} {by}");
            }
        }
        assert!((held.joint.positions[0] - 0.4).abs() < 0.01 && held.cost() > best.cost() + 1.0);
        assert_eq!(held.inverse.unwrap().nrows(), 6);
        let free = found.residuals.fitted_joint(start, 0);
        assert!(free.joint.direction.angle(&direction()) < 1e-6);
    });
}

#[test]
fn errors_of_poses_pull_by_residuals_and_by_parents() {
    of_motions(&[screw(0.4, 0.0)], &[0.0], 3, |found, world| {
        let open_m2 = Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, 4e-6));
        let information = information(&world[0], &open_m2);
        let drawn = found.drawn_gradients(0, &world[0], &information);
        assert_eq!(drawn.len(), 3);
        // Matches lie 2 mm further along z than the motion, which does so with a gradient against it.
        let shifted = Vector6::new(0.0, 0.0, -2e-3, 0.0, 0.0, 0.0);
        for (draw, gradient) in drawn.iter().enumerate() {
            let expected = information * (shifted + found.parent_motion(0).drawn[draw]);
            assert!((gradient - expected).amax() < 1e-3 * expected.amax(), "{gradient} {expected}");
        }
    });
}

#[test]
fn normal_equations_add_up_over_motions() {
    let tangent =
        |k: usize| DMatrix::from_fn(6, 3, |r, c| (1.0 + r as f64 * 1.7 + (c * (k + 2)) as f64).sin());
    let quadratic = |k: usize| Quadratic {
        information: Matrix6::from_diagonal(&Vector6::from_fn(|r, _| (r + k + 1) as f64)),
        gradient: Vector6::from_fn(|r, _| (r * r) as f64 - k as f64),
        ..Quadratic::default()
    };
    let (h, g) = normal_equations(&[tangent(0), tangent(1)], &[quadratic(0), quadratic(1)]);
    let sum = |i: usize, j: usize| -> f64 {
        (0..2)
            .map(|k| {
                (0..6).map(|r| tangent(k)[(r, i)] * (r + k + 1) as f64 * tangent(k)[(r, j)]).sum::<f64>()
            })
            .sum()
    };
    let slope = |i: usize| -> f64 {
        (0..2).map(|k| (0..6).map(|r| tangent(k)[(r, i)] * ((r * r) as f64 - k as f64)).sum::<f64>()).sum()
    };
    for i in 0..3 {
        assert!((g[i] - slope(i)).abs() < 1e-9);
        assert!((0..3).all(|j| (h[(i, j)] - sum(i, j)).abs() < 1e-9));
    }
    assert_eq!(normal_equations(&[], &[]).0.nrows(), 0);
}
