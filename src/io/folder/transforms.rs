//! `transforms.json` of nerfstudio and Polycam
//! (<https://docs.nerf.studio/quickstart/data_conventions.html>): camera-to-world matrices in OpenGL axes,
//! intrinsics for all frames or for each, depth in millimeters.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::{ImageFile, ImageFolder, Matrix, Shown, made_stamp, text::file_in};
use crate::dataset::files::{MAX_FRAMES, image_size, pose_from_opengl, read_text, refuse};
use capture::CaptureError;
use geometry::{Intrinsics, Pose};

/// Intrinsics, of all frames or of one.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
struct FrameIntrinsics {
    camera_model: Option<String>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    /// Horizontal field of view, radians.
    camera_angle_x: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

#[derive(Debug, Deserialize)]
struct TransformsFrame {
    file_path: String,
    transform_matrix: Vec<Vec<f64>>,
    depth_file_path: Option<String>,
    mask_path: Option<String>,
    #[serde(flatten)]
    camera: FrameIntrinsics,
}

#[derive(Debug, Deserialize)]
struct Transforms {
    frames: Vec<TransformsFrame>,
    /// Factor by which poses were scaled; depth was not.
    applied_scale: Option<f64>,
    #[serde(flatten)]
    camera: FrameIntrinsics,
}

/// Lists the files of a folder. The world is that of `transform_matrix`, which `applied_transform` has
/// already turned.
///
/// # Errors
/// [`CaptureError::Dataset`] and [`CaptureError::Read`].
pub(super) fn open(folder: &Path) -> Result<ImageFolder, CaptureError> {
    let path = folder.join("transforms.json");
    let found: Transforms = match serde_json::from_str(&read_text(&path)?) {
        Ok(found) => found,
        Err(e) => return refuse(&path, e.to_string()),
    };
    let scale = found.applied_scale.unwrap_or(1.0);
    if !(scale > 0.0 && scale.is_finite()) {
        return refuse(&path, format!("its applied_scale is {scale}"));
    }
    if found.frames.len() > MAX_FRAMES {
        return refuse(&path, format!("{} frames, more than {MAX_FRAMES}", found.frames.len()));
    }
    let Some(first) = found.frames.first() else { return refuse(&path, "it lists no frame") };
    let size = image_size(&image_file(folder, &path, &first.file_path)?)?;
    let mut images = Vec::new();
    let mut matrices: Vec<(i64, Matrix)> = Vec::new();
    let mut poses = Vec::new();
    for (index, frame) in found.frames.iter().enumerate() {
        let stamp_nanos = made_stamp(index);
        let color = image_file(folder, &path, &frame.file_path)?;
        images.push(ImageFile { stamp_nanos, shown: Shown::Color, path: color });
        if let Some(name) = &frame.depth_file_path {
            let path = file_in(folder, &path, name)?;
            images.push(ImageFile { stamp_nanos, shown: Shown::Depth(None), path });
        }
        if let Some(name) = &frame.mask_path {
            let path = file_in(folder, &path, name)?;
            images.push(ImageFile { stamp_nanos, shown: Shown::Mask, path });
        }
        let matrix: Vec<f64> = frame.transform_matrix.iter().flatten().copied().collect();
        let pose = pose_from_opengl(&path, &frame.file_path, &matrix)?;
        let position = pose.translation.vector / scale;
        poses.push((stamp_nanos, Pose::from_parts(position.into(), pose.rotation)));
        let matrix = matrix_of(&path, [&frame.camera, &found.camera], size)?;
        matrices.push((stamp_nanos, matrix));
    }
    if !images.iter().any(|i| matches!(i.shown, Shown::Depth(_))) {
        return refuse(&path, "no frame has a `depth_file_path`; depth is needed (16-bit PNG, millimeters)");
    }
    // One camera of all frames is said once.
    if matrices.iter().all(|(_, m)| *m == matrices[0].1) {
        matrices.truncate(1);
    }
    Ok(ImageFolder {
        form: "nerfstudio's transforms.json",
        images,
        matrices,
        depth_size: (0, 0),
        poses,
        depth_unit_m: 0.001,
        is_y_up: false,
    })
}

/// The file of a frame, whose name may lack its extension.
fn image_file(folder: &Path, by: &Path, name: &str) -> Result<PathBuf, CaptureError> {
    let file = file_in(folder, by, name)?;
    if file.is_file() {
        return Ok(file);
    }
    let with = |extension: &str| PathBuf::from(format!("{}.{extension}", file.display()));
    match ["png", "jpg", "jpeg"].map(with).into_iter().find(|f| f.is_file()) {
        Some(found) => Ok(found),
        None => refuse(&file, "the image is missing"),
    }
}

/// The matrix of a frame: its own values, else those of all frames.
fn matrix_of(
    path: &Path,
    cameras: [&FrameIntrinsics; 2],
    size: (usize, usize),
) -> Result<Matrix, CaptureError> {
    let value = |field: fn(&FrameIntrinsics) -> Option<f64>| cameras.iter().find_map(|c| field(c));
    let w = value(|c| c.w).unwrap_or(size.0 as f64);
    let h = value(|c| c.h).unwrap_or(size.1 as f64);
    // Of a field of view: half of the width lies at its half.
    let of_angle = value(|c| c.camera_angle_x).map(|angle| 0.5 * w / (0.5 * angle).tan());
    let Some(fx) = value(|c| c.fl_x).or(of_angle) else {
        return refuse(path, "it has neither `fl_x` nor `camera_angle_x`");
    };
    let fy = value(|c| c.fl_y).unwrap_or(fx);
    let all = [fx, fy, w, h, value(|c| c.cx).unwrap_or(0.5 * w), value(|c| c.cy).unwrap_or(0.5 * h)];
    let is_usable = all.iter().all(|v| v.is_finite()) && all[..4].iter().all(|v| *v >= 1.0);
    if !is_usable {
        return refuse(path, format!("not a pinhole camera: {all:?}"));
    }
    let coefficient = |field: fn(&FrameIntrinsics) -> Option<f64>| value(field).unwrap_or(0.0);
    let [k1, k2, k3, k4] =
        [coefficient(|c| c.k1), coefficient(|c| c.k2), coefficient(|c| c.k3), coefficient(|c| c.k4)];
    let tangential = [coefficient(|c| c.p1), coefficient(|c| c.p2)];
    let model = cameras.iter().find_map(|c| c.camera_model.as_deref()).unwrap_or_default();
    let (model, lens) = match model {
        "OPENCV_FISHEYE" => ("equidistant", vec![k1, k2, k3, k4]),
        _ if k4 != 0.0 => {
            ("rational_polynomial", vec![k1, k2, tangential[0], tangential[1], k3, k4, 0.0, 0.0])
        }
        _ => ("plumb_bob", vec![k1, k2, tangential[0], tangential[1], k3]),
    };
    // nerfstudio puts pixel centers at half integers.
    let [cx, cy] = [all[4] - 0.5, all[5] - 0.5];
    let camera = Intrinsics { width: w as usize, height: h as usize, fx, fy, cx, cy };
    Ok(Matrix { camera, model, lens })
}
