//! The start/end layout (docs/method.md 2.1): `{start,end}/camera_train.json` and
//! `{start,end}/train/0000.png` with the mask as alpha. The published renders have no depth; copies that have
//! it keep 16-bit PNGs in millimeters in `{start,end}/depth/` or `{start,end}/train/depth/`.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use rayon::prelude::*;
use serde_json::Value;

use super::files::{
    Entry, MAX_FRAMES, STATES, camera, image_error, image_size, optional, pose_from_opengl, read_image,
    read_text, refuse, spread,
};
use crate::{image_codec as codec, pixels::limit_depth};
use capture::{Capture, CaptureConfig, CaptureError, RgbdFrame};
use common::note::{Note, NoteCode};
use common::stop::Stop;

/// Opens a folder in this layout. Frame ids become `<state>_<number>`.
///
/// # Errors
/// [`CaptureError::Dataset`], also if there is no depth; [`CaptureError::Read`].
pub fn open_start_end(folder: &Path, config: &CaptureConfig, stop: &Stop) -> Result<Capture, CaptureError> {
    let mut capture = Capture::of_states(2);
    capture.notes.push(Note::new(
        NoteCode::DatasetFormat,
        format!(
            "`{}` is a dataset of start and end; poses are turned from OpenGL to optical axes",
            folder.display()
        ),
    ));
    let mut found = Vec::new();
    for (state, name) in STATES.iter().enumerate() {
        let part = folder.join(name);
        let json = part.join("camera_train.json");
        let (k, entries) = cameras(&json)?;
        let depth_folder = ["depth", "train/depth"].map(|d| part.join(d)).into_iter().find(|d| d.is_dir());
        let Some(depth_folder) = depth_folder else {
            return refuse(
                &part,
                "there is no `depth` folder; depth is needed: add `depth/0000.png`, ... (16-bit PNG, \
                 millimeters, 0 = unknown)",
            );
        };
        let kept = spread(entries, state, config, &mut capture.notes);
        found.push(Part { folder: part, depth_folder, json, k, kept });
    }
    let Some((part, first)) = found.iter().find_map(|part| Some((part, part.kept.first()?))) else {
        return refuse(folder, "it has no frame");
    };
    // All images have one size, so the memory is known before any of them is decoded.
    let size = image_size(&part.color(first))?;
    config.check_memory(&[(found.iter().map(|part| part.kept.len()).sum(), size.0, size.1)])?;
    for (state, part) in found.iter().enumerate() {
        capture.states[state] = part
            .kept
            .par_iter()
            .map(|entry| {
                stop.check()?;
                part.read_frame(state, entry, size, config)
            })
            .collect::<Result<_, CaptureError>>()?;
    }
    Ok(capture)
}

/// Numbers of a matrix row by row; NaN for an entry that is not a number.
fn matrix_numbers(v: &Value) -> Vec<f64> {
    let rows = v.as_array().into_iter().flatten();
    rows.flat_map(|row| row.as_array().into_iter().flatten())
        // `pose_from_opengl` and `camera` refuse NaN and report its place.
        .map(|n| n.as_f64().unwrap_or(f64::NAN))
        .collect()
}

/// Camera matrix and frames, by name.
fn cameras(path: &Path) -> Result<(Vec<f64>, Vec<Entry>), CaptureError> {
    let text = read_text(path)?;
    let map: BTreeMap<String, Value> = match serde_json::from_str(&text) {
        Ok(map) => map,
        Err(e) => return refuse(path, e.to_string()),
    };
    let Some(k) = map.get("K").map(matrix_numbers) else {
        return refuse(path, "it has no camera matrix `K`");
    };
    let frames = map.iter().filter(|(name, _)| !name.is_empty() && name.bytes().all(|b| b.is_ascii_digit()));
    let entries: Result<Vec<_>, CaptureError> = frames
        .take(MAX_FRAMES)
        .map(|(name, v)| {
            Ok(Entry {
                id: name.clone(),
                world_from_camera: pose_from_opengl(path, name, &matrix_numbers(v))?,
            })
        })
        .collect();
    let entries = entries?;
    if entries.is_empty() { refuse(path, "it lists no frame") } else { Ok((k, entries)) }
}

/// One of the two states.
struct Part {
    folder: PathBuf,
    depth_folder: PathBuf,
    json: PathBuf,
    k: Vec<f64>,
    kept: Vec<Entry>,
}

impl Part {
    fn color(&self, entry: &Entry) -> PathBuf {
        self.folder.join("train").join(format!("{}.png", entry.id))
    }

    fn read_frame(
        &self,
        state: usize,
        entry: &Entry,
        size: (usize, usize),
        config: &CaptureConfig,
    ) -> Result<RgbdFrame, CaptureError> {
        let color_file = self.color(entry);
        let (color, alpha) = codec::color_with_alpha_file(&read_image(&color_file, size, true)?)
            .map_err(|e| image_error(&color_file, e))?;
        let depth_file = self.depth_folder.join(format!("{}.png", entry.id));
        if optional(depth_file.clone()).is_none() {
            return refuse(&depth_file, format!("frame {} has no depth image", entry.id));
        }
        let depth = codec::depth_file(&read_image(&depth_file, size, false)?, 0.001)
            .map_err(|e| image_error(&depth_file, e))?;
        // Depth may be coarser than color. Resized to the nearest pixel: a mean across an edge would be a
        // surface nobody saw.
        let mut depth_m = depth.resized_nearest(color.width, color.height).pixels;
        limit_depth(&mut depth_m, config);
        Ok(RgbdFrame {
            id: format!("{state}_{}", entry.id),
            stamp_nanos: 0,
            // Pixel centers of this layout are at half integers.
            intrinsics: camera(&self.json, &self.k, (color.width, color.height), true)?,
            world_from_camera: entry.world_from_camera,
            rgb: color.pixels,
            depth_m,
            mask: alpha.filter(|_| config.isolate.use_masks),
            readings: Vec::new(),
        })
    }
}
