//! The stage of pixel matches between two states.

use rayon::prelude::*;

use super::{Event, Monitor, RunError};
use capture::{MatchConfig, PixelMatch, RgbdFrame, frame_pairs, match_states, on_object};
use common::note::{Note, NoteCode};
use io::OnnxMatcher;

const STAGE: &str = "match";

/// Matches from the user's model; else those `recorded` with the data; else those of the built-in features.
///
/// # Errors
/// A failure of the model, a stop request.
pub(super) fn pixel_matches(
    frames: [&[RgbdFrame]; 2],
    recorded: &[PixelMatch],
    matcher: Option<&OnnxMatcher>,
    config: &MatchConfig,
    monitor: &Monitor,
) -> Result<Vec<PixelMatch>, RunError> {
    match matcher {
        Some(matcher) => by_model(frames, matcher, config, monitor),
        None if recorded.is_empty() => Ok(match_states(frames, config)),
        None => Ok(recorded.to_vec()),
    }
}

/// Number of frame pairs for a model.
pub(super) fn pairs(frames: [&[RgbdFrame]; 2], config: &MatchConfig) -> usize {
    frame_pairs(frames, config.neighbors).len()
}

fn by_model(
    frames: [&[RgbdFrame]; 2],
    matcher: &OnnxMatcher,
    config: &MatchConfig,
    monitor: &Monitor,
) -> Result<Vec<PixelMatch>, RunError> {
    let pairs = frame_pairs(frames, config.neighbors);
    let mut matches = Vec::new();
    let mut done = 0;
    // As many at once as there are threads, so images and intermediate results of no more pairs are in
    // memory.
    for some in pairs.chunks(rayon::current_num_threads().max(1)) {
        monitor.check()?;
        let found: Vec<_> =
            some.par_iter().map(|&(i, j)| matcher.correspondences([&frames[0][i], &frames[1][j]])).collect();
        for (pair, found) in some.iter().zip(found) {
            let found = found.map_err(|e| RunError::stage(STAGE, e))?;
            matches.extend(on_object(frames, pair.0, pair.1, &found, config.onnx_min_confidence));
        }
        done += some.len();
        monitor.report(Event::Count { stage: STAGE.to_owned(), done, total: pairs.len() });
    }
    monitor.note(&Note::new(
        NoteCode::MatchesFound,
        format!("{} pixel matches on the object in {} pairs of frames", matches.len(), pairs.len()),
    ));
    Ok(matches)
}
