//! Converts views received one by one to frames, as those of a recording.

use super::{camera::pinhole, image_codec::Raster, pixels::limit_depth, ros2msg::CameraInfo};
use capture::{CaptureConfig, CaptureError, Distortion, RgbdFrame, UndistortMap};
use geometry::{Intrinsics, Pose};

/// A camera as described by its camera_info.
#[derive(Clone, Copy, PartialEq)]
struct Lens {
    intrinsics: Intrinsics,
    color: Distortion,
    depth: Distortion,
}

/// Converts views to frames.
pub struct LiveEye {
    config: CaptureConfig,
    /// The camera of the last view, with its undistortion maps.
    lens: Option<(Lens, [Option<UndistortMap>; 2])>,
}

impl LiveEye {
    /// A converter with the settings of a run.
    #[must_use]
    pub fn new(config: CaptureConfig) -> Self {
        Self { config, lens: None }
    }

    /// The frame of a view, in its camera's own frame. Its images must have the size stated in `infos` (of
    /// color and of depth); without a camera_info of depth, depth has color's lens. `topics` are the names of
    /// color's camera_info and images.
    ///
    /// # Errors
    /// If the camera cannot be used.
    pub fn see(
        &mut self,
        stamp_nanos: i64,
        infos: [Option<&CameraInfo>; 2],
        topics: [&str; 2],
        (color, depth): (&Raster<[u8; 3]>, &Raster<f32>),
    ) -> Result<RgbdFrame, CaptureError> {
        let [Some(info), depth_info] = infos else {
            return Err(CaptureError::CameraInfo { topic: topics[0].into(), reason: "there is none".into() });
        };
        let (intrinsics, own) = pinhole(info, topics[0], topics[1])?;
        let of_depth = depth_info.map(|d| pinhole(d, "camera_info of depth", topics[1])).transpose()?;
        let lens = Lens { intrinsics, color: own, depth: of_depth.map_or(own, |d| d.1) };
        if self.lens.as_ref().is_none_or(|(known, _)| *known != lens) {
            let maps = [&lens.color, &lens.depth].map(|d| UndistortMap::new(&intrinsics, d));
            self.lens = Some((lens, maps));
        }
        let maps = self.lens.as_ref().map(|(_, maps)| maps);
        let [of_color, of_depth] = [0, 1].map(|k| maps.and_then(|m| m[k].as_ref()));
        let rgb = of_color.map_or_else(|| color.pixels.clone(), |map| map.undistorted_color(&color.pixels));
        let mut depth_m =
            of_depth.map_or_else(|| depth.pixels.clone(), |map| map.undistorted_nearest(&depth.pixels, 0.0));
        limit_depth(&mut depth_m, &self.config);
        Ok(RgbdFrame {
            id: String::new(),
            stamp_nanos,
            intrinsics,
            world_from_camera: Pose::identity(),
            rgb,
            depth_m,
            mask: None,
            readings: Vec::new(),
        })
    }
}
