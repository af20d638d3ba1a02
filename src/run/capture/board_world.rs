//! The world frame of a tracked recording that shows a printed board of tags.

use std::cmp::Reverse;

use super::place::{Worlds, unaligned};
use ::capture::{
    BoardInView, BoardInWorld, BoardPlace, CaptureError, ColorTurn, TrackedState, UNREAD_BOARD, Unaligned,
    UpBy, Upright, board_scale, pose_scaled,
};
use common::note::{Note, NoteCode};
use common::stop::{Stop, Stopped};
use geometry::Pose;

/// Largest accepted relative difference between the board's printed size and its size by depth; beyond it,
/// depth gives the lengths. chosen: the tolerance of stereo cameras in data sheets at 2 m; a page fitted to
/// the margins is 3 to 6 % smaller
const LARGEST_OFF: f64 = 0.02;
/// Largest motion of a resting board relative to still surfaces between states: meters, and radians.
/// tuned: still surfaces brought states together within 3 mm in shared/bags, and errors up to as much are
/// corrected afterwards (docs/method.md 2.8)
const MOVED: [f64; 2] = [0.010, 0.02];
/// Tilt of a board relative to the plane under the object from which there is a warning, radians.
/// chosen: normals of a plane by depth with a warp of 0.4 % of the range, over a third of it
const TILTED_RAD: f64 = 0.035;
/// Tilt from which the board does not lie on that plane, but against a wall or on a slope, radians.
/// chosen: nobody calls 20 deg level
const STANDS_RAD: f64 = 0.35;
/// The same relative to the up direction from images, which is uncertain by tens of degrees; radians.
/// chosen: about two deviations of this direction
const STANDS_BY_IMAGES_RAD: f64 = 1.0;

/// Poses of the states' maps on boards; `None` if no state shows a board often enough.
pub(super) fn places(tracked: &[TrackedState], stop: &Stop) -> Result<Option<Places>, Stopped> {
    let views: Vec<Vec<BoardInView<'_>>> = tracked.iter().map(in_view).collect();
    let ratios: Vec<f64> = views.iter().flatten().filter_map(|v| v.sighting.depth_ratio).collect();
    // One sensor, one length.
    let scale = board_scale(&ratios).unwrap_or(UNREAD_BOARD);
    let of_state: Vec<Option<BoardPlace>> = views
        .iter()
        .map(|v| BoardPlace::from_views(v, scale, &ColorTurn::EXPECTED, stop))
        .collect::<Result<_, Stopped>>()?;
    Ok(of_state.iter().any(Option::is_some).then_some(Places { of_state, scale }))
}

/// The views of a state that show its most frequent board.
fn in_view(state: &TrackedState) -> Vec<BoardInView<'_>> {
    let posed = state.track.poses.iter().zip(&state.boards);
    let views: Vec<BoardInView<'_>> = posed
        .filter_map(|(pose, board)| {
            Some(BoardInView { map_from_camera: (*pose)?, sighting: board.as_ref()? })
        })
        .collect();
    let papers = views.iter().map(|v| v.sighting.paper);
    let most = papers.clone().max_by_key(|p| (papers.clone().filter(|q| q == p).count(), Reverse(*p)));
    views.into_iter().filter(|v| Some(v.sighting.paper) == most).collect()
}

/// Poses of the states' maps on a board.
pub(super) struct Places {
    /// Pose in every state; `None` if it does not show the board often enough.
    of_state: Vec<Option<BoardPlace>>,
    /// Ratio of lengths on the board to those in the maps, and its standard deviation.
    scale: [f64; 2],
}

impl Places {
    /// Pose of a state's map, scaled by `scale`, on the board; `None` if the state shows no board.
    fn board_from_map(&self, state: usize, scale: f64) -> Option<Pose> {
        Some(pose_scaled(&self.of_state[state].as_ref()?.board_from_map, scale / self.scale[0]))
    }
}

/// Pose of a later state's map, scaled by `scale`, in the first state's map.
fn first_from_map(
    aligned: &[Result<(Pose, f64), Unaligned>],
    state: usize,
    scale: f64,
) -> Result<Pose, CaptureError> {
    match &aligned[state - 1] {
        Ok((first_from_map, _)) => Ok(pose_scaled(first_from_map, scale)),
        Err(why) => Err(unaligned(state, why)),
    }
}

/// The world frame of the board, or an upright one with the board's scale; adds notes and warnings. For every
/// state but the first, `aligned` is its pose in the first one's map.
///
/// # Errors
/// [`CaptureError::StatesUnaligned`] where a state shows neither a board nor still surfaces.
pub(super) fn board_worlds(
    tracked: &[TrackedState],
    places: &Places,
    aligned: &[Result<(Pose, f64), Unaligned>],
    [notes, warnings]: [&mut Vec<Note>; 2],
) -> Result<Worlds, CaptureError> {
    let trusted = (places.scale[0] - 1.0).abs() <= LARGEST_OFF;
    // Ratio of lengths in the world to those in the maps.
    let scale = if trusted { places.scale[0] } else { 1.0 };
    for (state, place) in places.of_state.iter().enumerate() {
        notes.extend(place.as_ref().map(|p| seen(state, p, tracked[state].boards.len())));
    }
    notes.extend(trusted.then(|| length(&places.scale)));
    warnings.extend((!trusted).then(|| doubtful(places.scale[0])));
    let mut on_its_place: Vec<bool> = places.of_state.iter().map(Option::is_some).collect();
    let Some((reference, board_from_map)) =
        (0..tracked.len()).find_map(|s| Some((s, places.board_from_map(s, scale)?)))
    else {
        return Ok(Worlds::of_maps(vec![Pose::identity(); tracked.len()]));
    };
    let world_from_board = upright(&tracked[reference], &board_from_map, scale, warnings);
    let first = match places.board_from_map(0, scale) {
        Some(board_from_map) => world_from_board * board_from_map,
        None => world_from_board * board_from_map * first_from_map(aligned, reference, scale)?.inverse(),
    };
    let mut from_maps = vec![first];
    for state in 1..tracked.len() {
        let by_surroundings = first_from_map(aligned, state, scale).map(|p| first * p);
        let world = match (places.board_from_map(state, scale), by_surroundings) {
            (Some(on_board), Ok(expected)) => {
                let moved = expected * (world_from_board * on_board).inverse();
                // At the board's middle.
                let at = world_from_board.translation.vector;
                let far_m = (moved * nalgebra::Point3::from(at) - at).coords.norm();
                if far_m > MOVED[0] || moved.rotation.angle() > MOVED[1] {
                    warnings.push(board_moved(state, far_m, moved.rotation.angle()));
                    on_its_place[state] = false;
                    expected
                } else {
                    world_from_board * on_board
                }
            }
            (Some(on_board), Err(_)) => world_from_board * on_board,
            (None, by_surroundings) => by_surroundings?,
        };
        from_maps.push(world);
    }
    let board = BoardInWorld { world_from_board, in_states: on_its_place, trusted, sightings: Vec::new() };
    Ok(Worlds { from_maps, scale, board: Some(board) })
}

/// The world with a level board, or the upright one of a tilted board.
fn upright(tracked: &TrackedState, board_from_map: &Pose, scale: f64, warnings: &mut Vec<Note>) -> Pose {
    let Upright { world_from_map: upright_from_map, by, .. } = tracked.track.upright_world();
    let normal = board_from_map.inverse() * nalgebra::Vector3::z();
    let up = upright_from_map.inverse() * nalgebra::Vector3::z();
    let tilt_rad = normal.angle(&up);
    let most_rad = if by == UpBy::Images { STANDS_BY_IMAGES_RAD } else { STANDS_RAD };
    let degrees = tilt_rad.to_degrees();
    if tilt_rad > most_rad {
        warnings.push(Note::new(
            NoteCode::BoardTilted,
            format!(
                "the board does not lie level: it is tilted by {degrees:.0} deg; it gives lengths alone, and \
                 the world is upright by what else is seen; lay the board on the floor or the table"
            ),
        ));
        return pose_scaled(&upright_from_map, scale) * board_from_map.inverse();
    }
    if by != UpBy::Images && tilt_rad > TILTED_RAD {
        warnings.push(Note::new(
            NoteCode::BoardTilted,
            format!(
                "the board is tilted by {degrees:.1} deg against what else says which way is up; up is the \
                 board's: lay it level"
            ),
        ));
    }
    Pose::identity()
}

fn seen(state: usize, place: &BoardPlace, looked_at: usize) -> Note {
    Note::new(
        NoteCode::BoardSeen,
        format!(
            "state {state}: a board of tags was seen in {} of {looked_at} views, of which {} agree; edges of \
             its tags lie within {:.2} px; the world is the board's: a point on it is known to {:.2} mm, one \
             {} m away to {:.2} mm (one standard deviation)",
            place.views,
            place.agreeing,
            place.edges_px,
            1e3 * place.sigma_m(0.0),
            BoardPlace::AWAY_M,
            1e3 * place.sigma_m(BoardPlace::AWAY_M)
        ),
    )
}

fn length([scale, sigma]: &[f64; 2]) -> Note {
    Note::new(
        NoteCode::BoardSize,
        format!(
            "by depth the board measures {:.2} % of its size (standard deviation {:.2} %); depth and poses \
             were multiplied by {scale:.5}",
            100.0 / scale,
            100.0 * sigma
        ),
    )
}

fn doubtful(scale: f64) -> Note {
    Note::new(
        NoteCode::BoardSizeDoubtful,
        format!(
            "by depth the board measures {:.1} % of its size: it was not printed at 100 %, or the depth \
             sensor is off by more than data sheets allow; lengths are those of depth; measure the ruler \
             on the board",
            100.0 / scale
        ),
    )
}

fn board_moved(state: usize, far_m: f64, turned_rad: f64) -> Note {
    Note::new(
        NoteCode::BoardMoved,
        format!(
            "state {state}: the board was moved since state 0, by {:.0} mm and {:.1} deg against what stands \
             still, which brings the states together instead; leave the board where it lies",
            1e3 * far_m,
            turned_rad.to_degrees()
        ),
    )
}
