//! Tracks the camera through recordings without poses: their views go through a tracker, some at a time.

use std::{fs, path::PathBuf};

use rayon::prelude::*;

use ::capture::{
    BoardSighting, CaptureConfig, CaptureError, Lost, NoiseConfig, Observation, RgbdFrame, TrackedState,
    Tracker, UseBoard, find_board, noise_of, stamp_secs,
};
use common::ahead::Ahead;
use common::fingerprint::{Fingerprint, Key};
use common::limits::NAMED;
use common::note::{Note, NoteCode};
use common::stop::{Stop, Stopped};
use io::Recording;

/// Key of the camera's trajectory through a state, from the files of its recording as they are now; `None` if
/// one is gone.
pub(super) fn tracked_key(
    files: &[PathBuf],
    config: &CaptureConfig,
    StateSeed { state, seed }: StateSeed,
) -> Option<Key> {
    let mut facts = Fingerprint::default().with("seed", seed).with_settings("capture", config).ok()?;
    for path in files {
        let metadata = fs::metadata(path).ok()?;
        let changed = metadata.modified().ok()?;
        let file = format!("file {}", path.display());
        facts = facts.with(file, format!("{} bytes, {changed:?}", metadata.len()));
    }
    Some(facts.key(&format!("track/state{state}")))
}

/// A state, with the seed of the run.
#[derive(Clone, Copy)]
pub(super) struct StateSeed {
    /// Number of the state.
    pub state: usize,
    /// Seed of the run.
    pub seed: u64,
}

/// Tracks the camera through some views of a recording, in the order of time; `passed` is called with every
/// view.
///
/// # Errors
/// Those of decoding; [`CaptureError::NotTracked`] if no two views can be connected.
pub(super) fn track(
    recording: &Recording,
    of_state: &[usize],
    config: &CaptureConfig,
    StateSeed { state, seed }: StateSeed,
    ahead: &Ahead,
    stop: &Stop,
    passed: &mut dyn FnMut(),
) -> Result<TrackedState, CaptureError> {
    let views = &recording.views;
    let mut tracker = Tracker::new(seed ^ state as u64);
    let mut seen = Vec::new();
    let mut boards = Vec::new();
    let mut reasons = Vec::new();
    let mut known_noise: Option<NoiseConfig> = None;
    for frames in recording.blocks(of_state, config, stop) {
        let frames = frames?;
        let noise = match known_noise {
            Some(noise) => noise,
            None => noise_of(frames.iter().map(|(_, f)| f), config, stop)?,
        };
        known_noise = Some(noise);
        let looked_at: Vec<LookedAt> = frames
            .into_par_iter()
            .map(|(view, frame)| look(view, frame, config, &noise, ahead, stop))
            .collect::<Result<_, Stopped>>()?;
        for LookedAt { view, board, observation } in looked_at {
            stop.check()?;
            seen.push(view);
            boards.push(board);
            reasons.push(tracker.add(observation).err());
            passed();
        }
    }
    let mut track = tracker.finish(stop)?;
    if track.findings.tracked < 2 {
        return Err(CaptureError::NotTracked {
            state,
            views: seen.len(),
            why: Lost::most_frequent_reason(&reasons),
        });
    }
    track.measured_up = views.accelerometer.as_ref().map(|a| track.up_of(a));
    let notes = vec![Note::new(NoteCode::CameraTracked, format!("state {state}: {}", track.findings))];
    let mut warnings = Vec::new();
    for &[first, last] in track.findings.lost.iter().take(NAMED) {
        let why = Lost::most_frequent_reason(&reasons[first..=last]);
        let [from_s, to_s] = [first, last].map(|v| stamp_secs(views.views[seen[v]].stamp_nanos));
        let count = last - first + 1;
        let text = format!(
            "state {state}: the camera was lost from {from_s:.3} to {to_s:.3} s ({count} views), which are \
             not used: {why}"
        );
        warnings.push(Note::new(NoteCode::ViewsLost, text));
    }
    if let Some(more) = track.findings.lost.len().checked_sub(NAMED).filter(|n| *n > 0) {
        let text = format!("state {state}: the camera was lost in {more} more stretches");
        warnings.push(Note::new(NoteCode::ViewsLost, text));
    }
    Ok(TrackedState { track, views: seen, boards, notes, warnings })
}

/// A view prepared for the tracker.
struct LookedAt {
    view: usize,
    board: Option<BoardSighting>,
    observation: Observation,
}

/// Looks for the board and the features of a view.
///
/// # Errors
/// [`Stopped`].
fn look(
    view: usize,
    frame: RgbdFrame,
    config: &CaptureConfig,
    noise: &NoiseConfig,
    ahead: &Ahead,
    stop: &Stop,
) -> Result<LookedAt, Stopped> {
    stop.check()?;
    let board = if config.board == UseBoard::Auto { find_board(&frame) } else { None };
    Ok(LookedAt { view, board, observation: Observation::of_frame(frame, noise, ahead) })
}
