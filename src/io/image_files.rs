//! Images as files of their usual forms.

use std::io::Cursor;

use image::{
    DynamicImage, ExtendedColorType, ImageBuffer, ImageFormat, ImageResult, codecs::jpeg::JpegEncoder,
};

use geometry::Intrinsics;

/// Depth of 16 bits as PNG.
pub(super) fn depth_png(k: &Intrinsics, depth: &[u16]) -> ImageResult<Vec<u8>> {
    let image = ImageBuffer::from_raw(k.width as u32, k.height as u32, depth.to_vec());
    png(image.map(DynamicImage::ImageLuma16))
}

/// PNG file of an image; `None` if the pixels do not fill it.
pub(super) fn png(image: Option<DynamicImage>) -> ImageResult<Vec<u8>> {
    let mut file = Cursor::new(Vec::new());
    if let Some(image) = image {
        image.write_to(&mut file, ImageFormat::Png)?;
    }
    Ok(file.into_inner())
}

/// JPEG file of a color image; `quality` of 1 to 100.
pub(super) fn jpeg(k: &Intrinsics, rgb: &[[u8; 3]], quality: u8) -> ImageResult<Vec<u8>> {
    let mut file = Vec::new();
    let width = k.width as u32;
    let height = k.height as u32;
    JpegEncoder::new_with_quality(&mut file, quality).encode(
        rgb.as_flattened(),
        width,
        height,
        ExtendedColorType::Rgb8,
    )?;
    Ok(file)
}
