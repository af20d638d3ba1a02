//! Parts shared by the dataset layouts: reading bounded files, camera matrices and poses, building frames.

use std::{
    io::{ErrorKind, Read as _},
    path::{Path, PathBuf},
};

use nalgebra::{Matrix3, Matrix4, Rotation3, Translation3, UnitQuaternion};

use crate::{
    image_codec::{ImageError, MAX_SIDE},
    picture_size::stated_size,
    views::views_kept,
};
use capture::{CaptureConfig, CaptureError};
use common::files;
use common::limits::DATASET;
use common::note::Note;
use geometry::{Intrinsics, Pose};

/// Names of the states in the layouts with a folder a state.
pub const STATES: [&str; 2] = ["start", "end"];
/// Largest ratio of the pixels of depth and masks to those of their color image ...
const MOST_LARGER: usize = 16;
/// ... unless they have at most this many pixels.
const SMALL_IMAGE: usize = 1 << 20;
/// Most frames of one dataset.
pub const MAX_FRAMES: usize = 100_000;
/// Largest number of steps in the search for the rotation nearest to a matrix. Measured: 100,000 random
/// rotations, rounded to 4 to 17 digits, settle within 54.
const MAX_STEPS: usize = 1000;

pub fn refuse<T>(path: &Path, reason: impl Into<String>) -> Result<T, CaptureError> {
    Err(CaptureError::Dataset { path: path.to_owned(), reason: reason.into() })
}

pub fn read(path: &Path) -> Result<Vec<u8>, CaptureError> {
    files::read_limited(path, DATASET).or_else(|source| match source.kind() {
        // A file too large is a fault of the dataset, not of the disk.
        ErrorKind::FileTooLarge => refuse(path, source.to_string()),
        _ => Err(CaptureError::Read { path: path.to_owned(), source }),
    })
}

/// Bytes of an image file in which its size stands. chosen: what a camera writes before it has up to 64 KiB
const START: u64 = 1 << 17;

/// The start of an image file, in which its size stands.
pub fn read_start(path: &Path) -> Result<Vec<u8>, CaptureError> {
    let mut start = Vec::new();
    match files::open_regular(path).and_then(|file| file.take(START).read_to_end(&mut start)) {
        Ok(_) => Ok(start),
        Err(source) => Err(CaptureError::Read { path: path.to_owned(), source }),
    }
}

/// Size stated in an image file, without its pixels.
pub fn image_size(path: &Path) -> Result<(usize, usize), CaptureError> {
    stated_size(&read(path)?).map_or_else(|| refuse(path, "neither JPEG nor PNG by its first bytes"), Ok)
}

/// Reads an image file of allowed size: those of a dataset have one size; masks and depth may be larger or
/// smaller within limits.
pub fn read_image(
    path: &Path,
    (width, height): (usize, usize),
    exactly: bool,
) -> Result<Vec<u8>, CaptureError> {
    let bytes = read(path)?;
    match stated_size(&bytes) {
        Some((w, h)) if exactly && (w, h) != (width, height) => refuse(
            path,
            format!(
                "it has {w}x{h} pixels, the first image {width}x{height}; all images of a dataset must \
                 have one size"
            ),
        ),
        Some((w, h)) if w.saturating_mul(h) > MOST_LARGER * width * height + SMALL_IMAGE => refuse(
            path,
            format!(
                "it has {w}x{h} pixels, more than {MOST_LARGER} times the {width}x{height} of its color image"
            ),
        ),
        _ => Ok(bytes),
    }
}

pub fn read_text(path: &Path) -> Result<String, CaptureError> {
    String::from_utf8(read(path)?).or_else(|_| refuse(path, "not a text file"))
}

/// The error of an image file.
pub fn image_error(path: &Path, error: ImageError) -> CaptureError {
    CaptureError::Dataset { path: path.to_owned(), reason: error.to_string() }
}

/// Camera from a row-major 3x3 matrix; width and height are those of the images. With `half_pixel`, the
/// matrix puts pixel centers at half integers.
pub fn camera(
    path: &Path,
    k: &[f64],
    (width, height): (usize, usize),
    half_pixel: bool,
) -> Result<Intrinsics, CaptureError> {
    // Here integers are pixel centers (docs/method.md 1).
    let shift = if half_pixel { 0.5 } else { 0.0 };
    match k {
        [fx, skew, cx, _, fy, cy, ..] if k.len() == 9 => {
            let usable = [fx, fy].iter().all(|f| **f > 0.0 && f.is_finite())
                && cx.is_finite()
                && cy.is_finite()
                && skew.abs() < 1e-6;
            if !usable || width > MAX_SIDE || height > MAX_SIDE {
                return refuse(path, format!("not a pinhole camera: {k:?}"));
            }
            Ok(Intrinsics { width, height, fx: *fx, fy: *fy, cx: cx - shift, cy: cy - shift })
        }
        _ => refuse(path, format!("a camera matrix has 9 numbers, not {}", k.len())),
    }
}

/// Pose of the optical frame from a row-major 4x4 camera-to-world matrix in OpenGL axes (x right, y up,
/// looking along -z): the camera is turned by half a turn about its x axis: docs/method.md (2.1).
pub fn pose_from_opengl(path: &Path, name: &str, matrix: &[f64]) -> Result<Pose, CaptureError> {
    // (2.1)
    let flip = Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, -1.0, -1.0));
    pose_of_matrix(path, name, matrix, &flip)
}

/// The same for a matrix in optical axes (x right, y down, z forward).
pub fn pose_from_optical(path: &Path, name: &str, matrix: &[f64]) -> Result<Pose, CaptureError> {
    pose_of_matrix(path, name, matrix, &Matrix3::identity())
}

/// Pose of a row-major 4x4 matrix whose camera's axes are those of an optical frame after `flip`.
fn pose_of_matrix(
    path: &Path,
    name: &str,
    matrix: &[f64],
    flip: &Matrix3<f64>,
) -> Result<Pose, CaptureError> {
    if matrix.len() != 16 || matrix.iter().any(|v| !v.is_finite()) {
        return refuse(path, format!("the pose of `{}` is not 16 finite numbers", name.escape_debug()));
    }
    let m = Matrix4::from_row_slice(matrix);
    let r: Matrix3<f64> = m.fixed_view::<3, 3>(0, 0).into_owned();
    // Poses are written with few digits, but a scale or a mirror is no rounding.
    if (r.transpose() * r - Matrix3::identity()).amax() > 1e-3 || r.determinant() < 0.0 {
        return refuse(path, format!("the pose of `{}` is no rigid motion", name.escape_debug()));
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&nearest_rotation(&(r * flip)));
    Ok(Pose::from_parts(Translation3::new(m.m14, m.m24, m.m34), rotation))
}

/// The rotation nearest to a matrix that is nearly a rotation. The search may stay forever at half a turn
/// from it, if the matrix is almost exactly half a turn from the start; then it starts again from the matrix
/// itself.
fn nearest_rotation(m: &Matrix3<f64>) -> Rotation3<f64> {
    let from = |start| Rotation3::from_matrix_eps(m, f64::EPSILON, MAX_STEPS, start);
    let found = from(Rotation3::identity());
    if (found.matrix() - m).amax() < 1e-2 {
        return found;
    }
    from(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*m)).to_rotation_matrix())
}

/// The file, if it is there.
pub fn optional(path: PathBuf) -> Option<PathBuf> {
    path.is_file().then_some(path)
}

/// One frame of a dataset before its pixels are read.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Frame name.
    pub id: String,
    /// Pose of the optical frame.
    pub world_from_camera: Pose,
}

/// The entries of one state that are kept, chosen by the spread of their views, with a note.
pub fn spread(
    entries: Vec<Entry>,
    state: usize,
    config: &CaptureConfig,
    notes: &mut Vec<Note>,
) -> Vec<Entry> {
    let poses: Vec<Pose> = entries.iter().map(|e| e.world_from_camera).collect();
    let kept = capture::spread_views(&poses, config.frames_per_state);
    notes.push(views_kept(state, kept.len(), entries.len()));
    kept.into_iter().map(|i| entries[i].clone()).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;

    #[test]
    fn an_opengl_camera_looks_along_its_negative_z() {
        // At (0, -2, 0), looking along +y, up is z: x right, y up (world z), z backwards (world -y).
        #[rustfmt::skip]
        let matrix = [1.0, 0.0, 0.0, 0.0,
                      0.0, 0.0, -1.0, -2.0,
                      0.0, 1.0, 0.0, 0.0,
                      0.0, 0.0, 0.0, 1.0];
        let pose = pose_from_opengl(Path::new("x"), "0", &matrix).unwrap();
        assert!((pose * Point3::new(0.0, 0.0, 2.0) - Point3::origin()).norm() < 1e-12);
        assert!((pose.rotation * Vector3::y() + Vector3::z()).norm() < 1e-12);
        let mut mirrored = matrix;
        mirrored[0] = -1.0;
        assert!(pose_from_opengl(Path::new("x"), "0", &mirrored).is_err());
        assert!(pose_from_opengl(Path::new("x"), "0", &[f64::NAN; 16]).is_err());
    }

    #[test]
    fn a_matrix_at_which_the_search_for_its_rotation_stays_is_read() {
        let s = 0.09983341664632815;
        let c = 0.9950041652780258;
        let matrix =
            [c, -0.09983341664682815, 0.0, 0.2, s, c, 0.0, 0.5, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let pose = pose_from_opengl(Path::new("x"), "0", &matrix).unwrap();
        assert!((pose * Vector3::x() - Vector3::new(c, s, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn half_pixel_matrices_are_moved_to_integer_centers() {
        let k = [500.0, 0.0, 400.0, 0.0, 500.0, 400.0, 0.0, 0.0, 1.0];
        let c = camera(Path::new("x"), &k, (800, 800), true).unwrap();
        assert_eq!((c.cx, c.cy), (399.5, 399.5));
        assert!(camera(Path::new("x"), &k[..6], (800, 800), true).is_err());
    }
}
