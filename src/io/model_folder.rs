//! A URDF folder read into memory.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use crate::{export::Folder, files, limits::MODEL_FOLDER};

/// Most files.
const MAX_FILES: usize = 20_000;

/// Why a folder could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ModelFolderError {
    /// The disk refused.
    #[error("cannot read {path}: {source}")]
    Disk {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// More than a model folder holds.
    #[error("{0} holds more than {MAX_FILES} files or 1 GiB: name the folder of one model")]
    TooLarge(PathBuf),
}

/// All regular files of a folder and of the folders below it, by relative path with `/`. Links and hidden
/// files are left out.
///
/// # Errors
/// A folder that cannot be read, or holds more than 20000 files or 1 GiB.
pub fn read_model_folder(folder: &Path) -> Result<Folder, ModelFolderError> {
    let mut found = Folder::new();
    let mut bytes = 0;
    let mut open = vec![(folder.to_owned(), String::new())];
    while let Some((path, prefix)) = open.pop() {
        let disk = |path: &Path| {
            let path = path.to_owned();
            move |source| ModelFolderError::Disk { path, source }
        };
        for entry in fs::read_dir(&path).map_err(disk(&path))? {
            let entry = entry.map_err(disk(&path))?;
            let name = entry.file_name().to_string_lossy().into_owned();
            // The entry's own type: a link is neither folder nor file, so none is followed.
            let kind = entry.file_type().map_err(disk(&entry.path()))?;
            // Version control and editors keep their own files there.
            if name.starts_with('.') {
                continue;
            }
            if kind.is_dir() {
                open.push((entry.path(), format!("{prefix}{name}/")));
            } else if kind.is_file() {
                bytes += entry.metadata().map_err(disk(&entry.path()))?.len();
                if bytes > MODEL_FOLDER.bytes || found.len() >= MAX_FILES {
                    return Err(ModelFolderError::TooLarge(folder.to_owned()));
                }
                let content = files::read(&entry.path(), MODEL_FOLDER).map_err(disk(&entry.path()))?;
                found.insert(format!("{prefix}{name}"), content);
            }
        }
    }
    Ok(found)
}
