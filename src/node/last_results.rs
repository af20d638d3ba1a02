//! Saves the node's last results in the session folder, for a later node of the session to publish again.

use std::{
    io,
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::twin::Twin;
use ::io::{read_gap_report, read_run_summary, ros2msg::gap::GapReport};
use common::files;
use common::limits::FileLimit;

const TWIN_FILE: &str = "last_twin.json";
const REPORT_FILE: &str = "last_report.json";
/// Size limit of a note, which holds a few names and a sentence.
const NOTE: FileLimit = FileLimit { what: "a note of the node", bytes: 64 << 10 };

/// Saved reference to a twin; the rest is in its folder.
#[derive(Serialize, Deserialize)]
struct TwinNote {
    folder: PathBuf,
    state: usize,
    world_frame: String,
}

/// Saved reference to a diagnosis; the rest is in its folder.
#[derive(Serialize, Deserialize)]
struct ReportNote {
    folder: PathBuf,
    twin: String,
    summary: String,
}

/// Saves a reference to a twin. An error is only logged; the twin is published anyway.
pub(crate) fn note_twin(session: &Path, twin: &Twin) {
    let note = TwinNote {
        folder: path_in_session(session, &twin.summary.folder),
        state: twin.state,
        world_frame: twin.world_frame.clone(),
    };
    write_note(&session.join(TWIN_FILE), &note);
}

/// Saves a reference to a diagnosis.
pub(crate) fn note_report(session: &Path, report: &GapReport) {
    let folder = path_in_session(session, Path::new(&report.folder));
    write_note(
        &session.join(REPORT_FILE),
        &ReportNote { folder, twin: report.twin.clone(), summary: report.summary.clone() },
    );
}

/// The last twin of a session; `None` if there is none, or it is unreadable (logged).
#[must_use]
pub(crate) fn last_twin(session: &Path) -> Option<Twin> {
    let note: TwinNote = read_note(&session.join(TWIN_FILE))?;
    let summary = read_run_summary(&session.join(&note.folder));
    // A session remains usable without its twin, so the node starts anyway.
    let summary = summary.inspect_err(|e| log::warn!("the last twin is not published again: {e}")).ok()?;
    Some(Twin { summary, state: note.state, world_frame: note.world_frame })
}

/// The last diagnosis of a session; `None` if there is none, or it is unreadable (logged).
#[must_use]
pub(crate) fn last_report(session: &Path) -> Option<GapReport> {
    let note: ReportNote = read_note(&session.join(REPORT_FILE))?;
    let report = read_gap_report(&session.join(&note.folder));
    let report = report
        .inspect_err(|e| log::warn!("the last report is not published again: {e}; diagnose again"))
        .ok()?;
    Some(GapReport { twin: note.twin, summary: note.summary, ..report })
}

/// The folder by its name in the session, as sessions may be moved.
fn path_in_session(session: &Path, folder: &Path) -> PathBuf {
    folder.strip_prefix(session).unwrap_or(folder).to_owned()
}

fn write_note(path: &Path, note: &impl Serialize) {
    let text = serde_json::to_vec_pretty(note).map_err(io::Error::from);
    if let Err(error) = text.and_then(|text| files::write_whole(path, &text)) {
        log::warn!(
            "`{}` was not written: {error}; after a restart the node will not publish this again",
            path.display()
        );
    }
}

fn read_note<T: DeserializeOwned>(path: &Path) -> Option<T> {
    // A missing file is normal; a damaged one is logged.
    let text = match files::read_text(path, NOTE) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return None,
        text => text,
    };
    let note = text.and_then(|text| Ok(serde_json::from_str(&text)?));
    note.inspect_err(|e| log::warn!("`{}` is damaged and left out: {e}", path.display())).ok()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn what_is_noted_is_found_and_damage_is_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let session = folder.path().to_owned();
        fs::create_dir_all(session.join("gap_1")).unwrap();
        assert!(last_twin(&session).is_none() && last_report(&session).is_none());
        let folder = session.join("gap_1").display().to_string();
        let reported =
            GapReport { folder, twin: "t.urdf".into(), summary: "s".into(), ..GapReport::default() };
        note_report(&session, &reported);
        assert!(last_report(&session).is_none(), "the folder holds no report");
        let report = r#"{"verdict": "none", "findings": [], "gap": {"before": 1.0, "after": 1.0, "noise_floor": 1.0, "unit": "rad"}}"#;
        fs::write(session.join("gap_1/report.json"), report).unwrap();
        let found = last_report(&session).unwrap();
        assert_eq!(
            (found.verdict.as_str(), found.twin.as_str(), found.summary.as_str()),
            ("none", "t.urdf", "s")
        );
        for damage in ["", "{", r#"{"folder": 1}"#] {
            fs::write(session.join(REPORT_FILE), damage).unwrap();
            fs::write(session.join(TWIN_FILE), damage).unwrap();
            assert!(last_report(&session).is_none() && last_twin(&session).is_none(), "{damage}");
        }
    }
}
