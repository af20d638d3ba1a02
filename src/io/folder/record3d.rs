//! Folders of Record3D (<https://record3d.app>): `metadata.json` (`metadata` in an unpacked .r3d) with
//! intrinsics and poses, and the images: `rgb/` and `depth/`, or both in `rgbd/`.

use std::{
    fs,
    path::{Path, PathBuf},
};

use nalgebra::{Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;

use super::{
    ImageFile, ImageFolder, Matrix, Shown, made_stamp,
    text::{nanos, pose},
};
use crate::dataset::files::{MAX_FRAMES, read_text, refuse};
use capture::CaptureError;
use geometry::{Intrinsics, Pose};

#[derive(Debug, Deserialize)]
struct Record3dMetadata {
    w: usize,
    h: usize,
    /// Camera matrix, column by column.
    #[serde(rename = "K")]
    k: Vec<f64>,
    /// Quaternion (x, y, z, w) and position of each frame's camera, in OpenGL axes.
    poses: Vec<Vec<f64>>,
    #[serde(rename = "frameTimestamps", default)]
    timestamps_s: Vec<f64>,
}

/// Where the metadata of a folder are, if it is one of Record3D.
pub(super) fn metadata_path(folder: &Path) -> Option<PathBuf> {
    let found = ["metadata.json", "metadata"].map(|n| folder.join(n)).into_iter().find(|p| p.is_file())?;
    let has_images =
        folder.join("rgbd").is_dir() || (folder.join("rgb").is_dir() && folder.join("depth").is_dir());
    has_images.then_some(found)
}

/// Lists the files of a folder.
///
/// # Errors
/// [`CaptureError::Dataset`] and [`CaptureError::Read`].
pub(super) fn open(folder: &Path) -> Result<ImageFolder, CaptureError> {
    let path = metadata_path(folder).unwrap_or_default();
    let found: Record3dMetadata = match serde_json::from_str(&read_text(&path)?) {
        Ok(found) => found,
        Err(e) => return refuse(&path, e.to_string()),
    };
    if found.poses.len() > MAX_FRAMES {
        return refuse(&path, format!("{} frames, more than {MAX_FRAMES}", found.poses.len()));
    }
    let [fx, _, _, _, fy, _, cx, cy, _] = found.k[..] else {
        return refuse(&path, format!("its camera matrix has {} numbers, not 9", found.k.len()));
    };
    if !([fx, fy, cx, cy].iter().all(|v| v.is_finite()) && fx > 0.0 && fy > 0.0)
        || found.w == 0
        || found.h == 0
    {
        return refuse(&path, format!("not a pinhole camera: {:?}", found.k));
    }
    let mut images = Vec::new();
    let mut poses = Vec::new();
    for (index, numbers) in found.poses.iter().enumerate() {
        let stamp_s = found.timestamps_s.get(index);
        let stamp_nanos = stamp_s.and_then(|s| nanos(*s)).unwrap_or_else(|| made_stamp(index));
        let color = image(folder, &["rgb", "rgbd"], index, &["jpg", "png", "jpeg"]);
        let depth = image(folder, &["depth", "rgbd"], index, &["png", "exr", "depth"]);
        let confidence = image(folder, &["confidence", "conf"], index, &["png"]);
        images.extend(color.map(|path| ImageFile { stamp_nanos, shown: Shown::Color, path }));
        images.extend(depth.map(|path| ImageFile { stamp_nanos, shown: Shown::Depth(confidence), path }));
        let [i, j, k, w, x, y, z] = numbers[..] else {
            return refuse(&path, format!("pose {index} has {} numbers, not 7", numbers.len()));
        };
        poses.push((stamp_nanos, optical(&pose(&path, [x, y, z, i, j, k, w])?)));
    }
    let first = poses.first().map_or(0, |p| p.0);
    let matrix = Matrix::pinhole(Intrinsics { width: found.w, height: found.h, fx, fy, cx, cy });
    Ok(ImageFolder {
        form: "Record3D",
        images,
        matrices: vec![(first, matrix)],
        depth_size: (0, 0),
        poses,
        depth_unit_m: 0.001,
        is_y_up: true,
    })
}

/// The pose of an optical frame, of one in OpenGL axes: half a turn about x ((2.1) of docs/method.md).
fn optical(pose: &Pose) -> Pose {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    pose * Pose::from_parts(Translation3::identity(), turn)
}

/// The image of a frame in one of the folders.
fn image(folder: &Path, within: &[&str], index: usize, extensions: &[&str]) -> Option<PathBuf> {
    let names = within.iter().flat_map(|f| extensions.iter().map(move |e| format!("{f}/{index}.{e}")));
    names.map(|name| folder.join(name)).find(|p| fs::metadata(p).is_ok_and(|m| m.is_file()))
}
