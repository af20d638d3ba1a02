//! A run's output folder that appears under its name only when it is whole.

use std::{
    fs, io,
    path::{Component, Path, PathBuf},
};

use crate::model::is_plain_name;

/// Longest relative path, bytes.
const MAX_PATH: usize = 240;

/// Why a run folder could not be written.
#[derive(Debug, thiserror::Error)]
pub enum RunDirError {
    /// The name cannot be a folder's name.
    #[error("'{0}' cannot name an output folder: use letters, digits and _, beginning with a letter")]
    Name(String),
    /// A path leads out of the folder or cannot be a file name.
    #[error("'{0}' is no path inside the output folder")]
    Path(String),
    /// A folder of that name holds something else.
    #[error("{0} exists and is no earlier result (it has no report.json): choose another --out or move it away")]
    NotARun(PathBuf),
    /// Nothing can be written there.
    #[error("cannot write into {}; choose another --out or make it writable", folder.display())]
    Unwritable {
        /// The folder, or the nearest one above it that is there.
        folder: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The disk refused.
    #[error("cannot {what} {path}: {source}")]
    Disk {
        /// What was tried.
        what: &'static str,
        /// With which path.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// A folder being written beside its final place. Dropped before [`RunDir::commit`], it leaves nothing behind.
#[derive(Debug)]
pub struct RunDir {
    partial: PathBuf,
    target: PathBuf,
    committed: bool,
}

impl RunDir {
    /// Refuses early what [`Self::create`] would refuse at the end of a run. Leaves nothing behind.
    ///
    /// # Errors
    /// Those of [`Self::create`]; [`RunDirError::Unwritable`] where `out`, or the folder that it would be made in, cannot be
    /// written.
    pub fn check(out: &Path, name: &str) -> Result<(), RunDirError> {
        if !is_plain_name(name) {
            return Err(RunDirError::Name(name.to_owned()));
        }
        check_replaceable(&out.join(name))?;
        let there = out.ancestors().find(|p| p.exists()).unwrap_or(Path::new("."));
        let unwritable = |source| RunDirError::Unwritable { folder: there.to_owned(), source };
        let probe = free_sibling(there, name, "probe").map_err(|error| match error {
            RunDirError::Disk { source, .. } => unwritable(source),
            other => other,
        })?;
        fs::remove_dir(&probe).map_err(unwritable)
    }

    /// Starts the folder `out/name`; `out` is made where it is missing. Nothing appears under the final name yet.
    ///
    /// # Errors
    /// A name other than `[A-Za-z][A-Za-z0-9_]*`; a file or a foreign folder of that name; a disk that refuses.
    pub fn create(out: &Path, name: &str) -> Result<Self, RunDirError> {
        if !is_plain_name(name) {
            return Err(RunDirError::Name(name.to_owned()));
        }
        let target = out.join(name);
        check_replaceable(&target)?;
        fs::create_dir_all(out).map_err(disk("make", out))?;
        let partial = free_sibling(out, name, "partial")?;
        Ok(Self { partial, target, committed: false })
    }

    /// Starts the folder `target`, whatever its name, under the same conditions.
    ///
    /// # Errors
    /// A path without a last part; a file or a foreign folder there; a disk that refuses.
    pub fn replace(target: &Path) -> Result<Self, RunDirError> {
        let name = target.file_name().map(|n| n.to_string_lossy().into_owned());
        let name = name.ok_or_else(|| RunDirError::Name(target.display().to_string()))?;
        let out = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        check_replaceable(target)?;
        fs::create_dir_all(out).map_err(disk("make", out))?;
        let partial = free_sibling(out, &name, "partial")?;
        Ok(Self { partial, target: target.to_owned(), committed: false })
    }

    /// Where the folder will be.
    #[must_use]
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Where the files are until [`Self::commit`].
    #[must_use]
    pub fn working(&self) -> &Path {
        &self.partial
    }

    /// Writes a file at a relative path with `/`, making folders on the way.
    ///
    /// # Errors
    /// A path that is absolute, empty, too long or has `.` or `..` in it; a disk that refuses.
    pub fn put(&self, path: &str, bytes: &[u8]) -> Result<(), RunDirError> {
        let file = self.partial.join(safe_path(path)?);
        if let Some(folder) = file.parent() {
            fs::create_dir_all(folder).map_err(disk("make", folder))?;
        }
        fs::write(&file, bytes).map_err(disk("write", &file))
    }

    /// Puts the folder in its place and returns it. An earlier result of that name is moved away first, put back if the
    /// new one cannot take its place, and deleted at the end.
    ///
    /// # Errors
    /// A disk that refuses; the earlier result is then still there.
    pub fn commit(mut self) -> Result<PathBuf, RunDirError> {
        check_replaceable(&self.target)?;
        let old = match self.target.exists() {
            false => None,
            true => {
                let (out, name) = (self.target.parent().unwrap_or(Path::new(".")), self.target.file_name().unwrap_or_default());
                let away = free_sibling(out, &name.to_string_lossy(), "old")?;
                // Renaming onto an empty folder replaces it.
                fs::rename(&self.target, &away).map_err(disk("move away", &self.target))?;
                Some(away)
            }
        };
        if let Err(source) = fs::rename(&self.partial, &self.target) {
            if let Some(away) = &old {
                fs::rename(away, &self.target).map_err(disk("put back", &self.target))?;
            }
            return Err(RunDirError::Disk { what: "name", path: self.target.clone(), source });
        }
        self.committed = true;
        if let Some(away) = old {
            // The new result is in its place: a rest of the old one is no reason to fail.
            fs::remove_dir_all(&away).ok();
        }
        Ok(self.target.clone())
    }
}

impl Drop for RunDir {
    fn drop(&mut self) {
        if !self.committed {
            fs::remove_dir_all(&self.partial).ok();
        }
    }
}

/// Refuses to replace what is not an earlier result: a file, a link, or a folder with other contents.
fn check_replaceable(target: &Path) -> Result<(), RunDirError> {
    let Ok(meta) = fs::symlink_metadata(target) else { return Ok(()) };
    let empty = || fs::read_dir(target).is_ok_and(|mut entries| entries.next().is_none());
    if meta.is_dir() && (target.join("report.json").is_file() || empty()) {
        return Ok(());
    }
    Err(RunDirError::NotARun(target.to_owned()))
}

/// Makes a hidden folder `.<name>.<suffix>-<process>-<k>` that was not there before.
fn free_sibling(out: &Path, name: &str, suffix: &str) -> Result<PathBuf, RunDirError> {
    for k in 0.. {
        let path = out.join(format!(".{name}.{suffix}-{}-{k}", std::process::id()));
        match fs::create_dir(&path) {
            Ok(()) => return Ok(path),
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists && k < 1000 => {}
            Err(source) => return Err(RunDirError::Disk { what: "make", path, source }),
        }
    }
    unreachable!("the loop returns")
}

fn safe_path(path: &str) -> Result<&Path, RunDirError> {
    let bad = || RunDirError::Path(path.to_owned());
    let plain = path.chars().all(|c| c.is_ascii_alphanumeric() || "/._-".contains(c));
    if path.is_empty() || path.len() > MAX_PATH || !plain || path.split('/').any(|p| p.is_empty() || p == "." || p == "..") {
        return Err(bad());
    }
    let path = Path::new(path);
    if path.components().all(|c| matches!(c, Component::Normal(_))) { Ok(path) } else { Err(bad()) }
}

fn disk(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> RunDirError {
    let path = path.to_owned();
    move |source| RunDirError::Disk { what, path, source }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Temp(PathBuf);

    impl Temp {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("artitwin-run-dir-{name}-{}", std::process::id()));
            fs::remove_dir_all(&path).ok();
            Self(path)
        }

        fn names(&self) -> Vec<String> {
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

    #[test]
    fn nothing_is_there_before_the_commit_and_all_after_it() {
        let out = Temp::new("commit");
        let run = RunDir::create(&out.0, "box").unwrap();
        run.put("report.json", b"{}").unwrap();
        run.put("meshes/visual/lid.obj", b"v 0 0 0").unwrap();
        assert!(!out.0.join("box").exists() && out.names().len() == 1);
        assert_eq!(run.commit().unwrap(), out.0.join("box"));
        assert_eq!(out.names(), ["box"]);
        assert_eq!(fs::read(out.0.join("box/meshes/visual/lid.obj")).unwrap(), b"v 0 0 0");
    }

    #[test]
    fn a_dropped_run_leaves_the_earlier_one() {
        let out = Temp::new("drop");
        let first = RunDir::create(&out.0, "box").unwrap();
        first.put("report.json", b"first").unwrap();
        first.commit().unwrap();
        let second = RunDir::create(&out.0, "box").unwrap();
        second.put("report.json", b"second").unwrap();
        drop(second);
        assert_eq!(out.names(), ["box"]);
        assert_eq!(fs::read(out.0.join("box/report.json")).unwrap(), b"first");
    }

    #[test]
    fn an_earlier_run_is_replaced_as_a_whole() {
        let out = Temp::new("replace");
        for (file, text) in [("a.txt", "first"), ("b.txt", "second")] {
            let run = RunDir::create(&out.0, "box").unwrap();
            run.put("report.json", text.as_bytes()).unwrap();
            run.put(file, b"").unwrap();
            run.commit().unwrap();
        }
        assert_eq!(out.names(), ["box"]);
        assert!(!out.0.join("box/a.txt").exists() && out.0.join("box/b.txt").exists());
    }

    #[test]
    fn a_foreign_folder_is_not_replaced() {
        let out = Temp::new("foreign");
        fs::create_dir_all(out.0.join("src")).unwrap();
        fs::write(out.0.join("src/main.rs"), "fn main() {}").unwrap();
        let error = RunDir::create(&out.0, "src").unwrap_err().to_string();
        assert!(error.contains("no earlier result"), "{error}");
        fs::create_dir_all(out.0.join("empty")).unwrap();
        let run = RunDir::create(&out.0, "empty").unwrap();
        run.put("report.json", b"{}").unwrap();
        run.commit().unwrap();
        assert_eq!(out.names(), ["empty", "src"]);
    }

    #[test]
    fn paths_out_of_the_folder_are_refused() {
        let out = Temp::new("paths");
        let run = RunDir::create(&out.0, "box").unwrap();
        for path in ["", "/etc/passwd", "../x", "a/../../x", "a//b", "./a", "a/", "a\\..\\b", "C:x", "a\0b", &"a".repeat(300)] {
            assert!(matches!(run.put(path, b""), Err(RunDirError::Path(_))), "{path}");
        }
        for name in ["", "..", "a/b", "1box", ".box", "a b"] {
            assert!(matches!(RunDir::create(&out.0, name), Err(RunDirError::Name(_))), "{name}");
        }
    }
}
