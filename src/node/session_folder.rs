//! Folders of sessions and of what is made in them.

use std::{
    path::{Path, PathBuf},
    time::{SystemTime, UNIX_EPOCH},
};

/// A folder that is not there yet: by the name, or by the time.
pub(super) fn free_folder(out: &Path, name: &str) -> PathBuf {
    let base = if name.is_empty() {
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        format!("session_{seconds}")
    } else {
        name.to_owned()
    };
    let numbered = |k: usize| out.join(if k == 0 { base.clone() } else { format!("{base}_{k}") });
    // A session is never written over: the next free number is taken.
    (0..).map(numbered).find(|p| !p.exists()).unwrap_or_else(|| out.join(base))
}
