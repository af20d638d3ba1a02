//! Camera poses of recordings that have none: their views go through a tracker, some at a time.

use rayon::prelude::*;

use super::{
    bag::Bag,
    board_world::{board_worlds, places},
    depth_noise::noise_of,
    pixels::decode_views,
    tracked_state::{TrackedState, Worlds, unaligned},
    upright::upright_of,
    views::{View, Views},
};
use capture::{
    CaptureConfig, CaptureError, Lost, NoiseConfig, Observation, RgbdFrame, Tracker, Unaligned, UseBoard,
    align_tracks, find_board,
};
use common::ahead::Ahead;
use common::limits::{BYTES_PER_PIXEL, NAMED};
use common::note::{Note, NoteCode};
use geometry::Pose;

/// Memory of the views that are decoded at a time, bytes.
/// derived: 64 views of 640x480; the bag is read once for each such block
const BLOCK_BYTES: u64 = 64 * 640 * 480 * BYTES_PER_PIXEL;

/// Tracks the camera through some views of a bag, in the order of time.
///
/// # Errors
/// Those of the decoding; [`CaptureError::NotTracked`] where no two views hang together.
pub(super) fn track(
    bag: &Bag,
    views: &Views,
    of_state: &[usize],
    config: &CaptureConfig,
    (state, seed): (usize, u64),
    ahead: &Ahead,
) -> Result<TrackedState, CaptureError> {
    let unmasked = unmasked(views);
    let block = views_at_a_time(views);
    let mut tracker = Tracker::new(seed ^ state as u64);
    let mut seen = Vec::new();
    let mut boards = Vec::new();
    let mut reasons = Vec::new();
    let mut noise = None;
    for some in of_state.chunks(block) {
        // Views take the place of states: what is broken is left out, and the numbers say which.
        let chosen: Vec<(usize, usize)> = some.iter().map(|&v| (v, v)).collect();
        let frames = decode_views(bag, &unmasked, &chosen, config)?.frames;
        let noise: NoiseConfig =
            *noise.get_or_insert_with(|| noise_of(frames.iter().map(|(_, f)| f), config));
        let look = |(view, frame): (usize, RgbdFrame)| {
            let board = if config.board == UseBoard::Auto { find_board(&frame) } else { None };
            (view, board, Observation::of(frame, &noise, ahead))
        };
        let observations: Vec<_> = frames.into_par_iter().map(look).collect();
        for (view, board, observation) in observations {
            seen.push(view);
            boards.push(board);
            reasons.push(tracker.add(observation).err());
        }
    }
    let mut track = tracker.finish();
    if track.findings.tracked < 2 {
        return Err(CaptureError::NotTracked { state, views: seen.len(), why: Lost::mostly(&reasons) });
    }
    track.measured_up = views.accelerometer.as_ref().map(|a| track.up_of(a));
    let notes = vec![Note::new(NoteCode::CameraTracked, format!("state {state}: {}", track.findings))];
    let stretch = |[first, last]: &[usize; 2]| {
        let why = Lost::mostly(&reasons[*first..=*last]);
        let stamp = |v: usize| capture::stamp_secs(views.views[seen[v]].stamp_nanos);
        let text = format!(
            "state {state}: the camera was lost from {:.3} to {:.3} s ({} views), which are not used: {why}",
            stamp(*first),
            stamp(*last),
            last - first + 1
        );
        Note::new(NoteCode::ViewsLost, text)
    };
    let mut warnings: Vec<Note> = track.findings.lost.iter().take(NAMED).map(stretch).collect();
    if let Some(more) = track.findings.lost.len().checked_sub(NAMED).filter(|n| *n > 0) {
        let text = format!("state {state}: the camera was lost in {more} more stretches");
        warnings.push(Note::new(NoteCode::ViewsLost, text));
    }
    Ok(TrackedState { track, views: seen, boards, notes, warnings })
}

/// Views as they are tracked. Masks are of the object; what stands around it shows the camera's motion, too.
pub(super) fn unmasked(views: &Views) -> Views {
    let unmasked = views.views.iter().map(|v| View { mask: None, ..v.clone() }).collect();
    Views { views: unmasked, ..views.clone() }
}

/// Views that are decoded at a time.
pub(super) fn views_at_a_time(views: &Views) -> usize {
    let (_, width, height) = views.sizes(1);
    let of_view = (width * height) as u64 * BYTES_PER_PIXEL;
    (BLOCK_BYTES / of_view.max(1)).max(1) as usize
}

/// The world in which the twin stands: a board's, where one is seen often enough, or state 0's, upright.
///
/// # Errors
/// [`CaptureError::StatesUnaligned`] where nothing stands still between states.
pub(super) fn worlds(
    tracked: &[TrackedState],
    seed: u64,
    notes: &mut Vec<Note>,
    warnings: &mut Vec<Note>,
) -> Result<Worlds, CaptureError> {
    let Some((first, others)) = tracked.split_first() else {
        return Ok(Worlds::of_maps(Vec::new()));
    };
    let aligned: Vec<Result<(Pose, f64), Unaligned>> =
        others.iter().map(|other| align_tracks(&first.track, &other.track, seed)).collect();
    for (state, found) in (1..).zip(&aligned) {
        notes.extend(found.as_ref().ok().map(|(_, agreeing)| brought_in(state, *agreeing)));
    }
    if let Some(places) = places(tracked) {
        return board_worlds(tracked, &places, &aligned, [notes, warnings]);
    }
    let world_from_map = upright_of(&first.track, notes, warnings).world_from_map;
    let mut from_maps = vec![world_from_map];
    for (state, found) in (1..).zip(&aligned) {
        let (map0_from_map, _) = found.as_ref().map_err(|why| unaligned(state, why))?;
        from_maps.push(world_from_map * map0_from_map);
    }
    Ok(Worlds::of_maps(from_maps))
}

fn brought_in(state: usize, agreeing: f64) -> Note {
    let text = format!(
        "state {state}: what stands still brings it into the world of state 0; {:.0} % of the surface that \
         both show lies in one place",
        100.0 * agreeing
    );
    Note::new(NoteCode::CameraTracked, text)
}
