//! The keyframe layout (docs/method.md 2.1): `cam_K.txt`, `init_keyframes.yml`, `color_segmented/`,
//! `depth_filtered/`, `mask/`, `correspondence_loftr/`.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use rayon::prelude::*;
use serde::Deserialize;

use super::{
    files::{
        Entry, MAX_FRAMES, camera, image_error, image_size, optional, pose_from_opengl, read_image,
        read_text, refuse, spread,
    },
    matches::import_matches,
};
use crate::{image_codec as codec, pixels::limit_depth};
use capture::{Capture, CaptureConfig, CaptureError, RgbdFrame};
use common::limits::parse_yaml;
use common::note::{Note, NoteCode};
use common::stop::Stop;

#[derive(Deserialize)]
struct Keyframe {
    cam_in_ob: Vec<f64>,
    time: Option<f64>,
}

/// Opens a folder in this layout; frame ids are those of the dataset.
///
/// # Errors
/// [`CaptureError::Dataset`] and [`CaptureError::Read`] with the file.
pub fn open_keyframes(folder: &Path, config: &CaptureConfig, stop: &Stop) -> Result<Capture, CaptureError> {
    let camera_file = folder.join("cam_K.txt");
    let text = read_text(&camera_file)?;
    // Nine numbers in lines of three; `camera` refuses another count.
    let k: Vec<f64> = text.split_whitespace().map_while(|w| w.parse().ok()).collect();
    let mut capture = Capture::of_states(2);
    capture.notes.push(Note::new(
        NoteCode::DatasetFormat,
        format!(
            "`{}` is a dataset of keyframes; poses are turned from OpenGL to optical axes",
            folder.display()
        ),
    ));
    let mut kept = Vec::new();
    for (state, entries) in keyframes(&folder.join("init_keyframes.yml"))?.into_iter().enumerate() {
        kept.push(spread(entries, state, config, &mut capture.notes));
    }
    let Some(first) = kept.iter().flatten().next() else { return refuse(folder, "it has no frame") };
    let size = image_size(&color_path(folder, first))?;
    config.check_memory(&[(kept.iter().map(Vec::len).sum(), size.0, size.1)])?;
    for (state, kept) in kept.iter().enumerate() {
        capture.states[state] = kept
            .par_iter()
            .map(|entry| {
                stop.check()?;
                read_frame(folder, &camera_file, &k, entry, size, config)
            })
            .collect::<Result<_, CaptureError>>()?;
    }
    import_matches(folder, &mut capture, stop)?;
    Ok(capture)
}

/// Keyframes of both states, by id.
fn keyframes(path: &Path) -> Result<[Vec<Entry>; 2], CaptureError> {
    let text = read_text(path)?;
    let map: BTreeMap<String, Keyframe> = match parse_yaml(&text) {
        Ok(map) => map,
        Err(e) => {
            return refuse(
                path,
                format!("{e}; expected `frame_<id>: {{cam_in_ob: [16 numbers], time: 0 or 1}}`"),
            );
        }
    };
    if map.len() > MAX_FRAMES {
        return refuse(path, format!("{} frames, more than {MAX_FRAMES}", map.len()));
    }
    let mut states: [Vec<Entry>; 2] = Default::default();
    for (key, frame) in &map {
        let id = key.strip_prefix("frame_").unwrap_or(key);
        // The name's first part is the state, as in the names of the images.
        let state = match id.split('_').next() {
            Some("0") => 0,
            Some("1") => 1,
            _ => {
                return refuse(
                    path,
                    format!("`{}` does not begin with its state, `0_` or `1_`", id.escape_debug()),
                );
            }
        };
        // It becomes part of file names.
        if !id.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'-') {
            return refuse(path, format!("`{}` is no frame name", id.escape_debug()));
        }
        // The state is given twice; if the two differ, either may be wrong.
        if frame.time.is_some_and(|t| t != state as f64) {
            return refuse(
                path,
                format!("frame `{id}` is named as of state {state}, but its time is {:?}", frame.time),
            );
        }
        states[state].push(Entry {
            id: id.to_owned(),
            world_from_camera: pose_from_opengl(path, id, &frame.cam_in_ob)?,
        });
    }
    match states.iter().position(Vec::is_empty) {
        Some(state) => {
            Err(CaptureError::NoFrames { state, reason: format!("`{}` lists none", path.display()) })
        }
        None => Ok(states),
    }
}

fn image_path(folder: &Path, part: &str, entry: &Entry) -> PathBuf {
    folder.join(part).join(format!("{}.png", entry.id))
}

fn color_path(folder: &Path, entry: &Entry) -> PathBuf {
    optional(image_path(folder, "color_raw", entry))
        .unwrap_or_else(|| image_path(folder, "color_segmented", entry))
}

fn read_frame(
    folder: &Path,
    camera_file: &Path,
    k: &[f64],
    entry: &Entry,
    size: (usize, usize),
    config: &CaptureConfig,
) -> Result<RgbdFrame, CaptureError> {
    let color_file = color_path(folder, entry);
    let (color, alpha) = codec::color_with_alpha_file(&read_image(&color_file, size, true)?)
        .map_err(|e| image_error(&color_file, e))?;
    let width = color.width;
    let height = color.height;
    let depth_file = image_path(folder, "depth_filtered", entry);
    let depth = codec::depth_file(&read_image(&depth_file, size, false)?, 0.001)
        .map_err(|e| image_error(&depth_file, e))?;
    // Depth may be coarser than color. Resized to the nearest pixel: a mean across an edge would be a surface
    // nobody saw.
    let mut depth_m = depth.resized_nearest(width, height).pixels;
    limit_depth(&mut depth_m, config);
    let mask = match optional(image_path(folder, "mask", entry)) {
        Some(path) => {
            let mask =
                codec::mask_file(&read_image(&path, size, false)?).map_err(|e| image_error(&path, e))?;
            Some(mask.resized_nearest(width, height).pixels)
        }
        None => alpha,
    };
    Ok(RgbdFrame {
        id: entry.id.clone(),
        stamp_nanos: 0,
        intrinsics: camera(camera_file, k, (width, height), false)?,
        world_from_camera: entry.world_from_camera,
        rgb: color.pixels,
        depth_m,
        mask: mask.filter(|_| config.isolate.use_masks),
        readings: Vec::new(),
    })
}
