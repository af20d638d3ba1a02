//! The pose of a board in the world, and its use to place a recording again. See docs/method.md 2.15.

use std::{collections::BTreeMap, fmt};

use nalgebra::Point3;

use super::{
    place::{BoardInView, BoardPlace, ColorTurn, UNREAD_BOARD, board_scale, pose_scaled},
    sighting::BoardSighting,
};
use crate::{RgbdFrame, SensorCalibration};
use common::stop::{Stop, Stopped};
use geometry::Pose;

/// A board in the world and its sightings.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardInWorld {
    /// Pose of the board in the world.
    pub world_from_board: Pose,
    /// By state: whether the board is at this pose and seen.
    pub in_states: Vec<bool>,
    /// Whether its printed length sets the scale.
    pub trusted: bool,
    /// By state: sightings of the board, by stamp of the view, nanoseconds.
    pub sightings: Vec<BTreeMap<i64, BoardSighting>>,
}

/// How a corrected recording was placed on its board.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardCorrection {
    /// Number of agreeing views.
    pub views: usize,
    /// Motion of the world at the board, meters.
    pub moved_m: f64,
    /// Factor on all lengths, and its standard deviation.
    pub scale: [f64; 2],
    /// Standard deviations of a point on the board, and of one [`BoardPlace::AWAY_M`] from it, meters.
    pub sigma_m: [f64; 2],
}

impl BoardInWorld {
    /// Moves frames with corrected poses and depth onto the board. All states move together, since still
    /// surfaces have aligned them. Returns `None` and moves nothing where too few frames show the board.
    ///
    /// # Errors
    /// [`Stopped`].
    pub fn place_again(
        &self,
        states: &mut [Vec<RgbdFrame>],
        sensor: Option<&SensorCalibration>,
        stop: &Stop,
    ) -> Result<Option<BoardCorrection>, Stopped> {
        let on_its_place = states.iter().zip(&self.sightings).zip(&self.in_states).filter(|(_, on)| **on);
        let seen: Vec<(&RgbdFrame, &BoardSighting)> = on_its_place
            .flat_map(|((frames, boards), _)| frames.iter().map(move |f| (f, boards.get(&f.stamp_nanos))))
            .filter_map(|(frame, board)| Some((frame, board?)))
            .collect();
        let Some((first, _)) = seen.first() else { return Ok(None) };
        let intrinsics = &first.intrinsics;
        let color = sensor
            .filter(|s| s.used)
            .map_or(ColorTurn::EXPECTED, |s| ColorTurn::of_shift(s.color_shift_px, intrinsics));
        let ratios: Vec<f64> = seen.iter().filter_map(|(f, board)| board.depth_ratio_in(f)).collect();
        let [scale, sigma] = board_scale(&ratios).unwrap_or(UNREAD_BOARD);
        let views: Vec<BoardInView<'_>> = seen
            .iter()
            .map(|(f, sighting)| BoardInView { map_from_camera: f.world_from_camera, sighting })
            .collect();
        let place = BoardPlace::from_views(&views, [scale, sigma], &color, stop)?;
        let Some(place) = place else { return Ok(None) };
        // The scale remains that of depth where the printed length is not trusted.
        let factor = if self.trusted { scale } else { 1.0 };
        let moved = self.world_from_board * pose_scaled(&place.board_from_map, factor / scale);
        let at = self.world_from_board.translation.vector;
        for frame in states.iter_mut().flatten() {
            frame.world_from_camera = moved * pose_scaled(&frame.world_from_camera, factor);
            frame.depth_m.iter_mut().for_each(|d| *d *= factor as f32);
        }
        Ok(Some(BoardCorrection {
            views: place.agreeing,
            moved_m: (moved * Point3::from(at * factor) - at).coords.norm(),
            scale: [factor, sigma],
            sigma_m: [0.0, BoardPlace::AWAY_M].map(|away_m| place.sigma_m(away_m)),
        }))
    }
}

impl fmt::Display for BoardCorrection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [factor, sigma] = self.scale;
        let away_m = BoardPlace::AWAY_M;
        let [on_mm, away_mm] = self.sigma_m.map(|m| 1e3 * m);
        write!(
            f,
            "by corrected poses and depth the world was placed on the board again, by {} views: it moved by \
             {:.2} mm there, and lengths changed by {:+.2} % (standard deviation {:.2} %); a point on the \
             board is known to {on_mm:.2} mm, one {away_m} m away to {away_mm:.2} mm (one standard \
             deviation)",
            self.views,
            1e3 * self.moved_m,
            100.0 * (factor - 1.0),
            100.0 * sigma
        )
    }
}
