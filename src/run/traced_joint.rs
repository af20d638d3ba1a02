//! The joint behind tracks: files in, joint out.

use std::path::PathBuf;

use super::RunError;
use common::note::Note;
use gap::track::joint::{TracedJoint, joint_of_traces};

/// The joint behind recorded paths of its part: each file is an opening of the same mechanism. `of` names the
/// topic or the frame of a bag in which several things move.
///
/// # Errors
/// [`RunError`] where a file cannot be read or has too few samples.
pub fn joint_of_tracks(tracks: &[PathBuf], of: Option<&str>) -> Result<TracedJoint, RunError> {
    let mut traces = Vec::with_capacity(tracks.len());
    let mut notes: Vec<Note> = Vec::new();
    for path in tracks {
        let (trace, losses) = io::read_track(path, of).map_err(|e| RunError::stage("track", e))?;
        traces.push(trace);
        notes.extend(losses);
    }
    let mut joint = joint_of_traces(&traces).map_err(|e| RunError::stage("joint", e))?;
    notes.append(&mut joint.notes);
    Ok(TracedJoint { notes, ..joint })
}
