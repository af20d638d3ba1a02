//! Gives the views of all states poses in one world: the recorded ones, or those of a tracked camera.

use std::collections::BTreeMap;

use super::{
    board_world::{board_worlds, places},
    steps::Steps,
    track::{StateSeed, track, tracked_key},
    upright::upright_of,
};
use ::capture::{
    BoardInWorld, Capture, CaptureConfig, CaptureError, TrackedState, Unaligned, align_tracks, pose_scaled,
};
use common::ahead::Ahead;
use common::note::{Note, NoteCode};
use common::stop::{Stop, Stopped};
use geometry::Pose;
use io::{RecordedStates, Views};

/// Tracks the camera if the recordings have no poses, and places its views in one world.
///
/// # Errors
/// [`CaptureError::NotTracked`] and [`CaptureError::StatesUnaligned`]; those of the decoding.
pub(super) fn posed(
    capture: &mut Capture,
    recorded: &mut [RecordedStates],
    config: &CaptureConfig,
    seed: u64,
    ahead: &Ahead,
    steps: &mut Steps<'_>,
) -> Result<(), CaptureError> {
    if !recorded.iter().all(|r| r.recording.views.are_untracked()) {
        return Ok(());
    }
    let mut expected = 0;
    for (_, of_state) in recorded.iter().flat_map(|r| &r.states) {
        let kept = of_state.len().min(config.frames_per_state);
        expected += of_state.len() + (1 + super::STEPS_OF_FRAMES) * kept;
    }
    steps.expects(expected);
    let mut tracked = Vec::new();
    for RecordedStates { recording, states } in recorded.iter() {
        for (state, of_state) in states {
            let numbers = StateSeed { state: *state, seed };
            // Only recordings of one state are tracked ahead.
            let key = tracked_key(&recording.bag.files, config, numbers).filter(|_| states.len() == 1);
            tracked.push(match key.and_then(|key| ahead.take(&key)) {
                Some(known) => known,
                None => {
                    let stop = steps.stop.clone();
                    let passed = &mut || steps.did(1);
                    track(recording, of_state, config, numbers, ahead, &stop, passed)?
                }
            });
        }
    }
    let worlds = worlds(&tracked, seed, [&mut capture.notes, &mut capture.warnings], &steps.stop)?;
    capture.board = worlds.board;
    let mut of_states = tracked.into_iter().zip(worlds.from_maps);
    for RecordedStates { recording, states } in recorded {
        for (tracked, world) in of_states.by_ref().take(states.len()) {
            give_poses(capture, &mut recording.views, tracked, &world, worlds.scale);
        }
    }
    Ok(())
}

/// Gives tracked views of a state their poses in the world, and scales their depth to it.
fn give_poses(
    capture: &mut Capture,
    views: &mut Views,
    tracked: TrackedState,
    world_from_map: &Pose,
    scale: f64,
) {
    let TrackedState { track, views: seen, boards, notes, warnings } = tracked;
    let mut sightings = BTreeMap::new();
    for ((view, pose), board) in seen.into_iter().zip(track.poses).zip(boards) {
        let view = &mut views.views[view];
        view.world_from_camera = pose.map(|pose| world_from_map * pose_scaled(&pose, scale));
        sightings.extend(board.map(|board| (view.stamp_nanos, board)));
    }
    views.depth_factor *= scale;
    if let Some(board) = &mut capture.board {
        board.sightings.push(sightings);
    }
    capture.tracking.push(track.findings);
    capture.notes.extend(notes);
    capture.warnings.extend(warnings);
}

/// Poses of the states' maps in the world of the twin.
pub(super) struct Worlds {
    /// Pose of every state's map, at its scale, in the world.
    pub from_maps: Vec<Pose>,
    /// Ratio of lengths in the world to those in the maps and those of depth.
    pub scale: f64,
    /// The board that defines this world, if any.
    pub board: Option<BoardInWorld>,
}

impl Worlds {
    /// Worlds at the scale of depth, without a board.
    pub fn of_maps(from_maps: Vec<Pose>) -> Self {
        Self { from_maps, scale: 1.0, board: None }
    }
}

/// The error of a state that no still surfaces bring into the world.
pub(super) fn unaligned(state: usize, why: &Unaligned) -> CaptureError {
    let reason = match why {
        Unaligned::NothingAlike => "nothing looks alike in both".to_owned(),
        Unaligned::Ambiguous { cells: [best, next] } => {
            format!("two motions explain about as much of what looks alike ({best} and {next} places)")
        }
    };
    CaptureError::StatesUnaligned { state, reason }
}

/// The world of the twin: that of a board, if one is seen often enough, else that of state 0, upright.
///
/// # Errors
/// [`CaptureError::StatesUnaligned`] where nothing stands still between states.
fn worlds(
    tracked: &[TrackedState],
    seed: u64,
    [notes, warnings]: [&mut Vec<Note>; 2],
    stop: &Stop,
) -> Result<Worlds, CaptureError> {
    let Some((first, others)) = tracked.split_first() else {
        return Ok(Worlds::of_maps(Vec::new()));
    };
    let aligned: Vec<Result<(Pose, f64), Unaligned>> = others
        .iter()
        .map(|other| align_tracks(&first.track, &other.track, seed, stop))
        .collect::<Result<_, Stopped>>()?;
    for (state, found) in (1..).zip(&aligned) {
        notes.extend(found.as_ref().ok().map(|(_, agreeing)| brought_in(state, *agreeing)));
    }
    if let Some(places) = places(tracked, stop)? {
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
