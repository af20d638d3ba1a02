//! A set of images with camera and pose, decoded as in a recording.

use super::sample::Picture;
use capture::CaptureError;
use geometry::{Intrinsics, Pose};
use io::{
    check_size,
    image_codec::{ImageError, Raster},
    pinhole,
    ros2msg::CameraInfo,
};

/// Matched images with everything that a recording needs.
#[derive(Clone, Debug)]
pub(crate) struct View {
    /// Stamp of the color image, nanoseconds.
    pub stamp_nanos: i64,
    /// Color, depth, mask.
    pub images: [Option<Picture>; 3],
    /// Pose of the optical frame in the world.
    pub world_from_camera: Pose,
}

/// Pixels of a view, before removal of lens distortion.
#[derive(Clone, Debug)]
pub(crate) struct Pixels {
    /// Pinhole intrinsics of the color camera.
    pub intrinsics: Intrinsics,
    /// Color.
    pub color: Raster<[u8; 3]>,
    /// Depth, meters; 0: unknown.
    pub depth: Raster<f32>,
    /// Object mask.
    pub mask: Option<Raster<bool>>,
}

/// Why the images of a view cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ViewError {
    /// The camera_info or the size of an image is invalid.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// Color or depth is missing.
    #[error("an image is missing")]
    Missing,
    /// An image cannot be decoded.
    #[error("{topic}: {source}")]
    Image {
        /// Topic of the image.
        topic: String,
        /// Why it cannot be decoded.
        source: ImageError,
    },
}

impl View {
    /// Decodes all images with the checks of a recording. `info` is that of the color camera; topic names are
    /// for messages.
    ///
    /// # Errors
    /// [`ViewError`] with the image and what is wrong.
    pub(crate) fn decoded_pixels(
        &self,
        info: &CameraInfo,
        info_topic: &str,
        topics: [&str; 3],
    ) -> Result<Pixels, ViewError> {
        // Only parsed to check it: the pipeline removes distortion.
        let (intrinsics, _) = pinhole(info, info_topic, topics[0])?;
        let [Some(color), Some(depth), mask] = &self.images else { return Err(ViewError::Missing) };
        // All images or none, as a view without depth is useless later.
        let color = self.checked_raster(topics[0], &intrinsics, color.color_raster())?;
        let depth = self.checked_raster(topics[1], &intrinsics, depth.depth_raster())?;
        let mask = mask
            .as_ref()
            .map(|m| self.checked_raster(topics[2], &intrinsics, m.mask_raster()))
            .transpose()?;
        Ok(Pixels { intrinsics, color, depth, mask })
    }

    fn checked_raster<T>(
        &self,
        topic: &str,
        camera: &Intrinsics,
        decoded: Result<Raster<T>, ImageError>,
    ) -> Result<Raster<T>, ViewError> {
        let raster = decoded.map_err(|source| ViewError::Image { topic: topic.to_owned(), source })?;
        check_size(topic, (raster.width, raster.height), self.stamp_nanos, camera)?;
        Ok(raster)
    }
}
