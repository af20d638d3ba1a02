//! A synthetic object as a folder in one of the layouts of published articulated-object datasets
//! (docs/method.md 2.1), with ground truth in their form.

use std::collections::BTreeMap;

use image::{DynamicImage, ImageBuffer};
use nalgebra::{UnitQuaternion, Vector3};
use serde::Serialize;

use super::{
    Committed, Place, ResultKind, RunDir,
    dataset::{Ends, JointTransform, JointTransforms, STATES, TransformAxis},
    image_files::{depth_png, png},
    synth_error::SynthError,
    synth_folder::{least_bytes, ply},
    synth_matrix::rows,
};
use geometry::{AxisMotion, Intrinsics, Pose};
use surface::merged_mesh;
use synth::{Object, SynthConfig, SynthFrame, SynthState, generate, record};

/// A published layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DatasetLayout {
    /// Keyframes (DigitalTwinArt): `cam_K.txt`, `init_keyframes.yml`, images by frame, truth in `gt/`.
    Keyframes,
    /// Start and end (PARIS): `{start,end}/camera_train.json`, images with the mask as alpha, depth beside
    /// them, truth in `textured_objs/`.
    StartEnd,
}

impl DatasetLayout {
    /// Names of the layouts on a command line.
    pub const NAMES: [&'static str; 2] = ["dta", "paris"];

    /// The layout of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        [Self::Keyframes, Self::StartEnd]
            .into_iter()
            .zip(Self::NAMES)
            .find(|(_, n)| *n == name)
            .map(|(l, _)| l)
    }

    /// Folder of the truth.
    fn truth(self) -> &'static str {
        match self {
            Self::Keyframes => "gt",
            Self::StartEnd => "textured_objs",
        }
    }
}

/// Generates an object, films it in both states and writes it in a published layout.
///
/// # Errors
/// Those of [`super::write_synth`]; or an object that the layout cannot represent: it knows only hinges and
/// slides on the static part, and masks.
pub fn write_synth_dataset(
    place: &Place,
    config: &SynthConfig,
    layout: DatasetLayout,
) -> Result<(Committed, Object), SynthError> {
    config.check()?;
    place.check(ResultKind::Synth, least_bytes(config))?;
    let folder = RunDir::open(place, ResultKind::Synth)?;
    let object = generate(config)?;
    let joints = (1..object.parts.len()).map(|k| transform(&object, k)).collect::<Result<_, _>>()?;
    let mut keyframes = BTreeMap::new();
    for state in 0..2 {
        let recording = record(&object, state, config);
        match layout {
            DatasetLayout::Keyframes => put_keyframes(&folder, state, &recording, &mut keyframes)?,
            DatasetLayout::StartEnd => put_start_end(&folder, state, &recording)?,
        }
        put_meshes(&folder, layout.truth(), &object, state)?;
    }
    if layout == DatasetLayout::Keyframes {
        // JSON is YAML, too.
        folder.put("init_keyframes.yml", &serde_json::to_vec_pretty(&keyframes)?)?;
    }
    let transforms = JointTransforms::of(format!("synth, seed {}", config.seed), joints);
    folder.put(&format!("{}/trans.json", layout.truth()), &serde_json::to_vec_pretty(&transforms)?)?;
    Ok((folder.commit()?, object))
}

/// The joint of a part, as these layouts hold it.
fn transform(object: &Object, part: usize) -> Result<JointTransform, SynthError> {
    let name = &object.parts[part].name;
    let held = |what: &str| SynthError::Layout(format!("part '{name}' {what}"));
    let joint = object.parts[part].joint.filter(|j| j.parent == 0);
    let joint = joint.ok_or_else(|| held("hangs on a part that moves"))?;
    let (axis, origin) = object.axis_in_world(part).ok_or_else(|| held("has no joint"))?;
    let [q0, q1] = joint.positions;
    let (kind, rotate, translate) = match joint.kind {
        AxisMotion::Revolute => {
            ("rotate", Some(Ends::Named { l: q0.to_degrees(), r: q1.to_degrees() }), None)
        }
        AxisMotion::Prismatic => ("translate", None, Some(Ends::Named { l: q0, r: q1 })),
        AxisMotion::Screw { .. } => return Err(held("moves along a screw")),
    };
    let axis = TransformAxis { o: origin.coords.into(), d: axis.into_inner().into() };
    Ok(JointTransform { axis, kind: kind.into(), rotate, translate })
}

/// Surfaces of the whole, the static part and the moving ones, as they stand in a state.
fn put_meshes(folder: &RunDir, truth: &str, object: &Object, state: usize) -> Result<(), SynthError> {
    let meshes = object.meshes_in_world(state);
    let name = STATES[state];
    let path = |what: &str| format!("{truth}/{name}/{name}{what}_rotate.ply");
    folder.put(&path(""), &ply(&merged_mesh(&meshes.iter().collect::<Vec<_>>())))?;
    folder.put(&path("_static"), &ply(&meshes[0]))?;
    for (k, mesh) in meshes[1..].iter().enumerate() {
        // A single moving part has no number.
        let what = if meshes.len() == 2 { "_dynamic".into() } else { format!("_dynamic_{k}") };
        folder.put(&path(&what), &ply(mesh))?;
    }
    Ok(())
}

/// Camera matrix by rows; `shift` is the layout's coordinate of the first pixel's center.
fn matrix(k: &Intrinsics, shift: f64) -> [[f64; 3]; 3] {
    [[k.fx, 0.0, k.cx + shift], [0.0, k.fy, k.cy + shift], [0.0, 0.0, 1.0]]
}

/// Reported pose of a view, in OpenGL axes: (2.1).
fn opengl(frame: &SynthFrame) -> [[f64; 4]; 4] {
    let half_turn = Pose::from_parts(
        Vector3::zeros().into(),
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI),
    );
    // The view is halfway between the stamps of both poses.
    rows(&(frame.reported[0].lerp_slerp(&frame.reported[1], 0.5) * half_turn))
}

#[derive(Serialize)]
struct WrittenKeyframe {
    cam_in_ob: Vec<f64>,
    time: usize,
}

fn put_keyframes(
    folder: &RunDir,
    state: usize,
    recording: &SynthState,
    keyframes: &mut BTreeMap<String, WrittenKeyframe>,
) -> Result<(), SynthError> {
    let k = &recording.intrinsics;
    let rows = matrix(k, 0.0).map(|row| row.map(|x| x.to_string()).join(" "));
    folder.put("cam_K.txt", (rows.join("\n") + "\n").as_bytes())?;
    for (i, frame) in recording.frames.iter().enumerate() {
        let id = format!("{state}_{i:04}");
        folder.put(&format!("color_segmented/{id}.png"), &color_png(k, &frame.rgb)?)?;
        folder.put(&format!("depth_filtered/{id}.png"), &depth_png(k, &frame.depth_mm)?)?;
        let mask = mask_of(frame)?.iter().map(|on| if *on { 255 } else { 0 }).collect();
        folder.put(
            &format!("mask/{id}.png"),
            &png(ImageBuffer::from_raw(k.width as u32, k.height as u32, mask).map(DynamicImage::ImageLuma8))?,
        )?;
        let cam_in_ob = opengl(frame).concat();
        keyframes.insert(format!("frame_{id}"), WrittenKeyframe { cam_in_ob, time: state });
    }
    Ok(())
}

fn put_start_end(folder: &RunDir, state: usize, recording: &SynthState) -> Result<(), SynthError> {
    let k = &recording.intrinsics;
    let name = STATES[state];
    // Pixel centers of this layout are at half integers.
    let mut cameras = BTreeMap::from([("K".to_owned(), serde_json::to_value(matrix(k, 0.5))?)]);
    for (i, frame) in recording.frames.iter().enumerate() {
        let id = format!("{i:04}");
        let mask = mask_of(frame)?;
        let rgba =
            frame.rgb.iter().zip(mask).flat_map(|(c, on)| [c[0], c[1], c[2], if *on { 255 } else { 0 }]);
        let image = ImageBuffer::from_raw(k.width as u32, k.height as u32, rgba.collect());
        folder.put(&format!("{name}/train/{id}.png"), &png(image.map(DynamicImage::ImageRgba8))?)?;
        folder.put(&format!("{name}/depth/{id}.png"), &depth_png(k, &frame.depth_mm)?)?;
        cameras.insert(id, serde_json::to_value(opengl(frame))?);
    }
    folder.put(&format!("{name}/camera_train.json"), &serde_json::to_vec_pretty(&cameras)?)?;
    Ok(())
}

/// The mask of a view; these layouts need it.
fn mask_of(frame: &SynthFrame) -> Result<&[bool], SynthError> {
    frame.mask.as_deref().ok_or_else(|| SynthError::Layout("a camera carried by hand has no masks".into()))
}

fn color_png(k: &Intrinsics, rgb: &[[u8; 3]]) -> Result<Vec<u8>, SynthError> {
    let image = ImageBuffer::from_raw(k.width as u32, k.height as u32, rgb.as_flattened().to_vec());
    Ok(png(image.map(DynamicImage::ImageRgb8))?)
}
