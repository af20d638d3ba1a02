//! Folders of sessions and of their results.

use std::{
    path::{Path, PathBuf},
    time::{SystemTime, UNIX_EPOCH},
};

/// A new folder: by the name, or by the time.
pub(super) fn free_folder(out: &Path, name: &str) -> PathBuf {
    let base = if name.is_empty() {
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        format!("session_{seconds}")
    } else {
        name.to_owned()
    };
    // A session is never written over: the next free number is taken.
    let mut folder = out.join(&base);
    let mut number = 0;
    while folder.exists() {
        number += 1;
        folder = out.join(format!("{base}_{number}"));
    }
    folder
}
