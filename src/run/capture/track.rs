//! The camera tracked through recordings without poses: their views go through a tracker, some at a time.

use std::{fs, path::PathBuf};

use rayon::prelude::*;

use ::capture::{
    CaptureConfig, CaptureError, Lost, NoiseConfig, Observation, RgbdFrame, TrackedState, Tracker, UseBoard,
    find_board, noise_of, stamp_secs,
};
use common::ahead::Ahead;
use common::fingerprint::{Fingerprint, Key};
use common::limits::NAMED;
use common::note::{Note, NoteCode};
use common::stop::{Stop, Stopped};
use io::Recording;

/// Key of the camera's way through a state, from the files of its recording as they are now; `None` where one
/// is gone.
pub(super) fn tracked_key(files: &[PathBuf], config: &CaptureConfig, state: usize, seed: u64) -> Option<Key> {
    let mut facts = Fingerprint::default().with("seed", seed).with_settings("capture", config).ok()?;
    for path in files {
        let metadata = fs::metadata(path).ok()?;
        let changed = metadata.modified().ok()?;
        let file = format!("file {}", path.display());
        facts = facts.with(file, format!("{} bytes, {changed:?}", metadata.len()));
    }
    Some(facts.key(&format!("track/state{state}")))
}

/// Tracks the camera through some views of a recording, in the order of time; `passed` hears of every view.
///
/// # Errors
/// Those of the decoding; [`CaptureError::NotTracked`] where no two views hang together.
pub(super) fn track(
    recording: &Recording,
    of_state: &[usize],
    config: &CaptureConfig,
    (state, seed): (usize, u64),
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
        let look = |(view, frame): (usize, RgbdFrame)| {
            stop.check()?;
            let board = if config.board == UseBoard::Auto { find_board(&frame) } else { None };
            Ok((view, board, Observation::of_frame(frame, &noise, ahead)))
        };
        let observations: Vec<_> = frames.into_par_iter().map(look).collect::<Result<_, Stopped>>()?;
        for (view, board, observation) in observations {
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
    let stretch = |[first, last]: &[usize; 2]| {
        let why = Lost::most_frequent_reason(&reasons[*first..=*last]);
        let stamp = |v: usize| stamp_secs(views.views[seen[v]].stamp_nanos);
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
