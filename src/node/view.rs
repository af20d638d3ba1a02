//! A set of images with its camera and pose, decoded as a recording's are.

use super::sample::Picture;
use capture::CaptureError;
use geometry::{Intrinsics, Pose};
use io::{
    check_size,
    image_codec::{ImageError, Raster},
    pinhole,
    ros2msg::CameraInfo,
};

/// Matching images, with all data for a recording.
#[derive(Clone, Debug)]
pub(crate) struct View {
    /// Stamp of the color image, nanoseconds.
    pub stamp_nanos: i64,
    /// Color, depth, mask.
    pub images: [Option<Picture>; 3],
    /// Pose of the optical frame.
    pub world_from_camera: Pose,
}

/// A view's pixels, not undistorted.
#[derive(Clone, Debug)]
pub(crate) struct Pixels {
    /// The pinhole of the color camera.
    pub intrinsics: Intrinsics,
    /// Color.
    pub color: Raster<[u8; 3]>,
    /// Depth, meters; 0: unknown.
    pub depth: Raster<f32>,
    /// The object.
    pub mask: Option<Raster<bool>>,
}

/// Why the images of a view cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ViewError {
    /// The camera or the size of an image.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// Color or depth did not come.
    #[error("an image is missing")]
    Missing,
    /// An image cannot be decoded.
    #[error("{topic}: {source}")]
    Image {
        /// Its topic.
        topic: String,
        /// Why.
        source: ImageError,
    },
}

impl View {
    /// Decodes all images, with the checks of a recording. `info` is the color camera's; the topics' names
    /// are for messages.
    ///
    /// # Errors The image and its fault.
    pub(crate) fn decoded_pixels(
        &self,
        info: &CameraInfo,
        info_topic: &str,
        topics: [&str; 3],
    ) -> Result<Pixels, ViewError> {
        // The lens is left to the pipeline's undistortion; here reading it is enough.
        let (intrinsics, _) = pinhole(info, info_topic, topics[0])?;
        let [Some(color), Some(depth), mask] = &self.images else { return Err(ViewError::Missing) };
        // All of a view or nothing: a view without depth cannot be used later.
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
