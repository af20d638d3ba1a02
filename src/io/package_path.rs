//! Where the files lie that a URDF names: beside it, or in packages of ROS.

use std::{
    env, fs,
    path::{Component, Path, PathBuf},
};

use super::urdf_fault::UrdfFault;
use common::files;
use common::limits::METADATA;
use export::package_name;

/// The file that makes a folder a ROS package.
const MANIFEST: &str = "package.xml";
/// Most folders above a URDF that are searched for its package.
const MAX_ABOVE: usize = 16;

/// The package that a URDF belongs to: the nearest folder above it with a `package.xml`.
pub(super) fn own_package(urdf: &Path) -> Option<PathBuf> {
    above(urdf).into_iter().find(|folder| folder.join(MANIFEST).is_file())
}

/// The folder of a URDF and those above it.
fn above(urdf: &Path) -> Vec<PathBuf> {
    let path = std::path::absolute(urdf).unwrap_or_else(|_| urdf.to_owned());
    path.ancestors().skip(1).take(MAX_ABOVE).map(Path::to_owned).collect()
}

/// The folder of a package for a URDF: above it, beside a folder above it, or where ROS looks
/// (`ROS_PACKAGE_PATH`, `AMENT_PREFIX_PATH`).
pub(super) fn package_folder(package: &str, urdf: &Path) -> Option<PathBuf> {
    // It becomes part of paths.
    if package.is_empty() || Path::new(package).components().any(|c| !matches!(c, Component::Normal(_))) {
        return None;
    }
    let above = above(urdf);
    if let Some(own) = above.iter().find(|folder| is_package(folder, package)) {
        return Some(own.clone());
    }
    let of_variable = |name: &str| env::var_os(name).map(|v| env::split_paths(&v).collect::<Vec<_>>());
    let ros1 = of_variable("ROS_PACKAGE_PATH").unwrap_or_default();
    let ament = of_variable("AMENT_PREFIX_PATH").unwrap_or_default();
    if let Some(own) = ros1.iter().find(|folder| is_package(folder, package)) {
        return Some(own.clone());
    }
    let shares = ament.iter().map(|prefix| prefix.join("share"));
    let around = above.iter().cloned().chain(ros1.iter().cloned()).chain(shares);
    around.map(|folder| folder.join(package)).find(|folder| is_package(folder, package))
}

/// Whether a folder is the package of a name.
fn is_package(folder: &Path, package: &str) -> bool {
    let manifest = folder.join(MANIFEST);
    manifest.is_file()
        && files::read_limited(&manifest, METADATA)
            .is_ok_and(|bytes| package_name(&bytes).as_deref() == Some(package))
}

/// The file of a mesh or texture that the URDF at a path names.
///
/// # Errors
/// [`UrdfFault::MeshElsewhere`] and [`UrdfFault::MeshOutside`]: a twin from elsewhere must not make the
/// program read other files of this machine than those below it and in packages.
pub(super) fn named_path(urdf: &Path, named: &str) -> Result<PathBuf, UrdfFault> {
    let folder = urdf.parent().unwrap_or(Path::new(""));
    let outside = || UrdfFault::MeshOutside(named.to_owned());
    if let Some(rest) = named.strip_prefix("package://") {
        let (package, path) = rest.split_once('/').unwrap_or((rest, ""));
        let path = below(path).ok_or_else(outside)?;
        // The URDF's folder stands for the package in what this program writes.
        let beside = folder.join(path);
        return match package_folder(package, urdf) {
            Some(found) if !beside.is_file() => Ok(found.join(path)),
            _ => Ok(beside),
        };
    }
    if named.contains("://") {
        return Err(UrdfFault::MeshElsewhere(named.to_owned()));
    }
    if let Some(path) = below(named) {
        return Ok(folder.join(path));
    }
    // `../meshes`: within the package.
    let path = normal(&above(urdf).into_iter().next().unwrap_or_default().join(named)).ok_or_else(outside)?;
    own_package(urdf).filter(|root| path.starts_with(root)).map(|_| path).ok_or_else(outside)
}

/// The path of a name that leads only down; `None` for any other.
pub(super) fn below(path: &str) -> Option<&Path> {
    let path = Path::new(path);
    let is_below = path.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    (is_below && !path.as_os_str().is_empty()).then_some(path)
}

/// The path without `.` and `..`.
fn normal(path: &Path) -> Option<PathBuf> {
    let mut found = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir if !found.pop() => return None,
            Component::ParentDir | Component::CurDir => {}
            other => found.push(other),
        }
    }
    Some(found)
}

/// Whether nothing on the way from `root` to a file in it is a link or hidden.
pub(super) fn is_plain(root: &Path, inner: &str) -> bool {
    let mut at = root.to_owned();
    inner.split('/').all(|part| {
        at.push(part);
        !part.starts_with('.') && fs::symlink_metadata(&at).is_ok_and(|m| m.is_dir() || m.is_file())
    }) && at.is_file()
}
