//! Parts of an estimate by hand-made fits.

use nalgebra::{Point3, Unit, Vector3};

use super::*;
use crate::joints::{
    joint_fit::tests::{direction, of_motions, screw},
    quadratic::Quadratic,
};

const PLACE: PartPlace = PartPlace { middle: Point3::new(1.0, 2.0, 3.0), radius_m: 0.2 };

fn joint(freedom: Freedom, off_m: f64) -> PlacedJoint {
    PlacedJoint {
        freedom,
        direction: Unit::new_normalize(Vector3::new(0.0, 0.6, 0.8)),
        point: Point3::new(1.0 + off_m, 2.0 + 0.6, 3.0 + 0.8),
        pitch_m_per_rad: 0.03,
        positions: vec![0.1],
    }
}

#[test]
fn a_screw_beside_its_part_is_a_free_motion() {
    let of = |freedom: Freedom, off_m: f64| kind_of(&joint(freedom, off_m), &PLACE);
    assert_eq!(of(Freedom::Slide, 0.5), JointKind::Prismatic);
    assert_eq!(of(Freedom::Turn, 0.5), JointKind::Revolute);
    // The point of the axis nearest to the part's middle decides, wherever the axis is given.
    assert_eq!(of(Freedom::Helix, 0.19), JointKind::Screw { pitch_m_per_rad: 0.03 });
    assert_eq!(of(Freedom::Helix, -0.19), JointKind::Screw { pitch_m_per_rad: 0.03 });
    assert_eq!(of(Freedom::Helix, 0.21), JointKind::Free { pitch_m_per_rad: 0.03 });
}

#[test]
fn residuals_are_a_mean_over_the_points_of_all_motions() {
    let of = |each: &[(f64, usize)]| {
        let quadratics = each
            .iter()
            .map(|&(squared_m2, surface_inliers)| Quadratic {
                squared_m2,
                surface_inliers,
                ..Quadratic::default()
            })
            .collect();
        let joint = joint(Freedom::Turn, 0.0);
        residual_rms_m(&JointFit { joint, quadratics, tangents: Vec::new(), inverse: None })
    };
    assert!((of(&[(1e-4, 30), (3e-4, 70)]) - 2e-3).abs() < 1e-12);
    assert_eq!(of(&[(0.0, 0)]), 0.0);
}

#[test]
fn a_joint_is_the_same_from_either_sense_of_its_axis() {
    of_motions(&[screw(0.2, 0.0), screw(-0.5, 0.0)], &[0.0; 2], 0, |found, _| {
        let mut along = found.fitted_turn().unwrap().joint;
        // The farthest motion, the second, is positive about the axis the other way round.
        if along.direction.dot(&direction()) < 0.0 {
            along.direction = -along.direction;
            along.positions.iter_mut().for_each(|q| *q = -*q);
        }
        let mut against = along.clone();
        against.direction = -along.direction;
        against.positions.iter_mut().for_each(|q| *q = -*q);
        let [a, b] = [along, against]
            .map(|joint| estimate(found, &found.residuals.fitted_joint(joint, 0), TypeScores::default()));
        for joint in [&a, &b] {
            assert!(joint.axis.angle(&-direction()) < 1e-6, "{:?}", joint.axis);
            assert!((joint.positions[0] + 0.2).abs() < 1e-6 && (joint.positions[1] - 0.5).abs() < 1e-6);
            assert_eq!(joint.kind, JointKind::Revolute);
            // State 0 and two more.
            let open = not_observable(JointKind::Revolute, 3).into_iter().map(JointRemark::from);
            assert_eq!(joint.evidence.not_observable, open.collect::<Vec<_>>());
        }
        let size = a.evidence.covariance.amax();
        assert!((a.evidence.covariance - b.evidence.covariance).amax() < 1e-6 * size);
        assert!((a.motions[1].to_homogeneous() - b.motions[1].to_homogeneous()).amax() < 1e-9);
    });
}
