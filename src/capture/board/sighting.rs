//! A board in a view.

use std::collections::BTreeMap;

use nalgebra::Matrix6;

use super::{
    depth::depth_ratio,
    detection::{SeenTag, detect_tags},
    edges::{EdgePoint, edge_points},
    gray::Gray,
    layout::{BoardLayout, Paper},
    pose::BoardView,
};
use crate::RgbdFrame;
use geometry::Pose;

/// Fewest agreeing tags: a single one may be a foreign tag of the same number, and its tilt is hardly known.
const LEAST_TAGS: usize = 2;

/// A board in a view.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardSighting {
    /// Paper of the board.
    pub paper: Paper,
    /// Pose of the color camera in the frame of the board at true print scale.
    pub board_from_camera: Pose,
    /// Covariance of a motion of the camera in its own frame: shift, meters, and turn, radians.
    pub covariance: Matrix6<f64>,
    /// Number of tags with agreeing edges.
    pub tags: usize,
    /// Root mean square residual of their edges, pixels.
    pub rms_px: f64,
    /// Median ratio of depth readings to the distance by the tags; `None` where few readings fall on the
    /// board.
    pub depth_ratio: Option<f64>,
}

impl BoardSighting {
    /// The depth ratio of a frame after its depth was corrected.
    #[must_use]
    pub fn depth_ratio_in(&self, frame: &RgbdFrame) -> Option<f64> {
        depth_ratio(frame, &BoardLayout::of_paper(self.paper), &self.board_from_camera)
    }
}

/// The board in a frame; `None` where fewer than two of its tags agree.
#[must_use]
pub fn find_board(frame: &RgbdFrame) -> Option<BoardSighting> {
    let gray = Gray::of_frame(frame);
    let mut by_paper: BTreeMap<Paper, Vec<SeenTag>> = BTreeMap::new();
    for seen in detect_tags(&gray) {
        if let Some(layout) = BoardLayout::with_tag(seen.tag) {
            by_paper.entry(layout.paper).or_default().push(seen);
        }
    }
    // One board per view: the one with the most tags, the first of equals.
    let (paper, tags) = by_paper.into_iter().rev().max_by_key(|(_, tags)| tags.len())?;
    let layout = BoardLayout::of_paper(paper);
    let points: Vec<EdgePoint> = tags.iter().flat_map(|t| edge_points(&gray, t)).collect();
    let view = BoardView { intrinsics: &frame.intrinsics, layout: &layout, points: &points };
    let found = view.pose_of_board(&tags)?;
    (found.tags.len() >= LEAST_TAGS).then(|| BoardSighting {
        paper,
        board_from_camera: found.board_from_camera,
        covariance: found.covariance,
        tags: found.tags.len(),
        rms_px: found.rms_px,
        depth_ratio: depth_ratio(frame, &layout, &found.board_from_camera),
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;

    use super::*;
    use crate::board::test_view::{drawn_board, looking_at};
    use geometry::shift_and_turn;

    #[test]
    fn boards_are_found_where_they_are() {
        for (paper, away_m, tilt, roll) in [
            (Paper::A4, 0.9, 0.5, 0.1),
            (Paper::A4, 1.4, 0.9, 2.0),
            (Paper::A3, 1.8, 0.8, -1.4),
            (Paper::Letter, 0.7, 0.1, 3.0),
            // Cells too narrow to be read.
            (Paper::A3, 1.4, 1.25, 0.0),
        ] {
            let layout = BoardLayout::of_paper(paper);
            let truth = looking_at(Point2::new(0.05, -0.02), away_m, [tilt, 0.7, roll]);
            let frame = drawn_board(&layout, &truth);
            let found = find_board(&frame).unwrap();
            assert_eq!((found.paper, found.tags), (paper, 6));
            let off = shift_and_turn(&(truth.inverse() * found.board_from_camera));
            let sigmas = off.dot(&(found.covariance.cholesky().unwrap().inverse() * off)).sqrt();
            let distance =
                found.board_from_camera.translation.vector.norm() / truth.translation.vector.norm();
            // The norm of six standard normal values is 2.4 on average.
            assert!(sigmas < 6.0, "{off} {sigmas}");
            let least = if tilt > 1.0 { 0.005 } else { 0.002 };
            assert!((distance - 1.0).abs() < least, "{distance}");
            assert!((found.depth_ratio.unwrap() - 1.0).abs() < least, "{:?}", found.depth_ratio);
        }
    }

    #[test]
    fn a_floor_shows_no_board() {
        let layout = BoardLayout::of_paper(Paper::A4);
        let mut frame = drawn_board(&layout, &looking_at(Point2::origin(), 1.0, [0.4, 0.0, 0.0]));
        frame.rgb.iter_mut().enumerate().for_each(|(i, c)| *c = [(i * 7919 % 251) as u8; 3]);
        assert_eq!(find_board(&frame), None);
        frame.rgb.fill([128; 3]);
        assert_eq!(find_board(&frame), None);
    }
}
