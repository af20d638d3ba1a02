//! Where a command's result goes, and when it may replace what is there.
//!
//! A command replaces only a folder that the same command wrote and that is unchanged since. An empty folder
//! may be used. Anything else is refused or, with `force`, moved to another name. A result never replaces an
//! input.

use std::{
    fs,
    path::{Path, PathBuf},
};

use super::{
    RunDirError, free_bytes,
    manifest::{MANIFEST, Manifest, ResultKind},
    sibling::free_sibling,
};
use model::is_plain_name;

/// Largest number of names and changes listed in a refusal.
const LISTED: usize = 4;
/// Largest number of entries of an input folder that are searched for links.
const MAX_ENTRIES: usize = 100_000;

/// Where a command's result goes, and which inputs are protected.
#[derive(Clone, Debug, Default)]
pub struct Place {
    /// Parent of the result's folder; without `name`, the result's folder itself.
    pub out: PathBuf,
    /// Name of the result's folder: a letter, then letters, digits and `_`.
    pub name: Option<String>,
    /// Whether protected contents are moved to `NAME.bak` instead of being refused.
    pub force: bool,
    /// Files and folders read by the command.
    pub inputs: Vec<PathBuf>,
}

impl Place {
    /// The folder `out` itself.
    pub fn at(out: impl Into<PathBuf>) -> Self {
        Self { out: out.into(), ..Self::default() }
    }

    /// The folder `out/name`.
    pub fn named(out: impl Into<PathBuf>, name: impl Into<String>) -> Self {
        Self { out: out.into(), name: Some(name.into()), ..Self::default() }
    }

    /// Where the result will be.
    ///
    /// # Errors
    /// If the name is invalid, or `out` has no last part, as in `.`.
    pub fn target(&self) -> Result<PathBuf, RunDirError> {
        match &self.name {
            Some(name) if is_plain_name(name) => Ok(self.out.join(name)),
            Some(name) => Err(RunDirError::Name(name.clone())),
            // Without a trailing slash, which would follow a link.
            None if self.out.file_name().is_some() => Ok(self.out.components().collect()),
            None => Err(RunDirError::NoName(self.out.clone())),
        }
    }

    /// Refuses a bad place before the work, not after it. Leaves nothing behind.
    ///
    /// # Errors
    /// Those of [`super::RunDir::open`]; [`RunDirError::Unwritable`] where `out`, or the folder it would
    /// be made in, cannot be written; [`RunDirError::Full`] where its disk has less than `least_bytes`.
    pub fn check(&self, kind: ResultKind, least_bytes: u64) -> Result<(), RunDirError> {
        let target = self.target()?;
        self.refuse(&target, kind)?;
        // `out` itself may not exist yet.
        let there = target.ancestors().skip(1).find(|p| p.exists()).unwrap_or(Path::new("."));
        let unwritable = |source| RunDirError::Unwritable { folder: there.to_owned(), source };
        // Permissions do not tell everything (read-only mounts, quotas, network disks), so a folder is
        // created.
        let probe = free_sibling(there, target.file_name().unwrap_or_default(), "probe").map_err(
            |error| match error {
                RunDirError::Disk { source, .. } => unwritable(source),
                other => other,
            },
        )?;
        fs::remove_dir(&probe).map_err(unwritable)?;
        match free_bytes(there) {
            Some(free) if free < least_bytes => {
                Err(RunDirError::Full { folder: there.to_owned(), least_bytes, free })
            }
            _ => Ok(()),
        }
    }

    /// Refuses a folder beside the result if it is a link or would take the place of an input.
    ///
    /// # Errors
    /// [`RunDirError::HoldsInput`], [`RunDirError::Taken`].
    pub fn check_beside(&self, folder: &Path) -> Result<(), RunDirError> {
        self.spare_inputs(folder)?;
        match fs::symlink_metadata(folder) {
            Ok(meta) if meta.is_symlink() => Err(taken(folder, "it is a link".to_owned())),
            _ => Ok(()),
        }
    }

    /// Refuses a target that is or contains an input and, without `force`, a protected one.
    pub(super) fn refuse(&self, target: &Path, kind: ResultKind) -> Result<(), RunDirError> {
        self.spare_inputs(target)?;
        match Standing::at(target, kind) {
            Standing::Other(why) if !self.force => Err(taken(target, why)),
            _ => Ok(()),
        }
    }

    /// Refuses a folder that is or holds an input.
    pub(super) fn spare_inputs(&self, folder: &Path) -> Result<(), RunDirError> {
        let Some(place) = own_place(folder) else { return Ok(()) };
        // Compared by whole components: `/a/bc` is not in `/a/b`.
        let held = self.inputs.iter().find(|input| places(input).iter().any(|p| p.starts_with(&place)));
        match held {
            Some(input) => Err(RunDirError::HoldsInput { folder: folder.to_owned(), input: input.clone() }),
            None => Ok(()),
        }
    }
}

/// What exists at a result's place.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Standing {
    Nothing,
    /// An empty folder, or an unchanged result of the same command.
    Replaceable,
    /// Anything else, described in a sentence.
    Other(String),
}

impl Standing {
    pub fn at(target: &Path, kind: ResultKind) -> Self {
        // Of the entry itself: a link is refused, wherever it leads.
        match fs::symlink_metadata(target) {
            Err(_) => Self::Nothing,
            Ok(meta) if meta.is_symlink() => Self::Other("it is a link".to_owned()),
            Ok(meta) if !meta.is_dir() => Self::Other("it is no folder".to_owned()),
            Ok(_) => match Manifest::read(target) {
                Some(manifest) if manifest.command != kind => {
                    Self::Other(format!("it is a result of {}, not of {kind}", manifest.command))
                }
                // Every file is compared, as a user's edits cannot be restored.
                Some(manifest) => match manifest.differences(target) {
                    Ok(changes) if changes.is_empty() => Self::Replaceable,
                    Ok(changes) => Self::Other(format!("since {kind} wrote it, {}", first(&changes))),
                    Err(error) => Self::Other(format!("it cannot be compared with its {MANIFEST}: {error}")),
                },
                None => Self::unknown(target),
            },
        }
    }

    /// A folder without manifest.
    fn unknown(target: &Path) -> Self {
        // Folders written before manifests existed also come here, and are refused.
        let entries = match fs::read_dir(target) {
            Ok(entries) => entries,
            Err(error) => return Self::Other(format!("it cannot be read: {error}")),
        };
        let mut names: Vec<String> = entries
            .take(MAX_ENTRIES)
            .flatten()
            .map(|e| e.file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        if names.is_empty() {
            return Self::Replaceable;
        }
        Self::Other(format!("it holds {}, and no {MANIFEST} that says which command wrote it", first(&names)))
    }
}

/// The refusal to replace what exists there.
pub(super) fn taken(target: &Path, why: String) -> RunDirError {
    RunDirError::Taken { path: target.to_owned(), why }
}

/// The first few of a list, and how many more there are.
fn first(list: &[String]) -> String {
    let shown = list[..list.len().min(LISTED)].join(", ");
    if list.len() > LISTED { format!("{shown} and {} more", list.len() - LISTED) } else { shown }
}

/// Absolute path of a folder entry: links on the way to it are followed, the entry itself is not; `None` if
/// it does not exist.
fn own_place(path: &Path) -> Option<PathBuf> {
    fs::symlink_metadata(path).ok()?;
    match (path.parent(), path.file_name()) {
        (Some(parent), Some(name)) => {
            let parent = if parent.as_os_str().is_empty() { Path::new(".") } else { parent };
            Some(fs::canonicalize(parent).ok()?.join(name))
        }
        _ => fs::canonicalize(path).ok(),
    }
}

/// All paths that an input needs: its own, those of links to it, and the targets of links in it.
fn places(input: &Path) -> Vec<PathBuf> {
    let mut places: Vec<PathBuf> =
        input.ancestors().filter(|a| !a.as_os_str().is_empty()).filter_map(own_place).collect();
    places.extend(fs::canonicalize(input));
    let mut open = if input.is_dir() { vec![input.to_owned()] } else { Vec::new() };
    let mut seen = 0;
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            seen += 1;
            match entry.file_type() {
                Ok(kind) if kind.is_symlink() => places.extend(fs::canonicalize(entry.path())),
                Ok(kind) if kind.is_dir() && seen < MAX_ENTRIES => open.push(entry.path()),
                _ => {}
            }
        }
    }
    places
}
