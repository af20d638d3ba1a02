//! Folders of images as other programs and phones write them, read as recordings: their images, cameras and
//! poses become the messages of a bag, so everything behind the reader is the same.
//!
//! A reader (`tum`, `object_frames`, `transforms`, `stray`, `record3d`) lists the files of its form; this
//! module makes messages of them. `docs/folders.md` has the forms.

mod depth_file;
mod object_frames;
mod record3d;
mod stray;
mod text;
mod transforms;
mod tum;

use std::{
    io,
    path::{Path, PathBuf},
};

use geometry::{Intrinsics, Pose};

use self::depth_file::{depth_message, depth_start};
use super::{
    dataset::files::{image_size, read, read_start, refuse},
    image_codec::MAX_SIDE,
    mcap_file::{FileReport, RawMessage},
    ros2msg::{
        CameraInfo, CompressedImage, DecodeError, Header, TfMessage, Time, Transform, TransformStamped,
        encode,
    },
    topics::INFO_TYPE,
};
use capture::CaptureError;
use common::note::{Note, NoteCode};

/// Topic of color images; those of a form are named alike, so they are chosen as those of a bag.
const COLOR: &str = "/color/image";
const COLOR_INFO: &str = "/color/camera_info";
const DEPTH: &str = "/depth/image";
const DEPTH_INFO: &str = "/depth/camera_info";
const MASK: &str = "/object_mask";
/// Optical frame of all images.
const CAMERA: &str = "camera";
/// Frame of the poses.
const WORLD: &str = "world";
const TF_TYPE: &str = "tf2_msgs/msg/TFMessage";
const COMPRESSED: &str = "sensor_msgs/msg/CompressedImage";
/// Stamp of the first image where a form has no times, nanoseconds; not 0, which stands for a missing stamp.
const FIRST_NANOS: i64 = 1_000_000_000;
/// Time between images where a form has no times, nanoseconds. chosen: cameras have 30 Hz
const PERIOD_NANOS: i64 = 33_333_333;

/// What an image file shows.
#[derive(Clone, Debug, PartialEq)]
enum Shown {
    Color,
    /// Depth, with the file of its confidence where there is one.
    Depth(Option<PathBuf>),
    Mask,
}

/// An image of a folder.
#[derive(Clone, Debug, PartialEq)]
struct ImageFile {
    stamp_nanos: i64,
    shown: Shown,
    path: PathBuf,
}

/// A camera, with the coefficients of its lens.
#[derive(Clone, Debug, PartialEq)]
struct Matrix {
    camera: Intrinsics,
    /// Name of the lens model.
    model: &'static str,
    lens: Vec<f64>,
}

impl Matrix {
    /// A camera without distortion.
    fn pinhole(camera: Intrinsics) -> Self {
        Self { camera, model: "plumb_bob", lens: vec![0.0; 5] }
    }

    fn info(&self, stamp_nanos: i64) -> CameraInfo {
        let Intrinsics { width, height, fx, fy, cx, cy } = self.camera;
        CameraInfo {
            header: header(stamp_nanos),
            height: height as u32,
            width: width as u32,
            distortion_model: self.model.to_owned(),
            d: self.lens.clone(),
            k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
            ..CameraInfo::default()
        }
    }
}

/// A folder of images that stands for one recording.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageFolder {
    /// Name of its form.
    pub form: &'static str,
    images: Vec<ImageFile>,
    /// Camera of the color images by stamp; one alone is that of all.
    matrices: Vec<(i64, Matrix)>,
    /// Columns and rows of the depth images.
    depth_size: (usize, usize),
    poses: Vec<(i64, Pose)>,
    /// Unit of 16-bit depth, meters.
    depth_unit_m: f64,
    /// Whether the world's y points up, as that of ARKit does.
    is_y_up: bool,
}

/// The form of a folder, by the files that only it has.
type Opener = fn(&Path) -> Result<ImageFolder, CaptureError>;

fn opener(path: &Path) -> Option<Opener> {
    let has = |name: &str| path.join(name).exists();
    match () {
        () if has("rgb.txt") && has("depth.txt") => Some(tum::open),
        () if has("transforms.json") => Some(transforms::open),
        () if has("odometry.csv") && has("camera_matrix.csv") => Some(stray::open),
        () if record3d::metadata_path(path).is_some() => Some(record3d::open),
        () if has("init_keyframes.yml") => None,
        () if object_frames::is_at(path) => Some(object_frames::open),
        () => None,
    }
}

impl ImageFolder {
    /// Whether a folder has one of the forms.
    #[must_use]
    pub fn is_at(path: &Path) -> bool {
        opener(path).is_some()
    }

    /// Lists the files of a folder; `None` where it has none of the forms.
    ///
    /// # Errors
    /// [`CaptureError::Dataset`] and [`CaptureError::Read`] where a file of its form is missing or broken.
    pub fn open(path: &Path) -> Result<Option<Self>, CaptureError> {
        let Some(open) = opener(path) else { return Ok(None) };
        let mut folder = open(path)?;
        let first = |shown: fn(&Shown) -> bool| folder.images.iter().find(|i| shown(&i.shown));
        let Some(color) = first(|s| *s == Shown::Color) else { return refuse(path, "it has no color image") };
        let Some(depth) = first(|s| matches!(s, Shown::Depth(_))) else {
            return refuse(path, "it has no depth image");
        };
        let color_size = image_size(&color.path)?;
        folder.depth_size = depth_file::size(&depth.path)?;
        folder.fit_matrices(path, color_size)?;
        folder.images.sort_by_key(|i| i.stamp_nanos);
        folder.poses.sort_by_key(|p| p.0);
        Ok(Some(folder))
    }

    /// Brings the matrices to the size of the images, where these are the same view at another size.
    fn fit_matrices(&mut self, path: &Path, size: (usize, usize)) -> Result<(), CaptureError> {
        let (width, height) = size;
        for (_, Matrix { camera, .. }) in &mut self.matrices {
            let is_large = camera.width.max(camera.height).max(width).max(height) > MAX_SIDE;
            // A side of a scaled image is rounded to a pixel.
            if is_large || (camera.width * height).abs_diff(camera.height * width) > camera.width {
                let reason = format!(
                    "its camera matrix is for {}x{} pixels, its images have {width}x{height}",
                    camera.width, camera.height
                );
                return refuse(path, reason);
            }
            *camera = camera.at_size(width, height);
        }
        Ok(())
    }

    /// The image files.
    #[must_use]
    pub fn files(&self) -> Vec<PathBuf> {
        self.images.iter().map(|i| i.path.clone()).collect()
    }

    /// Number of color images, and their columns and rows.
    #[must_use]
    pub fn views(&self) -> (u64, Option<(u32, u32)>) {
        let count = self.images.iter().filter(|i| i.shown == Shown::Color).count();
        let camera = self.matrices.first().map(|(_, m)| m.camera);
        (count as u64, camera.map(|c| (c.width as u32, c.height as u32)))
    }

    /// Unit of depth, meters.
    #[must_use]
    pub fn depth_unit_m(&self) -> f64 {
        self.depth_unit_m
    }

    /// What is known of the folder, as a note.
    #[must_use]
    pub fn note(&self, path: &Path) -> Note {
        let poses = match self.poses.len() {
            0 => "no poses".to_owned(),
            count => format!("{count} poses"),
        };
        let turned = if self.is_y_up { ", turned so that z points up" } else { "" };
        Note::new(
            NoteCode::DatasetFormat,
            format!(
                "`{}` is a folder of {}: {} color images, {poses}{turned}",
                path.display(),
                self.form,
                self.views().0
            ),
        )
    }

    /// Passes the folder's messages to the visitor: poses, cameras, then images, each in the order of time.
    /// Without `pixels` only the start of each image is read.
    ///
    /// # Errors
    /// The visitor's; [`CaptureError::Read`] of a file.
    pub fn read(
        &self,
        pixels: bool,
        visit: &mut dyn FnMut(&RawMessage) -> Result<(), CaptureError>,
    ) -> Result<FileReport, CaptureError> {
        let mut sink = MessageSink { visit, report: FileReport::default() };
        for (stamp, pose) in &self.poses {
            sink.send("/tf", TF_TYPE, *stamp, &encoded(&transform(*stamp, &self.in_z_up(pose)))?)?;
        }
        let color_size = self.matrices.first().map_or((0, 0), |(_, m)| (m.camera.width, m.camera.height));
        for (stamp, matrix) in &self.matrices {
            sink.send(COLOR_INFO, INFO_TYPE, *stamp, &encoded(&matrix.info(*stamp))?)?;
            // Aligned depth of color's size has color's camera.
            if self.depth_size != color_size {
                let camera = matrix.camera.at_size(self.depth_size.0, self.depth_size.1);
                let depth = Matrix { camera, ..matrix.clone() };
                sink.send(DEPTH_INFO, INFO_TYPE, *stamp, &encoded(&depth.info(*stamp))?)?;
            }
        }
        for image in &self.images {
            let stamp = image.stamp_nanos;
            match &image.shown {
                Shown::Color | Shown::Mask => {
                    let topic = if image.shown == Shown::Mask { MASK } else { COLOR };
                    let data = if pixels { read(&image.path)? } else { read_start(&image.path)? };
                    sink.send(topic, COMPRESSED, stamp, &picture_message(stamp, data)?)?;
                }
                Shown::Depth(confidence) => {
                    let message = if pixels { depth_message } else { depth_start };
                    let depth = message(header(stamp), &image.path, confidence.as_deref())?;
                    sink.send(DEPTH, depth.type_name, stamp, &depth.data)?;
                }
            }
        }
        Ok(sink.report)
    }

    /// The pose in a world whose z points up.
    fn in_z_up(&self, world_from_camera: &Pose) -> Pose {
        if !self.is_y_up {
            return *world_from_camera;
        }
        // Right-handed, y to z, z to x, x to y: a third of a turn about the diagonal.
        let axis = nalgebra::Unit::new_normalize(nalgebra::Vector3::new(1.0, 1.0, 1.0));
        let turn = nalgebra::UnitQuaternion::from_axis_angle(&axis, std::f64::consts::TAU / 3.0);
        Pose::from_parts(nalgebra::Translation3::identity(), turn) * world_from_camera
    }
}

/// Takes the messages of a folder and counts them.
struct MessageSink<'a> {
    visit: &'a mut dyn FnMut(&RawMessage) -> Result<(), CaptureError>,
    report: FileReport,
}

impl MessageSink<'_> {
    fn send(
        &mut self,
        topic: &str,
        type_name: &str,
        stamp_nanos: i64,
        data: &[u8],
    ) -> Result<(), CaptureError> {
        self.report.messages += 1;
        (self.visit)(&RawMessage {
            topic,
            type_name,
            message_encoding: "cdr",
            log_time_nanos: u64::try_from(stamp_nanos).unwrap_or(0),
            publish_time_nanos: 0,
            sequence: 0,
            data,
        })
    }
}

/// The stamp of an image of a form without times, nanoseconds.
fn made_stamp(index: usize) -> i64 {
    FIRST_NANOS + index as i64 * PERIOD_NANOS
}

fn header(stamp_nanos: i64) -> Header {
    Header { stamp: Time::from_nanos(stamp_nanos), frame_id: CAMERA.into() }
}

fn transform(stamp_nanos: i64, world_from_camera: &Pose) -> TfMessage {
    let header = Header { stamp: Time::from_nanos(stamp_nanos), frame_id: WORLD.into() };
    let transform = Transform::from_pose(world_from_camera);
    TfMessage { transforms: vec![TransformStamped { header, child_frame_id: CAMERA.into(), transform }] }
}

/// A color image or mask as it is in its file.
fn picture_message(stamp_nanos: i64, data: Vec<u8>) -> Result<Vec<u8>, CaptureError> {
    let format = if data.starts_with(&[0xff, 0xd8]) { "jpeg" } else { "png" };
    encoded(&CompressedImage { header: header(stamp_nanos), format: format.into(), data })
}

fn encoded<T: serde::Serialize>(message: &T) -> Result<Vec<u8>, CaptureError> {
    encode(message).map_err(unencoded)
}

fn unencoded(error: DecodeError) -> CaptureError {
    CaptureError::Read { path: PathBuf::new(), source: io::Error::other(error) }
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
