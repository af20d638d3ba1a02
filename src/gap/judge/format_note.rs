//! Notes on files holding less of a joint than was found.

use crate::judge::{
    format_model::{Fate, FormatModel},
    report::JointReport,
};
use common::note::{Note, NoteCode};

/// Note on a file holding less than was found; `None` if it holds everything. `is_sole`: no file of the joint
/// holds any of it.
#[must_use]
pub fn format_note(held: &FormatModel, file: &str, joint: &JointReport, is_sole: bool) -> Option<Note> {
    let gap = joint.gap.as_ref().filter(|_| !held.is_whole())?;
    let name = &joint.joint;
    let unit = joint.gap_unit();
    let twin = held.twin_rmse;
    let own = held.rmse;
    let found = gap.after;
    if joint.diagnosis.findings.is_empty() {
        let text = format!(
            "{file} holds at joint '{name}' what stands in for something unknown: it leaves {own:.2e} {unit} \
             of the held-out runs, the twin {twin:.2e} {unit}; no effect in it is certain"
        );
        return Some(Note::new(NoteCode::UnknownStoodIn, text));
    }
    if !held.keeps_twin() {
        let text = format!(
            "{file} holds less than was found at joint '{name}': it leaves {own:.2e} {unit} of the \
             held-out runs, the twin {twin:.2e} {unit}, what was found {found:.2e} {unit}"
        );
        return Some(Note::new(NoteCode::FormatHoldsLess, text));
    }
    let is_kept = held.effects.iter().any(|e| e.fate == Fate::Kept);
    let why = if is_kept { "nothing that it holds predicts better" } else { "it has no place for any" };
    let text = format!(
        "{file} keeps the twin's values at joint '{name}' in place of the effects found, since {why}: \
         it leaves {twin:.2e} {unit} of the held-out runs, what was found {found:.2e} {unit}"
    );
    // Another file may be able to hold it.
    let is_loss = is_kept || is_sole;
    Some(Note::new(if is_loss { NoteCode::FormatKeepsTwin } else { NoteCode::FormatHoldsLess }, text))
}
