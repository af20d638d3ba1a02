//! Frames of an object as BundleSDF and FoundationPose take them (<https://github.com/NVlabs/BundleSDF>):
//! `rgb/`, `depth/` (16-bit PNG, millimeters) and `masks/` with the same names, `cam_K.txt`, and poses if
//! there are any.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use super::{
    ImageFile, ImageFolder, Shown, made_stamp,
    text::{matrix, numbers, pose_of_matrix},
};
use crate::dataset::files::{MAX_FRAMES, image_size, refuse};
use capture::CaptureError;
use geometry::Pose;

/// Folders of color images.
const COLOR: [&str; 3] = ["rgb", "color", "images"];
/// Folders of masks.
const MASKS: [&str; 3] = ["masks", "mask", "gt_mask"];
/// Files of the camera matrix.
const MATRIX: [&str; 2] = ["cam_K.txt", "K.txt"];
/// Folders of poses of the object in the camera: what BundleSDF writes, and YCBInEOAT has.
const OBJECT_IN_CAMERA: [&str; 2] = ["ob_in_cam", "annotated_poses"];
/// Folders of poses of the camera, in the world or in the object.
const CAMERA_IN_WORLD: [&str; 4] = ["cam_in_ob", "poses", "pose", "camera_poses"];

fn first_of(folder: &Path, names: &[&str]) -> Option<PathBuf> {
    names.iter().map(|n| folder.join(n)).find(|p| p.exists())
}

/// Whether a folder has the form.
pub(super) fn is_at(folder: &Path) -> bool {
    first_of(folder, &COLOR).is_some_and(|p| p.is_dir())
        && folder.join("depth").is_dir()
        && first_of(folder, &MATRIX).is_some()
}

/// Lists the files of a folder.
///
/// # Errors
/// [`CaptureError::Dataset`] and [`CaptureError::Read`].
pub(super) fn open(folder: &Path) -> Result<ImageFolder, CaptureError> {
    let colors = by_stem(&first_of(folder, &COLOR).unwrap_or_default(), &["png", "jpg", "jpeg"])?;
    let depths = by_stem(&folder.join("depth"), &["png"])?;
    let masks = match first_of(folder, &MASKS) {
        Some(masks) => by_stem(&masks, &["png"])?,
        None => BTreeMap::new(),
    };
    let object = first_of(folder, &OBJECT_IN_CAMERA);
    let pose_files = match object.clone().or_else(|| first_of(folder, &CAMERA_IN_WORLD)) {
        Some(poses) => by_stem(&poses, &["txt"])?,
        None => BTreeMap::new(),
    };
    let mut images = Vec::new();
    let mut poses = Vec::new();
    for (index, (stem, color)) in colors.iter().enumerate() {
        let stamp_nanos = made_stamp(index);
        images.push(ImageFile { stamp_nanos, shown: Shown::Color, path: color.clone() });
        let depth = depths.get(stem).map(|p| (Shown::Depth(None), p));
        let mask = masks.get(stem).map(|p| (Shown::Mask, p));
        for (shown, path) in depth.into_iter().chain(mask) {
            images.push(ImageFile { stamp_nanos, shown, path: path.clone() });
        }
        if let Some(path) = pose_files.get(stem) {
            let pose = pose_of_matrix(path, stem, &numbers(path)?)?;
            poses.push((stamp_nanos, world_from_camera(pose, object.is_some())));
        }
    }
    let Some(first) = colors.values().next() else { return refuse(folder, "it has no color image") };
    let camera = first_of(folder, &MATRIX).unwrap_or_default();
    let matrices = vec![(made_stamp(0), matrix(&camera, image_size(first)?)?)];
    Ok(ImageFolder {
        form: "object frames",
        images,
        matrices,
        depth_size: (0, 0),
        poses,
        depth_unit_m: 0.001,
        is_y_up: false,
    })
}

/// The camera's pose; that of an object in the camera is turned around: the object is the world.
fn world_from_camera(pose: Pose, is_of_object: bool) -> Pose {
    if is_of_object { pose.inverse() } else { pose }
}

/// The files of a folder with one of the extensions, by their names without it.
pub(super) fn by_stem(folder: &Path, extensions: &[&str]) -> Result<BTreeMap<String, PathBuf>, CaptureError> {
    let failed = |source| CaptureError::Read { path: folder.to_owned(), source };
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let extension =
            path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        let Some(stem) = path.file_stem().map(|s| s.to_string_lossy().into_owned()) else { continue };
        if extensions.contains(&extension.as_str()) && path.is_file() {
            found.insert(stem, path);
        }
        if found.len() > MAX_FRAMES {
            return refuse(folder, format!("more than {MAX_FRAMES} files"));
        }
    }
    Ok(found)
}
