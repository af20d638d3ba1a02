//! Lines of numbers in the text files of folders.

use std::path::{Path, PathBuf};

use nalgebra::{Quaternion, Translation3, UnitQuaternion};

use super::Matrix;
use crate::{
    dataset::files::{MAX_FRAMES, camera, pose_from_optical, read_text, refuse},
    package_path::below,
};
use capture::CaptureError;
use geometry::Pose;

/// Largest deviation of a quaternion's length from 1. chosen: files round to a few digits; another length
/// is no rotation
const QUATERNION_TOLERANCE: f64 = 0.01;

/// The words of each line that holds some and is no comment (`#`), with commas as gaps.
pub(super) fn rows(path: &Path) -> Result<Vec<Vec<String>>, CaptureError> {
    let text = read_text(path)?;
    let lines = text.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#'));
    let words =
        |line: &str| line.split([' ', '\t', ',']).filter(|w| !w.is_empty()).map(str::to_owned).collect();
    let rows: Vec<Vec<String>> = lines.take(MAX_LINES + 1).map(words).collect();
    if rows.len() > MAX_LINES {
        return refuse(path, format!("it has more than {MAX_LINES} lines"));
    }
    Ok(rows)
}

/// Most lines of a file: poses come ten times as often as images.
const MAX_LINES: usize = 10 * MAX_FRAMES;

/// A finite number.
pub(super) fn number(path: &Path, word: &str) -> Result<f64, CaptureError> {
    match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => refuse(path, format!("`{}` is no number", word.escape_debug())),
    }
}

/// All numbers of a file.
pub(super) fn numbers(path: &Path) -> Result<Vec<f64>, CaptureError> {
    let rows = rows(path)?;
    rows.iter().flatten().map(|word| number(path, word)).collect()
}

/// A stamp of seconds since the epoch or any other time, as nanoseconds.
pub(super) fn stamp_nanos(path: &Path, word: &str) -> Result<i64, CaptureError> {
    let refused = || refuse(path, format!("`{}` is no time in seconds", word.escape_debug()));
    nanos(number(path, word)?).map_or_else(refused, Ok)
}

/// Latest stamp, seconds. derived: nanoseconds in 63 bits end at 9.2e9 s
const MAX_STAMP_S: f64 = 9e9;

/// A stamp of seconds as nanoseconds, of which 0 stands for a missing stamp; `None` beyond what they hold.
pub(super) fn nanos(seconds: f64) -> Option<i64> {
    (0.0..=MAX_STAMP_S).contains(&seconds).then(|| ((seconds * 1e9).round() as i64).max(1))
}

/// A pose of position and quaternion (x, y, z, qx, qy, qz, qw).
pub(super) fn pose(path: &Path, numbers: [f64; 7]) -> Result<Pose, CaptureError> {
    let [x, y, z, i, j, k, w] = numbers;
    let quaternion = Quaternion::new(w, i, j, k);
    if (quaternion.norm() - 1.0).abs() > QUATERNION_TOLERANCE {
        return refuse(path, format!("`{i} {j} {k} {w}` is no unit quaternion"));
    }
    Ok(Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_quaternion(quaternion)))
}

/// A pose of a row-major 4x4 (or 3x4) matrix in the axes of the file.
pub(super) fn pose_of_matrix(path: &Path, name: &str, matrix: &[f64]) -> Result<Pose, CaptureError> {
    let mut whole = matrix.to_vec();
    if whole.len() == 12 {
        whole.extend([0.0, 0.0, 0.0, 1.0]);
    }
    pose_from_optical(path, name, &whole)
}

/// The camera of a file with nine numbers, a row-major matrix for images of the given size.
pub(super) fn matrix(path: &Path, size: (usize, usize)) -> Result<Matrix, CaptureError> {
    Ok(Matrix::pinhole(camera(path, &numbers(path)?, size, false)?))
}

/// The file of a name in `folder`, which may not lead out of it.
pub(super) fn file_in(folder: &Path, by: &Path, name: &str) -> Result<PathBuf, CaptureError> {
    match below(name) {
        Some(relative) => Ok(folder.join(relative)),
        None => refuse(by, format!("`{}` lies outside the folder", name.escape_debug())),
    }
}
