//! The views of all states with their poses: those that were recorded, or those of a camera that is tracked.

use std::{collections::BTreeMap, path::PathBuf};

use super::{
    bag::Bag,
    bag_index::BagIndex,
    tracked_state::TrackedState,
    tracking::{track, worlds},
    views::Views,
};
use capture::{Capture, CaptureConfig, CaptureError, TrackCamera, stretched};
use common::ahead::Ahead;
use geometry::Pose;

/// The bags of all states, a bag a state, with their views; the camera is tracked where none has poses.
pub(super) fn posed_states(
    capture: &mut Capture,
    paths: &[PathBuf],
    config: &CaptureConfig,
    seed: u64,
    ahead: &Ahead,
) -> Result<Vec<(Bag, Views)>, CaptureError> {
    let mut recordings = Vec::new();
    for (state, path) in paths.iter().enumerate() {
        let bag = Bag::open(path)?;
        let views = Views::find(&bag, &BagIndex::read(&bag)?, config, state)?;
        recordings.push((bag, views));
    }
    // All states or none: poses of one say nothing of another state's map.
    if recordings.iter().any(|(_, views)| views.are_untracked()) {
        let always = CaptureConfig { tracking: TrackCamera::Always, ..config.clone() };
        for (state, (bag, views)) in recordings.iter_mut().enumerate() {
            if !views.are_untracked() {
                *views = Views::find(bag, &BagIndex::read(bag)?, &always, state)?;
            }
        }
    }
    if recordings.iter().all(|(_, views)| views.are_untracked()) {
        let mut tracked = Vec::new();
        for (state, (bag, views)) in recordings.iter().enumerate() {
            let all: Vec<usize> = (0..views.views.len()).collect();
            let known = TrackedState::key(bag, config, (state, seed)).and_then(|key| ahead.take(&key));
            tracked.push(match known {
                Some(known) => known,
                None => track(bag, views, &all, config, (state, seed), ahead)?,
            });
        }
        let worlds = worlds(&tracked, seed, &mut capture.notes, &mut capture.warnings)?;
        capture.board = worlds.board;
        for ((tracked, world), (_, views)) in tracked.into_iter().zip(worlds.from_maps).zip(&mut recordings) {
            give_poses(capture, views, tracked, (&world, worlds.scale));
        }
    }
    Ok(recordings)
}

/// Gives tracked views of a state their poses in the world, and their depth its length.
pub(super) fn give_poses(
    capture: &mut Capture,
    views: &mut Views,
    tracked: TrackedState,
    (world_from_map, scale): (&Pose, f64),
) {
    let TrackedState { track, views: seen, boards, notes, warnings } = tracked;
    let mut sightings = BTreeMap::new();
    for ((view, pose), board) in seen.into_iter().zip(track.poses).zip(boards) {
        let view = &mut views.views[view];
        view.world_from_camera = pose.map(|pose| world_from_map * stretched(&pose, scale));
        sightings.extend(board.map(|board| (view.stamp_nanos, board)));
    }
    views.depth_factor = scale;
    if let Some(board) = &mut capture.board {
        board.sightings.push(sightings);
    }
    capture.tracking.push(track.findings);
    capture.notes.extend(notes);
    capture.warnings.extend(warnings);
}
