//! Input and result of a run as a rerun recording (<https://rerun.io>): camera, images, surfaces, parts,
//! joints.

use std::path::Path;

use nalgebra::Vector3;
use re_sdk::{
    AsComponents, RecordingStream, RecordingStreamBuilder, RecordingStreamError,
    blueprint::{
        Blueprint, ContainerLike, Horizontal, Spatial2DView, Spatial3DView, TextDocumentView, TimeSeriesView,
        Vertical,
    },
};
use re_sdk_types::{
    archetypes::{
        Arrows3D, EncodedDepthImage, EncodedImage, LineStrips3D, Mesh3D, Pinhole, Scalars, TextDocument,
        Transform3D, ViewCoordinates,
    },
    datatypes::Quaternion,
};

use super::{
    image_files::{depth_png, jpeg},
    write_new,
};
use capture::{Capture, RgbdFrame};
use common::note::Note;
use geometry::Pose;
use model::ArticulatedModel;
use surface::TriangleMesh;

/// Timeline of the views, in the order of recording.
const VIEW: &str = "view";
/// Timeline on which all joints go from their lower to their upper limits and back.
const MOTION: &str = "motion";
/// Number of steps of that motion, there and back.
const STEPS: usize = 60;
/// Quality of the color images: a choice, a tenth of the size of PNG.
const JPEG_QUALITY: u8 = 85;
/// Depth of the images, units a meter. derived: millimeters
const DEPTH_UNITS: f32 = 1000.0;
/// Length and thickness of a joint's arrow, as shares of the size of its child. chosen: for the eye
const ARROW: f64 = 0.6;
const ARROW_RADIUS: f64 = 0.01;

/// Why no recording was written.
#[derive(Debug, thiserror::Error)]
pub enum RerunError {
    /// The library refuses its input.
    #[error("cannot make the rerun recording: {0}")]
    Log(#[from] RecordingStreamError),
    /// The log cannot be written.
    #[error("cannot make the rerun recording: {0}")]
    Encode(Box<dyn std::error::Error + Send + Sync>),
    /// The file exists already, or cannot be written.
    #[error("cannot write `{}`; give a name that is not taken, in a folder that is there", path.display())]
    Write {
        /// Where it was to go.
        path: std::path::PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
}

/// What the recording is made from.
pub struct Seen<'a> {
    /// Posed images; the world is that of state 0.
    pub capture: &'a Capture,
    /// Fused surface of each state, as far as there are any, world frame.
    pub surfaces: &'a [TriangleMesh],
    /// The twin.
    pub model: &'a ArticulatedModel,
    /// Losses and uncertainties.
    pub warnings: &'a [Note],
}

/// Writes a recording for `rerun FILE`. Its bytes differ every time, as the library numbers log entries by
/// the clock.
///
/// # Errors
/// Something has that name, or the system or the library refuses.
pub fn write_rerun(path: &Path, seen: &Seen) -> Result<(), RerunError> {
    let (stream, storage) =
        RecordingStreamBuilder::new("artitwin").with_default_blueprint(blueprint()).memory()?;
    stream.log_static("world", &ViewCoordinates::RIGHT_HAND_Z_UP())?;
    for (state, mesh) in seen.surfaces.iter().enumerate() {
        stream.log_static(format!("world/fused/state{state}"), &surface(mesh))?;
    }
    views(&stream, seen)?;
    twin(&stream, seen.model)?;
    stream.log_static("notes", &TextDocument::from_markdown(text(seen)))?;
    let bytes = storage.drain_as_bytes().map_err(|e| RerunError::Encode(e.into()))?;
    write_new(path, &bytes).map_err(|source| RerunError::Write { path: path.to_owned(), source })
}

fn space_view(name: &str, contents: &[&str]) -> ContainerLike {
    Spatial3DView::new(name).with_origin("world").with_contents(contents.iter().copied()).into()
}

fn image_view(name: &str, entity: &str) -> ContainerLike {
    Spatial2DView::new(name).with_origin("world/camera").with_contents([entity]).into()
}

/// The layout in which the viewer shows the twin and its recording.
fn blueprint() -> Blueprint {
    Blueprint::new(Horizontal::new([
        Vertical::new([
            space_view("twin", &["world/twin/**"]),
            space_view("recording", &["world/fused/**", "world/camera/**", "world/path/**"]),
        ])
        .into(),
        Vertical::new([
            image_view("color", "world/camera/color"),
            image_view("depth", "world/camera/depth"),
            TimeSeriesView::new("joints").with_origin("joints").into(),
            TextDocumentView::new("notes").with_origin("notes").into(),
        ])
        .into(),
    ]))
}

/// Logs images and camera of every view, with the twin in the pose of the state.
fn views(stream: &RecordingStream, seen: &Seen) -> Result<(), RerunError> {
    let mut number = 0;
    for (state, frames) in seen.capture.states.iter().enumerate() {
        let path = frames.iter().map(|f| f.world_from_camera.translation.vector.cast::<f32>().into());
        stream.log_static(
            format!("world/path/state{state}"),
            &LineStrips3D::new([path.collect::<Vec<[f32; 3]>>()]),
        )?;
        for frame in frames {
            stream.set_time_sequence(VIEW, number);
            number += 1;
            view(stream, frame)?;
            if let Some(positions) = seen.model.states.get(state) {
                stand(stream, seen.model, positions)?;
            }
        }
    }
    stream.reset_time();
    Ok(())
}

fn view(stream: &RecordingStream, frame: &RgbdFrame) -> Result<(), RerunError> {
    let k = &frame.intrinsics;
    stream.log("world/camera", &transform(&frame.world_from_camera))?;
    let [fx, fy, cx, cy, width, height] =
        [k.fx, k.fy, k.cx, k.cy, k.width as f64, k.height as f64].map(|x| x as f32);
    // Column by column. Here integer coordinates are pixel centers, in rerun they are pixel corners.
    let image_from_camera = [[fx, 0.0, 0.0], [0.0, fy, 0.0], [cx + 0.5, cy + 0.5, 1.0]];
    stream.log("world/camera", &Pinhole::new(image_from_camera).with_resolution([width, height]))?;
    let color = jpeg(k, &frame.rgb, JPEG_QUALITY).map_err(|e| RerunError::Encode(e.into()))?;
    stream.log("world/camera/color", &EncodedImage::from_file_contents(color))?;
    let units: Vec<u16> = frame.depth_m.iter().map(|d| (d * DEPTH_UNITS).round() as u16).collect();
    let depth = depth_png(k, &units).map_err(|e| RerunError::Encode(e.into()))?;
    let depth = EncodedDepthImage::from_file_contents(depth);
    Ok(stream.log("world/camera/depth", &depth.with_meter(DEPTH_UNITS))?)
}

/// Logs meshes of the links, and the motion through their joints' limits.
fn twin(stream: &RecordingStream, model: &ArticulatedModel) -> Result<(), RerunError> {
    for link in &model.links {
        stream.log_static(format!("world/twin/{}", link.name), &surface(&link.visual))?;
    }
    for step in 0..=STEPS {
        stream.set_time_sequence(MOTION, step as i64);
        let share = 1.0 - (2.0 * step as f64 / STEPS as f64 - 1.0).abs();
        let limits = model.joints.iter().map(|j| &j.limit);
        let positions: Vec<f64> = limits.map(|l| l.lower + share * (l.upper - l.lower)).collect();
        stand(stream, model, &positions)?;
    }
    stream.reset_time();
    Ok(())
}

/// Logs links and joints at joint positions.
fn stand(stream: &RecordingStream, model: &ArticulatedModel, positions: &[f64]) -> Result<(), RerunError> {
    for (i, link) in model.links.iter().enumerate() {
        let pose = model.world_from_link(i, positions);
        stream.log(format!("world/twin/{}", link.name), &transform(&pose))?;
    }
    for (joint, position) in model.joints.iter().zip(positions) {
        let child = model.links[joint.child].visual.bounds();
        let size = child.map_or(0.1, |(lower, upper)| f64::from((upper - lower).norm()));
        let frame = model.world_from_link(joint.parent, positions) * joint.parent_from_joint;
        let along: Vector3<f32> = (frame * joint.axis.into_inner() * (ARROW * size)).cast();
        let from: Vector3<f32> = frame.translation.vector.cast();
        let arrow = Arrows3D::from_vectors([<[f32; 3]>::from(along)])
            .with_origins([<[f32; 3]>::from(from - 0.5 * along)])
            .with_radii([(ARROW_RADIUS * size) as f32])
            .with_labels([format!("{}: {}", joint.name, joint.kind.name())]);
        stream.log(format!("world/twin/joints/{}", joint.name), &arrow)?;
        let shown = if joint.kind.turns() { position.to_degrees() } else { 1e3 * position };
        stream.log(format!("joints/{}", joint.name), &Scalars::single(shown))?;
    }
    Ok(())
}

fn surface(mesh: &TriangleMesh) -> impl AsComponents + use<> {
    let vertices: Vec<[f32; 3]> = mesh.vertices.iter().map(|v| v.coords.into()).collect();
    let shown = Mesh3D::new(vertices).with_triangle_indices(mesh.triangles.iter().copied());
    if mesh.colors.is_empty() { shown } else { shown.with_vertex_colors(mesh.colors.iter().copied()) }
}

fn transform(pose: &Pose) -> Transform3D {
    let t: [f32; 3] = pose.translation.vector.cast::<f32>().into();
    let q: [f32; 4] = pose.rotation.coords.cast::<f32>().into();
    Transform3D::from_translation_rotation(t, Quaternion::from_xyzw(q))
}

fn joint_line(j: &model::Joint) -> String {
    let (unit, scale) = if j.kind.turns() { ("deg", 1f64.to_degrees()) } else { ("mm", 1e3) };
    let [lower, upper] = [j.limit.lower, j.limit.upper].map(|x| x * scale);
    format!("- `{}`: {}, {lower:.1} to {upper:.1} {unit}\n", j.name, j.kind.name())
}

/// Joints, units of their curves, warnings.
fn text(seen: &Seen) -> String {
    let joints: String = seen.model.joints.iter().map(joint_line).collect();
    let warnings: String = seen.warnings.iter().map(|w| format!("- {}\n", w.text)).collect();
    let warned = if warnings.is_empty() { String::new() } else { format!("\n## Warnings\n\n{warnings}") };
    format!(
        "# {}\n\n{joints}\nTimeline `{VIEW}`: the views as they were recorded. Timeline `{MOTION}`: all \
         joints through their limits.\n{warned}",
        seen.model.name
    )
}
