//! TUM RGB-D (<https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats>): `rgb.txt` and `depth.txt`
//! list images by time, `groundtruth.txt` poses of the color camera. Depth counts 5000 to a meter.

use std::path::Path;

use super::{
    ImageFile, ImageFolder, Shown,
    text::{file_in, matrix, number, pose, rows, stamp_nanos},
};
use crate::dataset::files::{MAX_FRAMES, image_size, refuse};
use capture::CaptureError;

/// Unit of depth, meters. derived: the factor of 5000 of the format
const DEPTH_UNIT_M: f64 = 1.0 / 5000.0;

/// Lists the files of a folder. The format has no file of the camera matrix, so `cam_K.txt` must be added.
///
/// # Errors
/// [`CaptureError::Dataset`] and [`CaptureError::Read`].
pub(super) fn open(folder: &Path) -> Result<ImageFolder, CaptureError> {
    let mut images = list(folder, "rgb.txt", &Shown::Color)?;
    let Some(first) = images.first() else { return refuse(&folder.join("rgb.txt"), "it lists no image") };
    let size = image_size(&first.path)?;
    let camera = folder.join("cam_K.txt");
    if !camera.is_file() {
        let reason = "it is missing, and TUM RGB-D folders hold no camera matrix; write its nine numbers \
                      into this file, row by row (the data set's page proposes `525 0 319.5 0 525 239.5 0 \
                      0 1` for its own images of 640x480)";
        return refuse(&camera, reason);
    }
    let matrices = vec![(first.stamp_nanos, matrix(&camera, size)?)];
    images.extend(list(folder, "depth.txt", &Shown::Depth(None))?);
    let truth = folder.join("groundtruth.txt");
    let mut poses = Vec::new();
    for row in if truth.is_file() { rows(&truth)? } else { Vec::new() } {
        let [stamp, words @ ..] = &row[..] else { continue };
        let numbers = words.iter().map(|w| number(&truth, w)).collect::<Result<Vec<_>, _>>()?;
        let Ok(numbers) = <[f64; 7]>::try_from(numbers) else {
            return refuse(&truth, "a line is not `time tx ty tz qx qy qz qw`");
        };
        poses.push((stamp_nanos(&truth, stamp)?, pose(&truth, numbers)?));
    }
    Ok(ImageFolder {
        form: "TUM RGB-D",
        images,
        matrices,
        depth_size: (0, 0),
        poses,
        depth_unit_m: DEPTH_UNIT_M,
        is_y_up: false,
    })
}

/// The images of a list of times and names.
fn list(folder: &Path, name: &str, shown: &Shown) -> Result<Vec<ImageFile>, CaptureError> {
    let path = folder.join(name);
    let mut images = Vec::new();
    for row in rows(&path)? {
        let [stamp, file] = &row[..] else {
            return refuse(&path, "a line is not `time name`");
        };
        images.push(ImageFile {
            stamp_nanos: stamp_nanos(&path, stamp)?,
            shown: shown.clone(),
            path: file_in(folder, &path, file)?,
        });
    }
    if images.len() > MAX_FRAMES {
        return refuse(&path, format!("{} images, more than {MAX_FRAMES}", images.len()));
    }
    Ok(images)
}
