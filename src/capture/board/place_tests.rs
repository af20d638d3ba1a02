use nalgebra::Point3;

use super::*;
use crate::{
    capture::board::Paper,
    random::{self, stage_rng},
};

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
                random::isotropic(rng, SIGMA[0] * 3f64.sqrt()),
                random::isotropic(rng, SIGMA[1] * 3f64.sqrt()),
            );
            let sighting = BoardSighting {
                paper: Paper::A4,
                board_from_camera: on_board * error,
                covariance: Matrix6::from_diagonal(&Vector6::from_fn(|k, _| SIGMA[k / 3].powi(2))),
                tags: 6,
                rms_px: 0.1,
                depth_ratio: None,
            };
            (stretched(&map, 1.0 / SCALE_TRUTH), sighting)
        })
        .collect()
}

fn place(made: &[(Pose, BoardSighting)], scale: Option<f64>) -> Option<BoardPlace> {
    let views: Vec<BoardInView<'_>> =
        made.iter().map(|(p, sighting)| BoardInView { map_from_camera: *p, sighting }).collect();
    BoardPlace::of(&views, scale)
}

#[test]
fn map_length_and_color_turn_are_found_within_what_is_said() {
    let (mut squares, mut lengths) = (0.0, 0.0);
    let seeds = 40;
    for seed in 0..seeds {
        let found = place(&made(60, seed), None).unwrap();
        let [scale, sigma] = found.scale;
        assert!((scale / SCALE_TRUTH - 1.0).abs() < 0.002, "{scale}");
        assert!((found.color_turn[0] - TURN_TRUTH[0]).abs() < 1e-3, "{:?}", found.color_turn);
        lengths += ((scale - SCALE_TRUTH) / sigma).powi(2);
        let off = shift_and_turn(&(truth().inverse() * found.board_from_map));
        let middle = truth().inverse().translation.vector;
        let carried =
            adjoint(&Pose::from_parts((-middle).into(), nalgebra::UnitQuaternion::identity())) * off;
        squares += carried.dot(&(found.covariance.cholesky().unwrap().inverse() * carried));
        assert!(carried.fixed_rows::<3>(0).norm() < 0.0015, "{carried}");
    }
    // 6 and 1 on average; tracked poses erred less than is expected of them.
    let [mean, length] = [squares, lengths].map(|s| s / seeds as f64);
    assert!((2.5..8.0).contains(&mean) && (0.3..1.7).contains(&length), "{mean} {length}");
}

#[test]
fn views_that_disagree_are_outvoted() {
    let mut some = made(30, 3);
    for (pose, _) in some.iter_mut().step_by(3) {
        *pose = Pose::new(Vector3::new(0.1, 0.05, 0.0), Vector3::new(0.0, 0.1, 0.0)) * *pose;
    }
    let found = place(&some, None).unwrap();
    assert_eq!((found.views, found.agreeing), (30, 20));
    let off = shift_and_turn(&(truth().inverse() * found.board_from_map));
    assert!(
        (found.scale[0] / SCALE_TRUTH - 1.0).abs() < 0.003 && off.amax() < 0.004,
        "{:?} {off}",
        found.scale
    );
}

#[test]
fn a_given_length_is_kept_and_few_views_give_no_place() {
    let some = made(20, 4);
    assert!((place(&some, Some(1.0)).unwrap().scale[0] - 1.0).abs() < 1e-9);
    assert_eq!(place(&some[..3], None), None);
}

#[test]
fn derivatives_are_those_of_the_residual() {
    let some = made(3, 5);
    let fit = |step: &Step| Fit {
        board_from_map: truth() * Pose::new(step.fixed_rows::<3>(0).into(), step.fixed_rows::<3>(3).into()),
        scale: SCALE_TRUTH * step[LENGTH].exp(),
        turn: [TURN_TRUTH[0] + step[TURN], TURN_TRUTH[1] + step[TURN + 1]],
        information: SMatrix::zeros(),
        deviation: 1.0,
        cost: 0.0,
        agreeing: 0,
    };
    for (pose, sighting) in &some {
        let view = BoardInView { map_from_camera: *pose, sighting };
        let (r, slopes, _) = residual(&fit(&Step::zeros()), &view).unwrap();
        for k in 0..9 {
            let step = Step::from_fn(|i, _| if i == k { 1e-6 } else { 0.0 });
            let slope = (residual(&fit(&step), &view).unwrap().0 - r) / 1e-6;
            // Up to residuals of 2e-3.
            assert!((slope - slopes.column(k)).amax() < 0.01, "{k}: {slope} {}", slopes.column(k));
        }
    }
}
