use nalgebra::Point3;

use super::*;
use crate::board::Paper;
use numeric::random::{self, stage_rng};

/// Deviation of the poses by the board, as of one view.
const SIGMA: [f64; 2] = [0.002, 0.0015];
const SCALE_TRUTH: f64 = 1.006;
const TURN_TRUTH: [f64; 2] = [0.002, -0.001];

/// From the map at the board's length to the board.
fn truth() -> Pose {
    Pose::new(Vector3::new(0.4, -0.2, 0.9), Vector3::new(1.7, 0.4, -0.3))
}

/// Poses in the map, and what the board says of them.
fn made(count: usize, seed: u64) -> Vec<(Pose, BoardSighting)> {
    let rng = &mut stage_rng(seed, "place", 0);
    (0..count)
        .map(|i| {
            let turn = 0.04 * i as f64;
            let eye = Point3::new(1.2 * turn.cos(), 1.2 * turn.sin(), 0.7 + 0.1 * (i % 4) as f64);
            let on_board = Pose::face_towards(&eye, &Point3::new(0.1, 0.0, 0.0), &-Vector3::z());
            let color_from_tracked =
                Pose::new(Vector3::zeros(), Vector3::new(-TURN_TRUTH[0], -TURN_TRUTH[1], 0.0));
            let map = truth().inverse() * on_board * color_from_tracked;
            let error = Pose::new(
                random::isotropic_normal(rng, SIGMA[0] * 3f64.sqrt()),
                random::isotropic_normal(rng, SIGMA[1] * 3f64.sqrt()),
            );
            let sighting = BoardSighting {
                paper: Paper::A4,
                board_from_camera: on_board * error,
                covariance: Matrix6::from_diagonal(&Vector6::from_fn(|k, _| SIGMA[k / 3].powi(2))),
                tags: 6,
                rms_px: 0.1,
                depth_ratio: None,
            };
            (pose_scaled(&map, 1.0 / SCALE_TRUTH), sighting)
        })
        .collect()
}

fn place(made: &[(Pose, BoardSighting)], scale: [f64; 2], color: &ColorTurn) -> Option<BoardPlace> {
    let views: Vec<BoardInView<'_>> =
        made.iter().map(|(p, sighting)| BoardInView { map_from_camera: *p, sighting }).collect();
    BoardPlace::from_views(&views, scale, color, &Stop::never()).unwrap()
}

const KNOWN: ColorTurn = ColorTurn { mean_rad: TURN_TRUTH, sigma_rad: [0.0; 2] };

/// Motion of the map about the board's middle, in the map's frame.
fn about_middle(found: &BoardPlace) -> Vector6<f64> {
    let middle = truth().inverse().translation.vector;
    let off = shift_and_turn(&(truth().inverse() * found.board_from_map));
    adjoint(&Pose::from_parts((-middle).into(), UnitQuaternion::identity())) * off
}

#[test]
fn the_place_is_found_within_what_is_said() {
    let mut squares = Vector6::zeros();
    let mut expected = Vector6::zeros();
    for seed in 0..40 {
        let found = place(&made(60, seed), [SCALE_TRUTH, 0.0], &KNOWN).unwrap();
        let off = about_middle(&found);
        assert!(off.fixed_rows::<3>(0).norm() < 0.0015, "{off}");
        squares += off.component_mul(&off);
        expected += found.covariance.diagonal();
    }
    for (is, said) in squares.iter().zip(&expected) {
        assert!((0.5..1.8).contains(&(is / said)), "{squares} {expected}");
    }
}

#[test]
fn what_is_not_known_of_length_and_color_widens_the_covariance() {
    let some = made(60, 7);
    let known = place(&some, [SCALE_TRUTH, 0.0], &KNOWN).unwrap();
    for (scale, color) in [([SCALE_TRUTH * 1.004, 0.004], KNOWN), ([SCALE_TRUTH, 0.0], ColorTurn::EXPECTED)] {
        let found = place(&some, scale, &color).unwrap();
        // A standard deviation off, and that much said.
        let moved = about_middle(&found) - about_middle(&known);
        let sigmas = moved.zip_map(&found.covariance.diagonal(), |m, variance| m.abs() / variance.sqrt());
        assert!(sigmas.max() > 0.3 && sigmas.max() < 1.5, "{sigmas}");
        assert!(found.sigma_m(0.5) > known.sigma_m(0.5));
    }
}

#[test]
fn neighbors_that_err_alike_are_no_more_certain_than_one() {
    // The first half of the recording errs by 4 mm, the second by as much the other way.
    let mut some = made(60, 8);
    for (k, (pose, _)) in some.iter_mut().enumerate() {
        let drift_m = if k < 30 { 0.004 } else { -0.004 };
        *pose = Pose::translation(0.0, drift_m, 0.0) * *pose;
    }
    let found = place(&some, [SCALE_TRUTH, 0.0], &KNOWN).unwrap();
    assert!((0.0008..0.004).contains(&found.sigma_m(0.0)), "{}", found.sigma_m(0.0));
}

#[test]
fn views_that_disagree_are_outvoted() {
    let mut some = made(30, 3);
    for (pose, _) in some.iter_mut().step_by(3) {
        *pose = Pose::new(Vector3::new(0.1, 0.05, 0.0), Vector3::new(0.0, 0.1, 0.0)) * *pose;
    }
    let found = place(&some, [SCALE_TRUTH, 0.0], &KNOWN).unwrap();
    assert_eq!((found.views, found.agreeing), (30, 20));
    assert!(about_middle(&found).amax() < 0.004, "{}", about_middle(&found));
    assert_eq!(place(&some[..3], [SCALE_TRUTH, 0.0], &KNOWN), None);
}

#[test]
fn the_length_is_that_of_most_views() {
    let mut ratios = vec![0.996; 20];
    ratios[3] = 0.7;
    let [scale, sigma] = board_scale(&ratios).unwrap();
    assert!((scale * 0.996 - 1.0).abs() < 1e-9 && sigma < 0.002);
    assert_eq!(board_scale(&ratios[..3]), None);
}

#[test]
fn a_shift_of_color_is_a_turn() {
    let k = Intrinsics { width: 640, height: 480, fx: 600.0, fy: 500.0, cx: 319.5, cy: 239.5 };
    let turn = ColorTurn::of_shift([[0.6, 1.0], [0.1, 0.2]], &k);
    let depth_from_color = Pose::new(Vector3::zeros(), Vector3::new(turn.mean_rad[0], turn.mean_rad[1], 0.0));
    let point = Point3::new(0.0, 0.0, 1.3);
    let (u, v) = k.project(&depth_from_color.inverse_transform_point(&point)).unwrap();
    assert!((u - k.cx - 0.6).abs() < 1e-3 && (v - k.cy - 1.0).abs() < 1e-3, "{u} {v}");
}

#[test]
fn derivatives_are_those_of_the_residual() {
    let some = made(3, 5);
    let off = |step: &SMatrix<f64, 9, 1>, (pose, sighting): &(Pose, BoardSighting)| {
        let view = BoardInView { map_from_camera: *pose, sighting };
        let problem = PlaceProblem {
            views: &[],
            scale: SCALE_TRUTH * step[6].exp(),
            turn: [TURN_TRUTH[0] + step[7], TURN_TRUTH[1] + step[8]],
        };
        let at = truth() * Pose::new(step.fixed_rows::<3>(0).into(), step.fixed_rows::<3>(3).into());
        problem.residual_of_view(&at, &view).unwrap()
    };
    for one in &some {
        let r = off(&SMatrix::zeros(), one);
        for k in 0..9 {
            let step = SMatrix::from_fn(|i, _| if i == k { 1e-6 } else { 0.0 });
            let slope = (off(&step, one).off - r.off) / 1e-6;
            let expected = if k < 6 { r.by_map.column(k) } else { r.by_known.column(k - 6) };
            // Up to residuals of 2e-3.
            assert!((slope - expected).amax() < 0.01, "{k}: {slope} {expected}");
        }
    }
}
