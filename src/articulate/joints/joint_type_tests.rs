//! Choices of type by hand-made scores.

use nalgebra::{Point3, Vector3};

use super::*;

fn scores(of: &[(JointFamily, f64)]) -> TypeScores {
    of.iter().copied().collect()
}

fn joint(freedom: Freedom, off_m: f64) -> PlacedJoint {
    PlacedJoint {
        freedom,
        direction: Vector3::z_axis(),
        point: Point3::new(1.0 + off_m, 2.0, 7.0),
        pitch_m_per_rad: 0.0,
        positions: vec![0.1],
    }
}

const PLACE: PartPlace = PartPlace { middle: Point3::new(1.0, 2.0, 3.0), radius_m: 0.2 };

#[test]
fn the_lowest_score_wins_and_a_screw_only_decisively() {
    let of = |slide: f64, turn: f64, screw: f64| {
        best_type(&scores(&[
            (JointFamily::Prismatic, slide),
            (JointFamily::Revolute, turn),
            (JointFamily::Screw, screw),
            (JointFamily::Free, 0.0),
        ]))
    };
    assert_eq!(of(50.0, 60.0, 45.0), JointFamily::Prismatic);
    assert_eq!(of(60.0, 50.0, 45.0), JointFamily::Revolute);
    // Better than both by more than very strong evidence, twice a log likelihood of 5.
    assert_eq!(of(60.0, 50.0, 39.5), JointFamily::Screw);
    assert_eq!(of(60.0, 50.0, 40.5), JointFamily::Revolute);
    assert_eq!(of(50.0, 60.0, 39.5), JointFamily::Screw);
    assert_eq!(of(60.0, 50.0, 40.0), JointFamily::Revolute);
    // A slide, which has fewer parameters, where both are as good.
    assert_eq!(of(50.0, 50.0, 50.0), JointFamily::Prismatic);
    assert_eq!(best_type(&scores(&[(JointFamily::Prismatic, 5.0)])), JointFamily::Prismatic);
}

#[test]
fn the_excess_is_that_of_the_best_joint_over_the_free_motion() {
    let of = |slide: f64, turn: f64, screw: f64| {
        scores(&[
            (JointFamily::Prismatic, slide),
            (JointFamily::Revolute, turn),
            (JointFamily::Screw, screw),
            (JointFamily::Free, 20.0),
        ])
    };
    assert_eq!(excess_over_free(&of(60.0, 50.0, 90.0), true), 30.0);
    assert_eq!(excess_over_free(&of(50.0, 60.0, 90.0), true), 30.0);
    // A screw pays what it must in the choice, and counts where it is threaded alone.
    assert_eq!(excess_over_free(&of(60.0, 50.0, 25.0), true), 15.0);
    assert_eq!(excess_over_free(&of(60.0, 50.0, 25.0), false), 30.0);
}

#[test]
fn an_axis_far_from_its_part_pays_by_a_student_distribution() {
    // Twice a radius off: -2 ln of the density (1 + r^2 / (2 s^2))^-2 with s^2 = 2 radii^2, in the plane.
    let by = |off: f64| 4.0 * (1.0 + (off / 0.4).powi(2)).ln();
    for freedom in [Freedom::Turn, Freedom::Helix] {
        for off in [0.0, 0.1, 0.4, 3.0] {
            let found = far(&joint(freedom, off), &PLACE);
            assert!((found - by(off)).abs() < 1e-9, "{off} {found}");
        }
    }
    assert_eq!(far(&joint(Freedom::Slide, 3.0), &PLACE), 0.0);
}

fn fit(freedom: Freedom) -> JointFit {
    JointFit { joint: joint(freedom, 0.0), quadratics: Vec::new(), tangents: Vec::new(), inverse: None }
}

#[test]
fn a_kind_that_is_known_is_taken_where_it_was_fitted() {
    let fits = |all: bool| TypeFits {
        slide: fit(Freedom::Slide),
        turn: all.then(|| fit(Freedom::Turn)),
        helix: all.then(|| fit(Freedom::Helix)),
        scores: scores(&[(JointFamily::Prismatic, 50.0), (JointFamily::Revolute, 40.0)]),
    };
    let chosen = |all: bool, kind: Option<JointKind>| {
        let (fit, scores) = fits(all).chosen_fit(kind);
        assert_eq!(scores, fits(all).scores);
        fit.joint.freedom
    };
    let screw = Some(JointKind::Screw { pitch_m_per_rad: 0.1 });
    assert_eq!(chosen(true, None), Freedom::Turn);
    assert_eq!(chosen(true, Some(JointKind::Revolute)), Freedom::Turn);
    assert_eq!(chosen(true, Some(JointKind::Prismatic)), Freedom::Slide);
    assert_eq!(chosen(true, screw), Freedom::Helix);
    // None of the motions turns.
    assert_eq!(chosen(false, Some(JointKind::Revolute)), Freedom::Slide);
    assert_eq!(chosen(false, screw), Freedom::Slide);
}
