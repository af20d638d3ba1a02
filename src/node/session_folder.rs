//! Folders of sessions and of their results.

use std::{
    path::{Path, PathBuf},
    time::{SystemTime, UNIX_EPOCH},
};

/// A new folder, named by `name` or by the time.
pub(super) fn free_folder(out: &Path, name: &str) -> PathBuf {
    let base = if name.is_empty() {
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        format!("session_{seconds}")
    } else {
        name.to_owned()
    };
    // Sessions are never overwritten: the next free number is used.
    let mut folder = out.join(&base);
    let mut number = 0;
    while folder.exists() {
        number += 1;
        folder = out.join(format!("{base}_{number}"));
    }
    folder
}
