//! A set of images with camera and pose, decoded as in a recording.

use super::{sample::Picture, state_bag::Topics};
use capture::{CaptureError, RgbdFrame};
use geometry::Pose;
use io::{
    LiveCamera, LiveEye, LiveImages,
    image_codec::{ImageError, Raster},
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

/// Why the images of a view cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ViewError {
    /// The camera or the size of an image is invalid.
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
    /// Decodes all images with the checks of a recording, and brings them to the ideal camera of color.
    ///
    /// # Errors
    /// [`ViewError`] with the image and what is wrong.
    pub(crate) fn frame(
        &self,
        eye: &mut LiveEye,
        seen_by: &LiveCamera,
        topics: &Topics,
    ) -> Result<RgbdFrame, ViewError> {
        let [Some(color), Some(depth), mask] = &self.images else { return Err(ViewError::Missing) };
        let names = topics.live_names();
        // All images or none, as a view without depth is useless later.
        let images = LiveImages {
            color: raster_of_topic(names.color, color.color_raster())?,
            depth: raster_of_topic(names.depth, depth.depth_raster())?,
            depth_encoding: depth.encoding().to_owned(),
            mask: mask.as_ref().map(|m| raster_of_topic(names.mask, m.mask_raster())).transpose()?,
        };
        let frame = eye.frame(self.stamp_nanos, seen_by, names, images)?;
        Ok(RgbdFrame { world_from_camera: self.world_from_camera, ..frame })
    }
}

fn raster_of_topic<T>(topic: &str, decoded: Result<Raster<T>, ImageError>) -> Result<Raster<T>, ViewError> {
    decoded.map_err(|source| ViewError::Image { topic: topic.to_owned(), source })
}
