//! Converts views received one by one to frames, as those of a recording.

use super::{
    camera::pinhole,
    depth_camera::{Camera, DepthSource},
    image_codec::{Raster, counts_units},
    pixels::{Maps, ViewPixels, limit_depth, scale_depth},
    ros2msg::CameraInfo,
    views::{check_size, depth_factor},
};
use capture::{CaptureConfig, CaptureError, RgbdFrame};
use geometry::Pose;

/// The decoded images of a view.
pub struct LiveImages {
    /// Color.
    pub color: Raster<[u8; 3]>,
    /// Depth, meters, integers taken for millimeters; 0: unknown.
    pub depth: Raster<f32>,
    /// Encoding of the depth message.
    pub depth_encoding: String,
    /// Object mask.
    pub mask: Option<Raster<bool>>,
}

/// What came about the camera of a view.
#[derive(Clone, Debug, Default)]
pub struct LiveCamera {
    /// The newest camera_info of color and of depth.
    pub infos: [Option<CameraInfo>; 2],
    /// Frames of the color and of the depth image.
    pub frames: [String; 2],
    /// Pose of the depth camera in color's frame by static transforms; `None` where they do not lead there.
    pub color_from_depth: Option<Pose>,
}

/// Names of the topics, for messages.
#[derive(Clone, Copy)]
pub struct LiveTopics<'a> {
    /// Color images.
    pub color: &'a str,
    /// CameraInfo of the color images.
    pub color_info: &'a str,
    /// Depth images.
    pub depth: &'a str,
    /// Object masks.
    pub mask: &'a str,
}

/// Converts views to frames.
pub struct LiveEye {
    config: CaptureConfig,
    /// The camera of the last view, with the maps to its ideal one.
    last: Option<(Camera, Maps)>,
}

impl LiveEye {
    /// A converter with the settings of a run.
    #[must_use]
    pub fn new(config: CaptureConfig) -> Self {
        Self { config, last: None }
    }

    /// The frame of a view, in its camera's own frame. Depth of another camera or size is brought to color's
    /// pixels; without a camera_info of depth, depth has color's field of view and lens.
    ///
    /// # Errors
    /// If the camera cannot be used, or an image has another size than its camera's.
    pub fn frame(
        &mut self,
        stamp_nanos: i64,
        seen_by: &LiveCamera,
        topics: LiveTopics<'_>,
        images: LiveImages,
    ) -> Result<RgbdFrame, CaptureError> {
        let LiveImages { color, depth, depth_encoding, mask } = images;
        let camera = camera_of_view(seen_by, topics, (depth.width, depth.height))?;
        let intrinsics = camera.intrinsics;
        check_size(topics.color, (color.width, color.height), stamp_nanos, &intrinsics)?;
        check_size(topics.depth, (depth.width, depth.height), stamp_nanos, camera.of_depth())?;
        if let Some(mask) = &mask {
            check_size(topics.mask, (mask.width, mask.height), stamp_nanos, &intrinsics)?;
        }
        let pixels =
            ViewPixels { rgb: color.pixels, depth_m: depth.pixels, mask: mask.map(|raster| raster.pixels) };
        let maps = match self.last.take() {
            Some((known, maps)) if known == camera => maps,
            _ => Maps::of_camera(&camera),
        };
        let mut pixels = maps.ideal_pixels(pixels);
        self.last = Some((camera, maps));
        if counts_units(&depth_encoding) {
            scale_depth(&mut pixels.depth_m, depth_factor(self.config.depth_unit_m));
        }
        limit_depth(&mut pixels.depth_m, &self.config);
        Ok(RgbdFrame {
            id: String::new(),
            stamp_nanos,
            intrinsics,
            world_from_camera: Pose::identity(),
            rgb: pixels.rgb,
            depth_m: pixels.depth_m,
            mask: pixels.mask,
            readings: Vec::new(),
        })
    }
}

fn camera_of_view(
    seen_by: &LiveCamera,
    topics: LiveTopics<'_>,
    depth_size: (usize, usize),
) -> Result<Camera, CaptureError> {
    let [Some(info), depth_info] = &seen_by.infos else {
        return Err(CaptureError::CameraInfo {
            topic: topics.color_info.into(),
            reason: "there is none".into(),
        });
    };
    let (intrinsics, lens) = pinhole(info, topics.color_info, topics.color)?;
    let own = depth_info.as_ref().map(|d| pinhole(d, "camera_info of depth", topics.depth)).transpose()?;
    let source = DepthSource {
        own,
        size: Some(depth_size),
        color_from_depth: seen_by.color_from_depth,
        topics: [topics.color.to_owned(), topics.depth.to_owned()],
        frames: seen_by.frames.clone(),
    };
    source.camera(intrinsics, lens)
}
