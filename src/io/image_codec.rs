//! Decodes image messages and image files: color to 8-bit RGB, depth to meters, masks to booleans.
//!
//! Sizes, steps and encodings are checked here; nothing is read beyond the message's data.

use std::borrow::Cow;

use image::{DynamicImage, ImageFormat, ImageReader, Limits};

use super::{
    mosaic::{bayer_color, yuv_color},
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

const COLOR_SUPPORTED: &str = "color must be rgb8, bgr8, rgba8, bgra8, mono8 or these with 16 bits, 8UC1, \
    8UC3 or 8UC4 (in OpenCV's order), yuv422, yuv422_yuy2, nv12, nv21, nv24 or Bayer, or JPEG, PNG or \
    WebP; set the camera to rgb8";
const DEPTH_SUPPORTED: &str = "depth must be 16UC1, 16SC1 or mono16 (whole units) or 32FC1 or 64FC1 \
    (meters), raw, PNG or compressedDepth";
/// Encodings of masks, in lower case.
pub const MASK_ENCODINGS: [&str; 4] = ["mono8", "8uc1", "mono16", "16uc1"];
const MASK_SUPPORTED: &str = "masks must be mono8, 8UC1, mono16 or 16UC1, raw or PNG";

pub(super) fn broken<T>(what: impl Into<String>) -> Result<T, ImageError> {
    Err(ImageError::Broken(what.into()))
}

fn refused<T>(encoding: &str, supported: &'static str) -> Result<T, ImageError> {
    Err(ImageError::Encoding { encoding: encoding.escape_debug().take(64).collect(), supported })
}

/// Color of a raw image. Names of encodings are those of `sensor_msgs/image_encodings.hpp`, in either case.
///
/// # Errors
/// [`ImageError`].
pub fn raw_color(image: &Image) -> Result<Raster<[u8; 3]>, ImageError> {
    let name = image.encoding.to_ascii_lowercase();
    if let Some(found) = yuv_color(image, &name).or_else(|| bayer_color(image, &name)) {
        return found;
    }
    // Bytes of a pixel and of a channel, and the channels of red, green and blue. `8UC3` is what cv_bridge
    // gives a matrix of OpenCV, whose channels are blue, green and red.
    let (bytes, channel, order): (usize, usize, [usize; 3]) = match name.as_str() {
        "rgb8" => (3, 1, [0, 1, 2]),
        "bgr8" | "8uc3" => (3, 1, [2, 1, 0]),
        "rgba8" => (4, 1, [0, 1, 2]),
        "bgra8" | "8uc4" => (4, 1, [2, 1, 0]),
        "mono8" | "8uc1" => (1, 1, [0, 0, 0]),
        "rgb16" => (6, 2, [0, 1, 2]),
        "bgr16" | "16uc3" => (6, 2, [2, 1, 0]),
        "rgba16" => (8, 2, [0, 1, 2]),
        "bgra16" | "16uc4" => (8, 2, [2, 1, 0]),
        "mono16" => (2, 2, [0, 0, 0]),
        _ => return refused(&image.encoding, COLOR_SUPPORTED),
    };
    // The upper byte of a channel: the last one, unless big-endian.
    let upper = if image.is_bigendian == 0 { channel - 1 } else { 0 };
    rows(image, bytes, |p| order.map(|k| p[k * channel + upper]))
}

/// Whether an encoding leaves the order of its channels to OpenCV's convention.
#[must_use]
pub fn has_opencv_order(encoding: &str) -> bool {
    matches!(encoding.to_ascii_uppercase().as_str(), "8UC3" | "8UC4" | "16UC3" | "16UC4")
}

/// Depth in meters of a raw image, whole numbers taken as millimeters; 0 where unknown.
///
/// # Errors
/// [`ImageError`].
pub fn raw_depth(image: &Image) -> Result<Raster<f32>, ImageError> {
    let big = image.is_bigendian != 0;
    match image.encoding.to_ascii_lowercase().as_str() {
        "16uc1" | "mono16" => rows(image, 2, |p| millimeters(word(p, big))),
        // Negative readings are no distances.
        "16sc1" => rows(image, 2, |p| millimeters(u16::try_from(word(p, big) as i16).unwrap_or(0))),
        "32fc1" => rows(image, 4, |p| {
            let bytes = [p[0], p[1], p[2], p[3]];
            known(if big { f32::from_be_bytes(bytes) } else { f32::from_le_bytes(bytes) })
        }),
        "64fc1" => rows(image, 8, |p| {
            let bytes = [p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]];
            known(if big { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) } as f32)
        }),
        _ => refused(&image.encoding, DEPTH_SUPPORTED),
    }
}

/// Whether an encoding or format of depth counts whole units, whose length the message does not give.
#[must_use]
pub fn counts_units(encoding: &str) -> bool {
    !encoding.to_ascii_lowercase().trim_start().starts_with(['3', '6'])
}

/// Mask of a raw image: nonzero is the object.
///
/// # Errors
/// [`ImageError`].
pub fn raw_mask(image: &Image) -> Result<Raster<bool>, ImageError> {
    match image.encoding.to_ascii_lowercase().as_str() {
        "mono8" | "8uc1" => rows(image, 1, |p| p[0] != 0),
        "mono16" | "16uc1" => rows(image, 2, |p| p[0] != 0 || p[1] != 0),
        _ => refused(&image.encoding, MASK_SUPPORTED),
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

/// Color of a JPEG, PNG or WebP file; a transparency is ignored.
///
/// # Errors
/// [`ImageError`].
pub fn color_file(data: &[u8]) -> Result<Raster<[u8; 3]>, ImageError> {
    let rgb = decode_file(data, true)?.into_rgb8();
    let width = rgb.width() as usize;
    let height = rgb.height() as usize;
    Ok(Raster { width, height, pixels: rgb.as_raw().as_chunks().0.to_vec() })
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
    let width = image.width as usize;
    let height = image.height as usize;
    check_size(width, height)?;
    let step = row_step(image, width * bytes, height)?;
    let row = image.data.chunks_exact(step).flat_map(|row| row[..width * bytes].chunks_exact(bytes));
    Ok(Raster { width, height, pixels: row.map(&mut pixel).collect() })
}

/// Bytes from one of `count` rows to the next. `step` may exceed the bytes of a row, as drivers pad rows;
/// some publishers leave it 0, or give the bytes of a pixel. CDR only knows the length of `data`: whether
/// it fits the image is checked here.
pub(super) fn row_step(image: &Image, row_bytes: usize, count: usize) -> Result<usize, ImageError> {
    let step = image.step as usize;
    if image.data.len() == row_bytes * count && step < row_bytes {
        return Ok(row_bytes);
    }
    if step < row_bytes {
        return broken(format!("a row of {step} bytes cannot hold {row_bytes} bytes of pixels"));
    }
    if image.data.len() != step * count {
        return broken(format!("{} bytes instead of {count} rows of {step}", image.data.len()));
    }
    Ok(step)
}

pub(super) fn check_size(width: usize, height: usize) -> Result<(), ImageError> {
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

/// Decodes a file by its first bytes: PNG or, where allowed, JPEG or WebP.
fn decode_file(data: &[u8], lossy_allowed: bool) -> Result<DynamicImage, ImageError> {
    // By the first bytes: the format of a message is free text.
    let format = match data {
        [0xff, 0xd8, 0xff, ..] => ImageFormat::Jpeg,
        [0x89, b'P', b'N', b'G', ..] => ImageFormat::Png,
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => ImageFormat::WebP,
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => return refused("TIFF", COLOR_SUPPORTED),
        _ => return broken("neither JPEG, PNG nor WebP by its first bytes"),
    };
    if !lossy_allowed && matches!(format, ImageFormat::Jpeg | ImageFormat::WebP) {
        let name = if format == ImageFormat::Jpeg { "JPEG" } else { "WebP" };
        return refused(name, "depth and masks need PNG, as JPEG blurs them");
    }
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
#[path = "image_codec_tests.rs"]
mod tests;
