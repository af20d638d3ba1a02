//! Decodes image messages and image files: color to 8-bit RGB, depth to meters, masks to booleans.
//!
//! Sizes, steps and encodings are checked here; nothing is read beyond the message's data.

use std::borrow::Cow;

use image::{DynamicImage, ImageFormat, ImageReader, Limits};

use super::{
    picture_size::{bare_png, stated_size},
    ros2msg::{CompressedImage, Image},
    rvl,
};

/// Largest width and height, pixels.
pub const MAX_SIDE: usize = 8192;

/// Row-major pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster<T> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` values.
    pub pixels: Vec<T>,
}

/// Truth values of an image's pixels, row-major.
pub type Mask = Vec<bool>;

/// Why an image gave no pixels.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ImageError {
    /// The encoding cannot be used: every image of the topic is refused.
    #[error("encoding `{encoding}` is not supported; {supported}")]
    Encoding {
        /// Its name.
        encoding: String,
        /// The supported encodings.
        supported: &'static str,
    },
    /// This one image is broken.
    #[error("{0}")]
    Broken(String),
}

const COLOR_SUPPORTED: &str = "color must have 8 bits a channel: rgb8, bgr8, rgba8, bgra8, mono8, or JPEG \
    or PNG; set the camera to rgb8";
const DEPTH_SUPPORTED: &str =
    "depth must be 16UC1 or mono16 (millimeters) or 32FC1 (meters), raw, PNG or compressedDepth";
const MASK_SUPPORTED: &str = "masks must be mono8, 8UC1, mono16 or 16UC1, raw or PNG";

fn broken<T>(what: impl Into<String>) -> Result<T, ImageError> {
    Err(ImageError::Broken(what.into()))
}

fn refused<T>(encoding: &str, supported: &'static str) -> Result<T, ImageError> {
    Err(ImageError::Encoding { encoding: encoding.escape_debug().take(64).collect(), supported })
}

/// Color of a raw image.
///
/// # Errors
/// [`ImageError`].
pub fn raw_color(image: &Image) -> Result<Raster<[u8; 3]>, ImageError> {
    let (bytes, order): (usize, [usize; 3]) = match image.encoding.as_str() {
        "rgb8" | "8UC3" => (3, [0, 1, 2]),
        "bgr8" => (3, [2, 1, 0]),
        "rgba8" => (4, [0, 1, 2]),
        "bgra8" => (4, [2, 1, 0]),
        "mono8" | "8UC1" => (1, [0, 0, 0]),
        other => return refused(other, COLOR_SUPPORTED),
    };
    rows(image, bytes, |p| order.map(|k| p[k]))
}

/// Depth in meters of a raw image; 0 where unknown.
///
/// # Errors
/// [`ImageError`].
pub fn raw_depth(image: &Image) -> Result<Raster<f32>, ImageError> {
    let big = image.is_bigendian != 0;
    match image.encoding.as_str() {
        "16UC1" | "mono16" => rows(image, 2, |p| millimeters(word(p, big))),
        "32FC1" => rows(image, 4, |p| {
            let bytes = [p[0], p[1], p[2], p[3]];
            known(if big { f32::from_be_bytes(bytes) } else { f32::from_le_bytes(bytes) })
        }),
        other => refused(other, DEPTH_SUPPORTED),
    }
}

/// Mask of a raw image: nonzero is the object.
///
/// # Errors
/// [`ImageError`].
pub fn raw_mask(image: &Image) -> Result<Raster<bool>, ImageError> {
    match image.encoding.as_str() {
        "mono8" | "8UC1" => rows(image, 1, |p| p[0] != 0),
        "mono16" | "16UC1" => rows(image, 2, |p| p[0] != 0 || p[1] != 0),
        other => refused(other, MASK_SUPPORTED),
    }
}

/// Color of a compressed image.
///
/// # Errors
/// [`ImageError`].
pub fn compressed_color(image: &CompressedImage) -> Result<Raster<[u8; 3]>, ImageError> {
    color_file(&image.data)
}

/// Depth in meters of a compressed image: compressedDepth (PNG or RVL) or a 16-bit PNG in millimeters.
///
/// # Errors
/// [`ImageError`].
pub fn compressed_depth(image: &CompressedImage) -> Result<Raster<f32>, ImageError> {
    if !image.format.contains("compressedDepth") {
        return depth_file(&image.data, 0.001);
    }
    // compressed_depth_image_transport: a format number (unused), then A and B of the quantization.
    let Some((front, code)) = image.data.split_first_chunk::<12>() else {
        return broken("compressedDepth without its header");
    };
    let number = |at: usize| f32::from_le_bytes([front[at], front[at + 1], front[at + 2], front[at + 3]]);
    let a = number(4);
    let b = number(8);
    // Old publishers name no codec and use PNG.
    let words = if is_rvl(&image.format) { rvl_image(code)? } else { png16(code)? };
    let encoding = image.format.split(';').next().unwrap_or_default().trim();
    match encoding {
        // Millimeters, as REP 118 has it.
        "16UC1" | "mono16" | "" => Ok(words.map(millimeters)),
        // Inverse depth in 16 bits, 0 = unknown (compressed_depth_image_transport).
        "32FC1" if a.is_finite() && b.is_finite() && a > 0.0 => {
            Ok(words.map(|q| if q == 0 { 0.0 } else { known(a / (f32::from(q) - b)) }))
        }
        "32FC1" => broken("compressedDepth with invalid quantization"),
        other => refused(other, DEPTH_SUPPORTED),
    }
}

/// Mask of a compressed image.
///
/// # Errors
/// [`ImageError`]; JPEG is refused, as it blurs masks.
pub fn compressed_mask(image: &CompressedImage) -> Result<Raster<bool>, ImageError> {
    mask_file(&image.data)
}

/// Color of a JPEG or PNG file with 8 bits a channel; a transparency is ignored.
///
/// # Errors
/// [`ImageError`].
pub fn color_file(data: &[u8]) -> Result<Raster<[u8; 3]>, ImageError> {
    match decode_file(data, true)? {
        DynamicImage::ImageRgb16(_) | DynamicImage::ImageRgba16(_) => {
            refused("16-bit RGB PNG", COLOR_SUPPORTED)
        }
        DynamicImage::ImageLuma16(_) | DynamicImage::ImageLumaA16(_) => {
            refused("16-bit gray PNG", COLOR_SUPPORTED)
        }
        decoded => {
            let rgb = decoded.into_rgb8();
            let width = rgb.width() as usize;
            let height = rgb.height() as usize;
            Ok(Raster { width, height, pixels: rgb.as_raw().as_chunks().0.to_vec() })
        }
    }
}

/// Color and mask of an RGBA PNG file; the mask is where alpha is at least one half. Without alpha there is
/// no mask.
///
/// # Errors
/// [`ImageError`].
pub fn color_with_alpha_file(data: &[u8]) -> Result<(Raster<[u8; 3]>, Option<Mask>), ImageError> {
    let decoded = decode_file(data, false)?;
    let alpha =
        decoded.color().has_alpha().then(|| decoded.to_rgba8().pixels().map(|p| p.0[3] >= 128).collect());
    Ok((color_file(data)?, alpha))
}

/// Depth in meters of a 16-bit PNG file with the given unit in meters; 0 where unknown.
///
/// # Errors
/// [`ImageError`].
pub fn depth_file(data: &[u8], unit_m: f32) -> Result<Raster<f32>, ImageError> {
    Ok(png16(data)?.map(|q| f32::from(q) * unit_m))
}

/// Mask of a PNG file: nonzero (in the first channel) is the object.
///
/// # Errors
/// [`ImageError`].
pub fn mask_file(data: &[u8]) -> Result<Raster<bool>, ImageError> {
    let decoded = decode_file(data, false)?;
    let width = decoded.width() as usize;
    let height = decoded.height() as usize;
    let pixels = match &decoded {
        DynamicImage::ImageLuma8(i) => i.pixels().map(|p| p.0[0] > 0).collect(),
        DynamicImage::ImageLuma16(i) => i.pixels().map(|p| p.0[0] > 0).collect(),
        other => other.to_rgb16().pixels().map(|p| p.0[0] > 0).collect(),
    };
    Ok(Raster { width, height, pixels })
}

impl<T: Copy> Raster<T> {
    fn map<U>(self, f: impl FnMut(T) -> U) -> Raster<U> {
        Raster { width: self.width, height: self.height, pixels: self.pixels.into_iter().map(f).collect() }
    }

    /// The image at another size, each pixel taken from the nearest one.
    #[must_use]
    pub fn resized_nearest(&self, width: usize, height: usize) -> Self {
        // Pixel centers are integers: center (u + 0.5) scales.
        let source = |i: usize, from: usize, to: usize| ((2 * i + 1) * from / (2 * to)).min(from - 1);
        let mut pixels = Vec::with_capacity(width * height);
        for y in 0..height {
            let row = source(y, self.height, height) * self.width;
            pixels.extend((0..width).map(|x| self.pixels[row + source(x, self.width, width)]));
        }
        Self { width, height, pixels }
    }
}

fn millimeters(value: u16) -> f32 {
    f32::from(value) * 0.001
}

/// The depth, or 0 if it is not a valid distance.
fn known(depth_m: f32) -> f32 {
    if depth_m.is_finite() && depth_m > 0.0 { depth_m } else { 0.0 }
}

fn word(p: &[u8], big: bool) -> u16 {
    if big { u16::from_be_bytes([p[0], p[1]]) } else { u16::from_le_bytes([p[0], p[1]]) }
}

fn rows<T>(image: &Image, bytes: usize, mut pixel: impl FnMut(&[u8]) -> T) -> Result<Raster<T>, ImageError> {
    // `step` may exceed the bytes of the pixels, as drivers pad rows. CDR only knows the length of `data`:
    // whether it fits the image is checked here.
    let width = image.width as usize;
    let height = image.height as usize;
    let step = image.step as usize;
    check_size(width, height)?;
    if step < width * bytes {
        return broken(format!("a row of {step} bytes cannot hold {width} pixels of {bytes} bytes"));
    }
    if image.data.len() != step * height {
        return broken(format!("{} bytes instead of {height} rows of {step}", image.data.len()));
    }
    let row = image.data.chunks_exact(step).flat_map(|row| row[..width * bytes].chunks_exact(bytes));
    Ok(Raster { width, height, pixels: row.map(&mut pixel).collect() })
}

fn check_size(width: usize, height: usize) -> Result<(), ImageError> {
    if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
        return broken(format!("an image of {width}x{height} pixels (1 to {MAX_SIDE} are taken)"));
    }
    Ok(())
}

/// Width and height stated in a compressed image before decoding; `None` without them.
#[must_use]
pub fn compressed_size(image: &CompressedImage) -> Option<(usize, usize)> {
    if !image.format.contains("compressedDepth") {
        return stated_size(&image.data);
    }
    let code = image.data.get(12..)?;
    if !is_rvl(&image.format) {
        return stated_size(code);
    }
    let number = |at: usize| Some(u32::from_le_bytes(*code.get(at..)?.first_chunk()?) as usize);
    Some((number(0)?, number(4)?))
}

fn is_rvl(format: &str) -> bool {
    format.trim_end().ends_with("rvl")
}

/// Decodes a PNG or, where allowed, JPEG file, distinguished by their first bytes.
fn decode_file(data: &[u8], jpeg_allowed: bool) -> Result<DynamicImage, ImageError> {
    // By the first bytes: the format of a message is free text.
    let format = match data {
        [0xff, 0xd8, 0xff, ..] if jpeg_allowed => ImageFormat::Jpeg,
        [0xff, 0xd8, 0xff, ..] => return refused("JPEG", "depth and masks need PNG, as JPEG blurs them"),
        [0x89, b'P', b'N', b'G', ..] => ImageFormat::Png,
        _ => return broken("neither JPEG nor PNG by its first bytes"),
    };
    // Checked before decoding: a few bytes can state an image of gigabytes.
    if let Some((width, height)) = stated_size(data) {
        check_size(width, height)?;
    }
    // Without extra chunks: a decoder would also unpack profiles and texts of any content.
    let bare = if format == ImageFormat::Png { Cow::Owned(bare_png(data)) } else { Cow::Borrowed(data) };
    let mut reader = ImageReader::with_format(std::io::Cursor::new(bare), format);
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(MAX_SIDE as u32), Some(MAX_SIDE as u32));
    reader.limits(limits);
    let decoded = reader.decode().map_err(|e| ImageError::Broken(format!("{format:?}: {e}")))?;
    check_size(decoded.width() as usize, decoded.height() as usize)?;
    Ok(decoded)
}

fn png16(data: &[u8]) -> Result<Raster<u16>, ImageError> {
    match decode_file(data, false)? {
        DynamicImage::ImageLuma16(i) => {
            Ok(Raster { width: i.width() as usize, height: i.height() as usize, pixels: i.into_raw() })
        }
        other => refused(&format!("{:?} PNG", other.color()), DEPTH_SUPPORTED),
    }
}

/// RVL of compressedDepth: columns, rows, code.
fn rvl_image(data: &[u8]) -> Result<Raster<u16>, ImageError> {
    let Some((size, code)) = data.split_first_chunk::<8>() else { return broken("RVL without its size") };
    let number =
        |at: usize| u32::from_le_bytes([size[at], size[at + 1], size[at + 2], size[at + 3]]) as usize;
    let width = number(0);
    let height = number(4);
    check_size(width, height)?;
    match rvl::decode(code, width * height) {
        Ok(pixels) => Ok(Raster { width, height, pixels }),
        Err(why) => broken(format!("RVL: {why}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw(encoding: &str, width: u32, height: u32, step: u32, data: &[u8]) -> Image {
        Image { encoding: encoding.into(), width, height, step, data: data.to_vec(), ..Image::default() }
    }

    fn png(image: DynamicImage) -> Vec<u8> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write_to(&mut bytes, ImageFormat::Png).unwrap();
        bytes.into_inner()
    }

    fn depth_png(values: &[u16]) -> Vec<u8> {
        png(DynamicImage::ImageLuma16(
            image::ImageBuffer::from_raw(values.len() as u32, 1, values.to_vec()).unwrap(),
        ))
    }

    fn depth_message(format: &str, a: f32, b: f32, code: &[u8]) -> CompressedImage {
        let data = [&[0; 4], &a.to_le_bytes(), &b.to_le_bytes(), code].concat();
        CompressedImage { format: format.into(), data, ..CompressedImage::default() }
    }

    #[test]
    fn channels_come_out_as_rgb_and_padding_is_skipped() {
        let check = |encoding, step, data: &[u8]| {
            assert_eq!(raw_color(&raw(encoding, 1, 2, step, data)).unwrap().pixels, [[1, 2, 3], [4, 5, 6]])
        };
        check("rgb8", 3, &[1, 2, 3, 4, 5, 6]);
        check("rgb8", 5, &[1, 2, 3, 9, 9, 4, 5, 6, 9, 9]);
        check("bgr8", 3, &[3, 2, 1, 6, 5, 4]);
        check("rgba8", 4, &[1, 2, 3, 0, 4, 5, 6, 0]);
        check("bgra8", 4, &[3, 2, 1, 0, 6, 5, 4, 0]);
        assert_eq!(raw_color(&raw("mono8", 1, 1, 1, &[7])).unwrap().pixels, [[7, 7, 7]]);
    }

    #[test]
    fn sixteen_bit_color_is_refused_by_name() {
        for name in ["rgb16", "bgr16", "yuv422_yuy2"] {
            let error = raw_color(&raw(name, 1, 1, 6, &[0; 6])).unwrap_err();
            assert!(
                matches!(&error, ImageError::Encoding { .. }) && error.to_string().contains(name),
                "{error}"
            );
        }
        let wide = png(DynamicImage::new_rgb16(2, 2));
        assert!(color_file(&wide).unwrap_err().to_string().contains("16-bit RGB"));
    }

    #[test]
    fn wrong_sizes_are_refused() {
        for image in [
            raw("rgb8", 2, 1, 3, &[0; 3]),
            raw("rgb8", 1, 2, 3, &[0; 5]),
            raw("rgb8", 0, 2, 3, &[]),
            raw("rgb8", 9000, 1, 27000, &[0; 27000]),
        ] {
            assert!(
                matches!(raw_color(&image), Err(ImageError::Broken(_))),
                "{}x{}",
                image.width,
                image.height
            );
        }
    }

    #[test]
    fn depth_is_in_meters_whatever_the_byte_order() {
        let mut image = raw("16UC1", 2, 1, 4, &[0xe8, 0x03, 0, 0]);
        assert_eq!(raw_depth(&image).unwrap().pixels, [1.0, 0.0]);
        image.data = vec![0x03, 0xe8, 0, 0];
        image.is_bigendian = 1;
        assert_eq!(raw_depth(&image).unwrap().pixels, [1.0, 0.0]);
        let floats: Vec<u8> =
            [1.5f32, f32::NAN, f32::INFINITY, -1.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(raw_depth(&raw("32FC1", 4, 1, 16, &floats)).unwrap().pixels, [1.5, 0.0, 0.0, 0.0]);
        assert!(raw_depth(&raw("rgb8", 1, 1, 3, &[0; 3])).unwrap_err().to_string().contains("`rgb8`"));
    }

    #[test]
    fn compressed_depth_as_png_and_rvl() {
        let values = [0u16, 1000, 1001, 65535];
        let expected = [0.0, 1.0, 1.001, 65.535f32];
        let close = |r: Raster<f32>| r.pixels.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5);
        let code = depth_png(&values);
        for format in ["16UC1; compressedDepth png", "16UC1; compressedDepth"] {
            assert!(close(compressed_depth(&depth_message(format, 0.0, 0.0, &code)).unwrap()));
        }
        let code = [&4u32.to_le_bytes()[..], &1u32.to_le_bytes(), &rvl::encode(&values)].concat();
        assert!(close(
            compressed_depth(&depth_message("16UC1; compressedDepth rvl", 0.0, 0.0, &code)).unwrap()
        ));
        let plain = CompressedImage {
            format: "16UC1; png compressed ".into(),
            data: depth_png(&values),
            ..CompressedImage::default()
        };
        assert!(close(compressed_depth(&plain).unwrap()));
    }

    #[test]
    fn quantized_float_depth_follows_its_formula() {
        // depth = a / (q - b)
        let message =
            depth_message("32FC1; compressedDepth png", 1000.0, -500.0, &depth_png(&[0, 500, 1500]));
        assert_eq!(compressed_depth(&message).unwrap().pixels, [0.0, 1.0, 0.5]);
    }

    #[test]
    fn broken_compressed_depth_is_an_error() {
        for (format, data) in [
            ("16UC1; compressedDepth png", &[0u8; 11][..]),
            ("16UC1; compressedDepth rvl", &[0; 16]),
            ("16UC1; compressedDepth png", &[0; 40]),
        ] {
            let message =
                CompressedImage { format: format.into(), data: data.to_vec(), ..CompressedImage::default() };
            assert!(matches!(compressed_depth(&message), Err(ImageError::Broken(_))));
        }
        let huge = [&8000u32.to_le_bytes()[..], &9000u32.to_le_bytes(), &[0; 8]].concat();
        assert!(matches!(
            compressed_depth(&depth_message("16UC1; compressedDepth rvl", 0.0, 0.0, &huge)),
            Err(ImageError::Broken(_))
        ));
    }

    #[test]
    fn masks_and_alpha() {
        assert_eq!(raw_mask(&raw("mono8", 3, 1, 3, &[0, 1, 255])).unwrap().pixels, [false, true, true]);
        assert_eq!(raw_mask(&raw("mono16", 2, 1, 4, &[0, 0, 0, 1])).unwrap().pixels, [false, true]);
        let rgba = image::RgbaImage::from_raw(2, 1, vec![1, 2, 3, 255, 4, 5, 6, 0]).unwrap();
        let (color, alpha) = color_with_alpha_file(&png(DynamicImage::ImageRgba8(rgba))).unwrap();
        assert_eq!((color.pixels, alpha), (vec![[1, 2, 3], [4, 5, 6]], Some(vec![true, false])));
        assert!(mask_file(&[0xff, 0xd8, 0xff, 0]).unwrap_err().to_string().contains("JPEG"));
    }

    #[test]
    fn nearest_resizing_keeps_values() {
        let small = Raster { width: 2, height: 1, pixels: vec![1u8, 2] };
        assert_eq!(small.resized_nearest(4, 2).pixels, [1, 1, 2, 2, 1, 1, 2, 2]);
        assert_eq!(small.resized_nearest(4, 2).resized_nearest(2, 1), small);
    }
}
