//! A folder for tests.

use std::{fs, path::PathBuf};

/// A folder under the system's temporary directory that goes away with the value.
pub struct Temp(pub PathBuf);

impl Temp {
    /// A fresh empty folder. Where it cannot be made, the test fails at its first file.
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("artitwin-{name}-{}", std::process::id()));
        fs::remove_dir_all(&path).ok();
        fs::create_dir_all(&path).ok();
        Self(path)
    }

    /// Names of what is in it, sorted.
    pub fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.0).into_iter().flatten().flatten();
        let mut names: Vec<_> = entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
}

impl Drop for Temp {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.0).ok();
    }
}
