//! Images of made recordings as PNG files.

use std::io::Cursor;

use image::{DynamicImage, ImageBuffer, ImageFormat};

use super::synth_error::SynthError;
use crate::geometry::Intrinsics;

/// Depth in millimeters, 16 bits.
pub(super) fn depth_png(k: &Intrinsics, depth_mm: &[u16]) -> Result<Vec<u8>, SynthError> {
    let image = ImageBuffer::from_raw(k.width as u32, k.height as u32, depth_mm.to_vec());
    png(image.map(DynamicImage::ImageLuma16))
}

/// PNG file of an image; nothing of pixels that do not fill it.
pub(super) fn png(image: Option<DynamicImage>) -> Result<Vec<u8>, SynthError> {
    let mut file = Cursor::new(Vec::new());
    if let Some(image) = image {
        image.write_to(&mut file, ImageFormat::Png)?;
    }
    Ok(file.into_inner())
}
