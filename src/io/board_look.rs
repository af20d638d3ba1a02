//! Checks in a few views whether a recording shows a printed board of tags.

use rayon::prelude::*;

use super::{bag::Bag, pixels::decode_views, views::Views};
use capture::{CaptureConfig, UseBoard, find_board};
use common::note::{Note, NoteCode};
use common::stop::Stop;

/// Number of inspected views, spread over the recording.
const LOOKED_AT: usize = 6;

/// A note about a board; `None` if no board is seen or looked for.
pub(super) fn board_note(bag: &Bag, views: &Views, config: &CaptureConfig) -> Option<Note> {
    let count = views.views.len();
    if config.board == UseBoard::Never || count == 0 {
        return None;
    }
    let some = count.min(LOOKED_AT);
    let chosen: Vec<(usize, usize)> = (0..some).map(|k| (0, (2 * k + 1) * count / (2 * some))).collect();
    // Undecodable images show no board; the reason is reported elsewhere.
    let frames = decode_views(bag, views, &chosen, config, &Stop::never()).ok()?.frames;
    let found: Vec<_> = frames.par_iter().filter_map(|(_, frame)| find_board(frame)).collect();
    let paper = found.first()?.paper.name();
    let use_of_it = match views.are_untracked() {
        true => "it gives the recording its lengths and its world",
        false => "it is not used, as the recording has camera poses; capture.tracking=always would use it",
    };
    let text = format!(
        "a board of tags ({paper}) is seen in {} of {some} views looked at: {use_of_it}",
        found.len()
    );
    Some(Note::new(NoteCode::BoardSeen, text))
}
