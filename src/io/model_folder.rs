//! A URDF folder, or a URDF and the files it names, read into memory.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use super::package_path::{is_plain, own_package, package_folder};
use common::files;
use common::limits::{METADATA, MODEL_FOLDER, URDF};
use export::{Folder, named_files};

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
        /// Error of the system.
        source: io::Error,
    },
    /// More than a model folder holds.
    #[error("{0} holds more than {MAX_FILES} files or 1 GiB: name the folder of one model")]
    TooLarge(PathBuf),
    /// A file of another kind.
    #[error("{0} is neither a folder nor a .urdf file")]
    NotUrdf(PathBuf),
}

/// Reads a model folder, or a URDF file with the files it names: meshes, their materials and textures, in
/// its folder and below, in the ROS package it belongs to and in other packages. Other files beside a
/// single URDF are ignored.
///
/// # Errors
/// As [`read_model_folder`], or if the file's extension is not `.urdf`.
pub fn read_model(path: &Path) -> Result<Folder, ModelFolderError> {
    if path.is_dir() {
        return read_model_folder(path);
    }
    let disk = |source| ModelFolderError::Disk { path: path.to_owned(), source };
    let urdf = files::read_limited(path, URDF).map_err(disk)?;
    if path.extension().is_none_or(|e| e != "urdf") {
        return Err(ModelFolderError::NotUrdf(path.to_owned()));
    }
    let (root, name) =
        root_and_name(path, &urdf).ok_or_else(|| ModelFolderError::NotUrdf(path.to_owned()))?;
    let mut left = MODEL_FOLDER.bytes;
    let mut found = Folder::new();
    if name.contains('/') {
        // Which package this is.
        let manifest = root.join("package.xml");
        let disk = |source| ModelFolderError::Disk { path: manifest.clone(), source };
        found.insert("package.xml".to_owned(), files::read_limited(&manifest, METADATA).map_err(disk)?);
    }
    let beside = name.rsplit_once('/').map_or("", |(own, _)| own).to_owned();
    let mut open = named_files(&found, &name, &urdf);
    found.insert(name, urdf);
    while let Some(inner) = open.pop() {
        let Some((key, full)) = located(&root, &beside, &inner, path) else { continue };
        if found.contains_key(&key) {
            continue;
        }
        let disk = |source| ModelFolderError::Disk { path: full.clone(), source };
        let bytes = files::read_limited(&full, MODEL_FOLDER).map_err(disk)?;
        let rest = left.checked_sub(bytes.len() as u64).filter(|_| found.len() < MAX_FILES);
        left = rest.ok_or_else(|| ModelFolderError::TooLarge(path.to_owned()))?;
        open.extend(named_files(&found, &key, &bytes));
        found.insert(key, bytes);
    }
    Ok(found)
}

/// The folder in which a URDF's files are looked for, and the URDF's path there: its own folder, or its
/// package where it names files elsewhere.
fn root_and_name(path: &Path, urdf: &[u8]) -> Option<(PathBuf, String)> {
    let name = path.file_name()?.to_str()?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let named = named_files(&Folder::new(), name, urdf);
    let packaged = named.iter().filter_map(|name| in_package(name));
    let is_elsewhere = packaged.map(|(_, inner)| inner).any(|inner| !is_plain(folder, inner));
    if !is_elsewhere && !String::from_utf8_lossy(urdf).contains("../") {
        return Some((folder.to_owned(), name.to_owned()));
    }
    let Some(root) = own_package(path) else { return Some((folder.to_owned(), name.to_owned())) };
    let absolute = std::path::absolute(path).ok()?;
    let inner = absolute.strip_prefix(&root).ok()?.to_str()?.replace('\\', "/");
    Some((root, inner))
}

/// Package and path of a name `package://PACKAGE/PATH`.
fn in_package(name: &str) -> Option<(&str, &str)> {
    name.strip_prefix("package://")?.split_once('/')
}

/// Where a named file lies, with its key in the folder in memory; `None` if it is not there. Links and
/// hidden names are left out, as a folder's reader leaves them out, too. `own` is the URDF's folder in
/// `root`.
fn located(root: &Path, own: &str, inner: &str, urdf: &Path) -> Option<(String, PathBuf)> {
    let Some((package, path)) = in_package(inner) else {
        return is_plain(root, inner).then(|| (inner.to_owned(), root.join(inner)));
    };
    // The URDF's folder stands for the package in what this program writes.
    let folder = root.join(own);
    if is_plain(&folder, path) {
        let key = if own.is_empty() { path.to_owned() } else { format!("{own}/{path}") };
        return Some((key, folder.join(path)));
    }
    let package = package_folder(package, urdf)?;
    is_plain(&package, path).then(|| (inner.to_owned(), package.join(path)))
}

fn disk_error(path: &Path, source: std::io::Error) -> ModelFolderError {
    ModelFolderError::Disk { path: path.to_owned(), source }
}

/// All regular files of a folder and of the folders below it, by relative path with `/`. Links and hidden
/// files are left out.
///
/// # Errors
/// An unreadable folder, or one with more than 20000 files or 1 GiB.
pub fn read_model_folder(folder: &Path) -> Result<Folder, ModelFolderError> {
    let mut found = Folder::new();
    let mut bytes = 0;
    let mut open = vec![(folder.to_owned(), String::new())];
    while let Some((path, prefix)) = open.pop() {
        for entry in fs::read_dir(&path).map_err(|e| disk_error(&path, e))? {
            let entry = entry.map_err(|e| disk_error(&path, e))?;
            let name = entry.file_name().to_string_lossy().into_owned();
            // The entry's own type: a link is neither folder nor file, so none is followed.
            let kind = entry.file_type().map_err(|e| disk_error(&entry.path(), e))?;
            // Version control and editors keep their own files there.
            if name.starts_with('.') {
                continue;
            }
            if kind.is_dir() {
                open.push((entry.path(), format!("{prefix}{name}/")));
            } else if kind.is_file() {
                bytes += entry.metadata().map_err(|e| disk_error(&entry.path(), e))?.len();
                if bytes > MODEL_FOLDER.bytes || found.len() >= MAX_FILES {
                    return Err(ModelFolderError::TooLarge(folder.to_owned()));
                }
                let content = files::read_limited(&entry.path(), MODEL_FOLDER)
                    .map_err(|e| disk_error(&entry.path(), e))?;
                found.insert(format!("{prefix}{name}"), content);
            }
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_urdf_is_read_with_what_it_names_and_nothing_else() {
        let temp = tempfile::tempdir().unwrap();
        let put = |path: &str, text: &str| {
            let path = temp.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        let mesh = |file: &str| format!("<mesh filename='{file}'/>");
        let named = ["m/a.obj", "m/gone.obj", "../x.obj", "m/.hidden.obj", "m"].map(mesh).concat();
        put("x.urdf", &format!("<robot>{named}</robot>"));
        put("m/a.obj", "mtllib a.mtl\nmtllib a.mtl\n");
        put("m/a.mtl", "map_Kd ./a.png\n");
        put("m/a.png", "png");
        put("m/.hidden.obj", "");
        put("m/other.obj", "");
        let keys = |folder: Folder| folder.into_keys().collect::<Vec<_>>();
        assert_eq!(
            keys(read_model(&temp.path().join("x.urdf")).unwrap()),
            ["m/a.mtl", "m/a.obj", "m/a.png", "x.urdf"]
        );
        assert_eq!(keys(read_model(temp.path()).unwrap()).len(), 5);
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(temp.path().join("m"), temp.path().join("link")).unwrap();
            put("l.urdf", &format!("<robot>{}</robot>", mesh("link/a.obj")));
            assert_eq!(keys(read_model(&temp.path().join("l.urdf")).unwrap()), ["l.urdf"]);
        }
        for (path, words) in [("m/a.obj", "neither a folder nor a .urdf"), ("none.urdf", "No such file")] {
            let why = read_model(&temp.path().join(path)).unwrap_err().to_string();
            assert!(why.contains(words), "{why}");
        }
    }
}
