//! A result folder, visible under its name only when it is complete.

use std::{
    fs, io,
    path::{Component, Path, PathBuf},
};

use super::{
    Place,
    manifest::{Manifest, ResultKind},
    place::{Standing, taken},
    run_dir_error::{RunDirError, backup},
    sibling::{first_free, free_sibling},
};

use common::note::{Note, NoteCode};

/// Largest length of a relative path, bytes.
const MAX_PATH: usize = 240;

/// A folder being written beside its final place. Dropped before [`RunDir::commit`], it leaves nothing
/// behind.
#[derive(Debug)]
pub struct RunDir {
    place: Place,
    kind: ResultKind,
    partial: PathBuf,
    target: PathBuf,
    /// Folders created for it, the deepest first.
    made: Vec<PathBuf>,
    committed: bool,
}

/// A result that is in its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Committed {
    /// The result's folder.
    pub folder: PathBuf,
    /// New place of the previous contents, if `force` moved them.
    pub moved_to: Option<PathBuf>,
}

impl Committed {
    /// Note about the previous contents.
    #[must_use]
    pub fn note(&self) -> Option<Note> {
        let to = self.moved_to.as_ref()?;
        let text = format!("what stood at {} was moved to {}", self.folder.display(), to.display());
        Some(Note::new(NoteCode::MovedAside, text))
    }
}

impl RunDir {
    /// Starts the folder of a result; missing parent folders are created. Nothing appears under the final
    /// name yet.
    ///
    /// # Errors
    /// If the name is invalid, an input is at the result's place, its contents are protected ([`Place`]), or
    /// the disk refuses.
    pub fn open(place: &Place, kind: ResultKind) -> Result<Self, RunDirError> {
        let target = place.target()?;
        place.refuse(&target, kind)?;
        let out = parent(&target);
        // Those that are missing, so a failed run removes them again.
        let made: Vec<PathBuf> = out
            .ancestors()
            .take_while(|p| !p.as_os_str().is_empty() && !p.exists())
            .map(Path::to_owned)
            .collect();
        fs::create_dir_all(out).map_err(disk("make", out))?;
        let partial = free_sibling(out, target.file_name().unwrap_or_default(), "partial")?;
        Ok(Self { place: place.clone(), kind, partial, target, made, committed: false })
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
    /// A path that is absolute, empty, too long or contains `.` or `..`; an error of the disk.
    pub fn put(&self, path: &str, bytes: &[u8]) -> Result<(), RunDirError> {
        let file = self.partial.join(safe_path(path)?);
        if let Some(folder) = file.parent() {
            fs::create_dir_all(folder).map_err(disk("make", folder))?;
        }
        fs::write(&file, bytes).map_err(disk("write", &file))
    }

    /// Writes the manifest and moves the folder to its place, whose contents are checked again: an unchanged
    /// result of the same command is first moved away, moved back if the new one cannot take its place, and
    /// deleted at the end; anything else is refused or, with force, moved to `NAME.bak`.
    ///
    /// # Errors
    /// If the contents are protected, or the disk refuses. The previous contents then remain.
    pub fn commit(mut self) -> Result<Committed, RunDirError> {
        Manifest::write(&self.partial, self.kind).map_err(disk("describe", &self.partial))?;
        // Checked again, as hours may have passed and an input may have been moved there.
        self.place.spare_inputs(&self.target)?;
        let old = self.move_away()?;
        if let Err(source) = fs::rename(&self.partial, &self.target) {
            if let Some(old) = &old {
                fs::rename(old.path(), &self.target).map_err(disk("put back", &self.target))?;
            }
            return Err(RunDirError::Disk { what: "name", path: self.target.clone(), source });
        }
        self.committed = true;
        let mut moved_to = None;
        match old {
            // The new result is in its place: remains of the old one are no reason to fail.
            Some(Old::Ours(path)) => fs::remove_dir_all(path).unwrap_or_default(),
            Some(Old::Kept(path)) => moved_to = Some(path),
            None => {}
        }
        Ok(Committed { folder: self.target.clone(), moved_to })
    }

    /// Moves the contents of the result's place to another name beside it.
    fn move_away(&self) -> Result<Option<Old>, RunDirError> {
        match Standing::at(&self.target, self.kind) {
            Standing::Nothing => return Ok(None),
            Standing::Replaceable => {}
            Standing::Other(why) if !self.place.force => return Err(taken(&self.target, why)),
            Standing::Other(_) => return Ok(Some(Old::Kept(keep(&self.target)?))),
        }
        let away = free_sibling(parent(&self.target), self.target.file_name().unwrap_or_default(), "old")?;
        // Renaming onto an empty folder replaces it.
        fs::rename(&self.target, &away).map_err(disk("move away", &self.target))?;
        // Checked once more under the new name, as somebody may have edited it meanwhile.
        match Standing::at(&away, self.kind) {
            Standing::Other(why) => {
                fs::rename(&away, &self.target).map_err(disk("put back", &self.target))?;
                Err(taken(&self.target, why))
            }
            _ => Ok(Some(Old::Ours(away))),
        }
    }
}

impl Drop for RunDir {
    fn drop(&mut self) {
        if !self.committed {
            fs::remove_dir_all(&self.partial).ok();
            // A folder with other contents stays.
            self.made.iter().for_each(|folder| fs::remove_dir(folder).unwrap_or_default());
        }
    }
}

/// Previous contents of a result's place, under another name.
enum Old {
    /// An unchanged result of the same command.
    Ours(PathBuf),
    /// Anything else.
    Kept(PathBuf),
}

impl Old {
    fn path(&self) -> &Path {
        let (Self::Ours(path) | Self::Kept(path)) = self;
        path
    }
}

/// Moves a file or folder to the first free one of `NAME.bak`, `NAME.bak1`, ...; returns its new path.
fn keep(target: &Path) -> Result<PathBuf, RunDirError> {
    let is_folder = fs::symlink_metadata(target).is_ok_and(|m| m.is_dir());
    // Reserved first, so nothing with that name is overwritten: a folder replaces an empty folder, a
    // file a file.
    let reserve =
        |path: &Path| if is_folder { fs::create_dir(path) } else { fs::File::create_new(path).map(drop) };
    let to = first_free(|k| backup(target, k), reserve)?;
    fs::rename(target, &to).map_err(|source| {
        if is_folder { fs::remove_dir(&to) } else { fs::remove_file(&to) }.unwrap_or_default();
        RunDirError::Disk { what: "move away", path: target.to_owned(), source }
    })?;
    Ok(to)
}

/// The parent of a path.
fn parent(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn safe_path(path: &str) -> Result<&Path, RunDirError> {
    let bad = || RunDirError::Path(path.to_owned());
    let plain = path.chars().all(|c| c.is_ascii_alphanumeric() || "/._-".contains(c));
    // Names of parts become paths: none may lead out of the folder or differ between systems.
    if path.is_empty()
        || path.len() > MAX_PATH
        || !plain
        || path.split('/').any(|p| p.is_empty() || p == "." || p == "..")
    {
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

    const KIND: ResultKind = ResultKind::Reconstruct;

    /// Names of what is in a folder, sorted.
    fn names_in(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn open(place: &Place) -> RunDir {
        RunDir::open(place, KIND).unwrap()
    }

    /// A finished result of one file.
    fn finished(place: &Place, file: &str, text: &str) -> Committed {
        let run = open(place);
        run.put(file, text.as_bytes()).unwrap();
        run.commit().unwrap()
    }

    fn refused(place: &Place, kind: ResultKind) -> String {
        let early = place.check(kind, 0).unwrap_err().to_string();
        assert_eq!(RunDir::open(place, kind).unwrap_err().to_string(), early);
        early
    }

    #[test]
    fn nothing_is_there_before_the_commit_and_all_after_it() {
        let out = tempfile::tempdir().unwrap();
        let run = open(&Place::named(out.path(), "box"));
        run.put("report.json", b"{}").unwrap();
        run.put("meshes/visual/lid.obj", b"v 0 0 0").unwrap();
        assert!(!out.path().join("box").exists() && names_in(out.path()).len() == 1);
        assert_eq!(run.commit().unwrap(), Committed { folder: out.path().join("box"), moved_to: None });
        assert_eq!(names_in(out.path()), ["box"]);
        assert_eq!(fs::read(out.path().join("box/meshes/visual/lid.obj")).unwrap(), b"v 0 0 0");
    }

    #[test]
    fn a_dropped_run_leaves_the_earlier_one_and_no_folder() {
        let out = tempfile::tempdir().unwrap();
        let place = Place::named(out.path(), "box");
        finished(&place, "report.json", "first");
        let second = open(&place);
        second.put("report.json", b"second").unwrap();
        drop(second);
        assert_eq!(names_in(out.path()), ["box"]);
        assert_eq!(fs::read(out.path().join("box/report.json")).unwrap(), b"first");
        drop(open(&Place::named(out.path().join("new/runs"), "box")));
        assert_eq!(names_in(out.path()), ["box"]);
    }

    #[test]
    fn an_unchanged_result_of_the_same_command_is_replaced_as_a_whole() {
        let out = tempfile::tempdir().unwrap();
        let place = Place::named(out.path(), "box");
        finished(&place, "a.txt", "first");
        assert_eq!(finished(&place, "b.txt", "second").moved_to, None);
        assert_eq!(names_in(out.path()), ["box"]);
        assert!(!out.path().join("box/a.txt").exists() && out.path().join("box/b.txt").exists());
        // With force too: nothing is lost that the command did not write.
        let forced = finished(&Place { force: true, ..place }, "c.txt", "third");
        assert_eq!((forced.moved_to, names_in(out.path())), (None, vec!["box".to_owned()]));
    }

    #[test]
    fn anything_else_is_refused_with_what_it_is_and_a_remedy() {
        let out = tempfile::tempdir().unwrap();
        let place = |name: &str| Place::named(out.path(), name);
        for name in ["edited", "added", "kind", "older"] {
            finished(&place(name), "report.json", "{}");
        }
        fs::write(out.path().join("edited/report.json"), "mine").unwrap();
        (0..6).for_each(|k| fs::write(out.path().join(format!("added/note{k}.txt")), "mine").unwrap());
        fs::remove_file(out.path().join("older/manifest.json")).unwrap();
        fs::write(out.path().join("file"), "mine").unwrap();
        for (name, kind, why) in [
            ("edited", KIND, "since reconstruct wrote it, report.json was edited"),
            (
                "added",
                KIND,
                "since reconstruct wrote it, note0.txt was added, note1.txt was added, note2.txt was \
                 added, note3.txt was added and 2 more",
            ),
            ("kind", ResultKind::Synth, "it is a result of reconstruct, not of synth"),
            ("older", KIND, "it holds report.json, and no manifest.json that says which command wrote it"),
            ("file", KIND, "it is no folder"),
        ] {
            let path = out.path().join(name).display().to_string();
            let expected = format!(
                "{path} is left as it is: {why}; give another --out or --name, or --force, which moves it \
                 to {path}.bak"
            );
            assert_eq!(refused(&place(name), kind), expected);
        }
        fs::create_dir(out.path().join("empty")).unwrap();
        finished(&place("empty"), "report.json", "{}");
    }

    #[test]
    #[cfg(unix)]
    fn a_link_is_refused_however_it_is_written() {
        let out = tempfile::tempdir().unwrap();
        fs::create_dir(out.path().join("there")).unwrap();
        std::os::unix::fs::symlink(out.path().join("there"), out.path().join("link")).unwrap();
        std::os::unix::fs::symlink(out.path().join("nowhere"), out.path().join("dangling")).unwrap();
        for path in ["link", "link/", "link/.", "dangling", "dangling/"] {
            let reason = refused(&Place::at(out.path().join(path)), KIND);
            assert!(reason.contains("it is a link"), "{reason}");
        }
        let forced = finished(&Place { force: true, ..Place::at(out.path().join("link/")) }, "a.txt", "");
        assert_eq!(
            (forced.moved_to, forced.folder),
            (Some(out.path().join("link.bak")), out.path().join("link"))
        );
        assert!(
            out.path().join("link.bak").is_symlink()
                && out.path().join("there").read_dir().unwrap().next().is_none()
        );
        // A link to the folder around the result is followed.
        finished(&Place::named(out.path().join("link.bak"), "box"), "a.txt", "");
        assert!(out.path().join("there/box/a.txt").is_file());
    }

    #[test]
    fn force_moves_away_and_overwrites_no_earlier_copy() {
        let out = tempfile::tempdir().unwrap();
        let place = Place { force: true, ..Place::named(out.path(), "box") };
        for k in 0..3 {
            fs::create_dir_all(out.path().join("box")).unwrap();
            fs::write(out.path().join("box/notes.txt"), format!("{k}")).unwrap();
            let done = finished(&place, "report.json", "{}");
            assert_eq!(
                done.note().unwrap().text,
                format!(
                    "what stood at {0}/box was moved to {0}/box.bak{1}",
                    out.path().display(),
                    ["", "1", "2"][k]
                )
            );
        }
        assert_eq!(names_in(out.path()), ["box", "box.bak", "box.bak1", "box.bak2"]);
        for (name, text) in [("box.bak", "0"), ("box.bak1", "1"), ("box.bak2", "2")] {
            assert_eq!(fs::read_to_string(out.path().join(name).join("notes.txt")).unwrap(), text);
        }
        fs::remove_dir_all(out.path().join("box")).unwrap();
        fs::write(out.path().join("box"), "a file").unwrap();
        assert_eq!(finished(&place, "report.json", "{}").moved_to, Some(out.path().join("box.bak3")));
        assert_eq!(fs::read_to_string(out.path().join("box.bak3")).unwrap(), "a file");
    }

    #[test]
    fn what_was_edited_during_the_work_stays() {
        let out = tempfile::tempdir().unwrap();
        let place = Place::named(out.path(), "box");
        finished(&place, "report.json", "{}");
        let run = open(&place);
        run.put("report.json", b"[]").unwrap();
        fs::write(out.path().join("box/notes.txt"), "mine").unwrap();
        let reason = run.commit().unwrap_err().to_string();
        assert!(reason.contains("notes.txt was added"), "{reason}");
        assert_eq!(names_in(out.path()), ["box"]);
        assert_eq!(fs::read_to_string(out.path().join("box/report.json")).unwrap(), "{}");
    }

    #[test]
    fn an_input_is_never_in_the_results_place() {
        let out = tempfile::tempdir().unwrap();
        let bag = out.path().join("bags/one");
        let link = out.path().join("way");
        let deep = out.path().join("data");
        [&bag, &deep].iter().for_each(|f| fs::create_dir_all(f).unwrap());
        fs::write(deep.join("one.mcap"), "").unwrap();
        let mut cases = vec![
            (bag.clone(), bag.clone()),
            (out.path().join("bags"), bag.clone()),
            (out.path().join("bags"), out.path().join("data/../bags/one")),
            (out.path().join("data/../bags"), bag.clone()),
        ];
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(out.path().join("bags"), &link).unwrap();
            std::os::unix::fs::symlink(deep.join("one.mcap"), bag.join("one.mcap")).unwrap();
            cases.extend([
                (out.path().join("bags"), link.join("one")),
                (link.clone(), link.join("one")),
                (link.join("one"), bag.clone()),
                (deep, bag.clone()),
            ]);
        }
        for (target, input) in cases {
            let place = Place { force: true, inputs: vec![input.clone()], ..Place::at(&target) };
            let reason = refused(&place, KIND);
            assert!(
                reason.contains("is or holds the input"),
                "{} {}: {reason}",
                target.display(),
                input.display()
            );
        }
        let beside = Place { inputs: vec![bag.clone()], ..Place::at(bag.join("runs")) };
        finished(&beside, "a.txt", "");
    }

    #[test]
    fn a_disk_that_is_too_full_is_refused_before_the_work() {
        let out = tempfile::tempdir().unwrap();
        let reason = Place::named(out.path(), "box").check(KIND, u64::MAX).unwrap_err().to_string();
        assert!(
            reason.contains(" bytes free, and 18446744073709551615 at least are needed; make room"),
            "{reason}"
        );
        assert_eq!(names_in(out.path()), [""; 0]);
    }

    #[test]
    fn paths_out_of_the_folder_are_refused() {
        let out = tempfile::tempdir().unwrap();
        let run = open(&Place::named(out.path(), "box"));
        for path in [
            "",
            "/etc/passwd",
            "../x",
            "a/../../x",
            "a//b",
            "./a",
            "a/",
            "a\\..\\b",
            "C:x",
            "a\0b",
            &"a".repeat(300),
        ] {
            assert!(matches!(run.put(path, b""), Err(RunDirError::Path(_))), "{path}");
        }
        for name in ["", "..", "a/b", "1box", ".box", "a b"] {
            assert!(
                matches!(RunDir::open(&Place::named(out.path(), name), KIND), Err(RunDirError::Name(_))),
                "{name}"
            );
        }
        for path in [".", "..", "/", "box/.."] {
            assert!(matches!(RunDir::open(&Place::at(path), KIND), Err(RunDirError::NoName(_))), "{path}");
        }
    }
}
