//! Folders of Stray Scanner (<https://docs.strayrobots.io/apps/scanner/format.html>): `depth/` and
//! `confidence/` as PNG, `camera_matrix.csv`, `odometry.csv`, and the color images as a video.

use std::{collections::BTreeMap, path::Path};

use super::{
    ImageFile, ImageFolder, Shown,
    object_frames::by_stem,
    text::{matrix, number, pose, rows, stamp_nanos},
};
use crate::dataset::files::refuse;
use capture::{CaptureError, quoted};

/// Columns and rows of the video, for which the camera matrix is given.
const VIDEO_SIZE: (usize, usize) = (1920, 1440);
/// Columns of `odometry.csv` that hold a pose.
const POSE: [&str; 7] = ["x", "y", "z", "qx", "qy", "qz", "qw"];

/// Lists the files of a folder whose video was made into images.
///
/// # Errors
/// [`CaptureError::Dataset`] and [`CaptureError::Read`]; for a folder with the video alone, with the
/// command that makes images of it.
pub(super) fn open(folder: &Path) -> Result<ImageFolder, CaptureError> {
    let frames = folder.join("rgb");
    if !frames.is_dir() {
        return refuse(&folder.join("rgb.mp4"), video_reason(folder));
    }
    let colors = by_number(&frames, &["jpg", "jpeg", "png"])?;
    let depths = by_number(&folder.join("depth"), &["png"])?;
    let confidence = folder.join("confidence");
    let confidences = if confidence.is_dir() { by_number(&confidence, &["png"])? } else { BTreeMap::new() };
    let camera = folder.join("camera_matrix.csv");
    let mut folder_found = ImageFolder {
        form: "Stray Scanner",
        images: Vec::new(),
        matrices: Vec::new(),
        depth_size: (0, 0),
        poses: Vec::new(),
        depth_unit_m: 0.001,
        is_y_up: true,
    };
    for line in odometry(&folder.join("odometry.csv"))? {
        let stamp_nanos = line.stamp_nanos;
        if let Some(path) = colors.get(&line.frame) {
            folder_found.images.push(ImageFile { stamp_nanos, shown: Shown::Color, path: path.clone() });
        }
        if let Some(path) = depths.get(&line.frame) {
            let shown = Shown::Depth(confidences.get(&line.frame).cloned());
            folder_found.images.push(ImageFile { stamp_nanos, shown, path: path.clone() });
        }
        folder_found.poses.push((stamp_nanos, line.world_from_camera));
    }
    let first = folder_found.poses.first().map_or(0, |p| p.0);
    folder_found.matrices.push((first, matrix(&camera, VIDEO_SIZE)?));
    Ok(folder_found)
}

/// Why a folder with a video is not read, and what makes images of it.
fn video_reason(folder: &Path) -> String {
    let at = |name: &str| quoted(&folder.join(name));
    format!(
        "the color images are a video; make images of it: `mkdir {} && ffmpeg -i {} -fps_mode passthrough \
         -start_number 0 -q:v 2 {}`",
        at("rgb"),
        at("rgb.mp4"),
        at("rgb/%06d.jpg")
    )
}

/// The files of a folder by the numbers that they are named by.
fn by_number(folder: &Path, extensions: &[&str]) -> Result<BTreeMap<u64, std::path::PathBuf>, CaptureError> {
    let files = by_stem(folder, extensions)?;
    Ok(files.into_iter().filter_map(|(stem, path)| Some((stem.parse().ok()?, path))).collect())
}

/// A line of `odometry.csv`.
struct OdometryLine {
    stamp_nanos: i64,
    frame: u64,
    /// The camera in ARKit's world; its axes are those of an optical frame.
    world_from_camera: geometry::Pose,
}

fn odometry(path: &Path) -> Result<Vec<OdometryLine>, CaptureError> {
    let mut rows = rows(path)?.into_iter();
    let titles = rows.next().unwrap_or_default();
    let mut columns = BTreeMap::new();
    for name in ["timestamp", "frame"].iter().chain(&POSE) {
        let Some(column) = titles.iter().position(|t| t == name) else {
            return refuse(path, format!("it has no column `{name}`"));
        };
        columns.insert(*name, column);
    }
    let mut lines = Vec::new();
    for row in rows {
        let word = |name: &str| row.get(columns[name]).map_or("", String::as_str);
        let mut numbers = [0.0; POSE.len()];
        for (value, name) in numbers.iter_mut().zip(POSE) {
            *value = number(path, word(name))?;
        }
        lines.push(OdometryLine {
            stamp_nanos: stamp_nanos(path, word("timestamp"))?,
            frame: number(path, word("frame"))? as u64,
            world_from_camera: pose(path, numbers)?,
        });
    }
    Ok(lines)
}
