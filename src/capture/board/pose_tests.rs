use nalgebra::Vector6;

use super::*;
use crate::board::{
    Paper,
    test_view::{INTRINSICS, looking_at},
};
use geometry::shift_and_turn;
use numeric::random::{self, stage_rng};

const SIGMA_PX: f64 = 0.08;

/// Places on the edges of all tags as a camera sees them, ink spread included, and the tags.
fn seen(layout: &BoardLayout, board_from_camera: &Pose, ink_px: f64) -> (Vec<EdgePoint>, Vec<SeenTag>) {
    let mut points = Vec::new();
    let mut tags = Vec::new();
    for tag in layout.tag_numbers() {
        let project = |p: Point2<f64>| {
            let (u, v) = INTRINSICS
                .project(&board_from_camera.inverse_transform_point(&Point3::new(p.x, p.y, 0.0)))
                .unwrap();
            Point2::new(u, v)
        };
        let corners = layout.tag_corners(tag).unwrap().map(project);
        for edge in 0..4 {
            let [a, b] = [corners[edge], corners[(edge + 1) % 4]];
            let along = (b - a).normalize();
            for share in [0.25, 0.75] {
                let at = a + (b - a) * share + Vector2::new(along.y, -along.x) * ink_px;
                points.push(EdgePoint { tag, edge, at, sigma_px: SIGMA_PX });
            }
        }
        tags.push(SeenTag { tag, corners });
    }
    (points, tags)
}

fn camera(layout: &BoardLayout) -> Pose {
    let [x, y] = layout.half_grid_m();
    looking_at(Point2::new(0.3 * x, -0.4 * y), 1.1, [0.7, 0.8, 0.3])
}

#[test]
fn an_exact_view_gives_the_pose_back() {
    for paper in Paper::ALL {
        let layout = BoardLayout::of_paper(paper);
        let truth = camera(&layout);
        let (points, tags) = seen(&layout, &truth, 0.2);
        let view = BoardView { intrinsics: &INTRINSICS, layout: &layout, points: &points };
        let found = view.pose_of_board(&tags).unwrap();
        let off = shift_and_turn(&(truth.inverse() * found.board_from_camera));
        // The expectation that ink does not spread draws a little.
        assert!(off.amax() < 1e-3 && (found.ink_px - 0.2).abs() < 0.02, "{off} {}", found.ink_px);
        assert_eq!(found.tags.len(), 6);
        let (points, tags) = seen(&layout, &truth, 0.0);
        let found = BoardView { points: &points, ..view }.pose_of_board(&tags).unwrap();
        assert!(shift_and_turn(&(truth.inverse() * found.board_from_camera)).amax() < 1e-8);
    }
}

#[test]
fn derivatives_are_those_of_the_residual() {
    let layout = BoardLayout::of_paper(Paper::A4);
    let at = camera(&layout);
    let (mut points, _) = seen(&layout, &at, 0.0);
    // Along an edge nothing changes; across it the place counts.
    points.iter_mut().enumerate().for_each(|(k, p)| p.at.x += 0.3 * (k % 3) as f64);
    let view = BoardView { intrinsics: &INTRINSICS, layout: &layout, points: &points };
    let step = 1e-6;
    for point in &points {
        let (r, slopes) = view.edge_residual(&at.inverse(), 0.1, point).unwrap();
        for k in 0..7 {
            let twist = Vector6::from_fn(|i, _| if i == k { step } else { 0.0 });
            let moved = at * Pose::new(twist.fixed_rows::<3>(0).into(), twist.fixed_rows::<3>(3).into());
            let ink = if k == 6 { 0.1 + step } else { 0.1 };
            let slope = (view.edge_residual(&moved.inverse(), ink, point).unwrap().0 - r) / step;
            // Up to the second order, of residuals of half a pixel.
            assert!((slope - slopes[k]).abs() < 2e-2 + 5e-3 * slopes[k].abs(), "{k}: {slope} {}", slopes[k]);
        }
    }
}

#[test]
fn errors_are_as_large_as_the_covariance_says() {
    let layout = BoardLayout::of_paper(Paper::A4);
    let truth = camera(&layout);
    let (exact, tags) = seen(&layout, &truth, 0.0);
    let rng = &mut stage_rng(5, "board", 0);
    let draws = 200;
    let mut sum = 0.0;
    for _ in 0..draws {
        let ink = INK_PX * random::standard_normal(rng);
        let mut points = exact.clone();
        for p in &mut points {
            let [a, b] =
                [p.edge, (p.edge + 1) % 4].map(|c| tags.iter().find(|t| t.tag == p.tag).unwrap().corners[c]);
            let along = (b - a).normalize();
            p.at += Vector2::new(along.y, -along.x) * (ink + SIGMA_PX * random::standard_normal(rng));
        }
        let view = BoardView { intrinsics: &INTRINSICS, layout: &layout, points: &points };
        let found = view.pose_of_board(&tags).unwrap();
        let off = shift_and_turn(&(truth.inverse() * found.board_from_camera));
        sum += off.dot(&(found.covariance.cholesky().unwrap().inverse() * off));
    }
    // Six on average, 0.24 over 200 draws; a little less as the scale is 1 at least.
    let mean = sum / f64::from(draws);
    assert!((4.0..7.5).contains(&mean), "{mean}");
}

#[test]
fn a_tag_that_stands_elsewhere_is_left_out() {
    let layout = BoardLayout::of_paper(Paper::A4);
    let truth = camera(&layout);
    let (mut points, mut tags) = seen(&layout, &truth, 0.0);
    let wrong = tags[1].tag;
    points.iter_mut().filter(|p| p.tag == wrong).for_each(|p| p.at += Vector2::new(40.0, -25.0));
    tags[1].corners.iter_mut().for_each(|c| *c += Vector2::new(40.0, -25.0));
    let view = BoardView { intrinsics: &INTRINSICS, layout: &layout, points: &points };
    let found = view.pose_of_board(&tags).unwrap();
    assert!(!found.tags.contains(&wrong) && found.tags.len() == 5, "{:?}", found.tags);
    let off = shift_and_turn(&(truth.inverse() * found.board_from_camera));
    assert!(off.amax() < 5e-4, "{off}");
}
