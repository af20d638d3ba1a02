//! Depth images of folders as messages.

use std::path::Path;

use super::{COMPRESSED, encoded};
use crate::{
    dataset::files::{image_error, read, read_start, refuse},
    image_codec::{depth_file, mask_file},
    picture_size::stated_size,
    ros2msg::{CompressedImage, Header, Image},
};
use capture::CaptureError;

/// A message of depth in 16 bits, in units of its folder.
pub(super) struct DepthMessage {
    pub type_name: &'static str,
    pub data: Vec<u8>,
}

/// Columns and rows of a depth image.
pub(super) fn size(path: &Path) -> Result<(usize, usize), CaptureError> {
    let start = read_start(path)?;
    match stated_size(&start) {
        Some(size) if start.starts_with(b"\x89PNG") => Ok(size),
        _ => refuse(
            path,
            "depth must be a 16-bit PNG; docs/folders.md has the commands that make one of EXR and LZFSE",
        ),
    }
}

/// A depth image as a message; readings without confidence are left out.
pub(super) fn depth_message(
    header: Header,
    path: &Path,
    confidence: Option<&Path>,
) -> Result<DepthMessage, CaptureError> {
    let data = read(path)?;
    let Some(confidence) = confidence else { return compressed(header, &data) };
    let depth = depth_file(&data, 1.0).map_err(|e| image_error(path, e))?;
    // ARKit: 0 low, 1 medium, 2 high. Low is dropped, as the viewers of these apps do.
    let trusted = mask_file(&read(confidence)?).map_err(|e| image_error(confidence, e))?;
    let trusted = trusted.resized_nearest(depth.width, depth.height);
    let words = depth.pixels.iter().zip(&trusted.pixels).map(|(d, t)| if *t { *d as u16 } else { 0 });
    raw(header, (depth.width, depth.height), words.flat_map(u16::to_le_bytes).collect())
}

/// The same message without the pixels.
pub(super) fn depth_start(
    header: Header,
    path: &Path,
    confidence: Option<&Path>,
) -> Result<DepthMessage, CaptureError> {
    match confidence {
        Some(_) => raw(header, size(path)?, Vec::new()),
        None => compressed(header, &read_start(path)?),
    }
}

/// compressedDepth: 12 bytes of quantization, unused for 16UC1, then the PNG.
fn compressed(header: Header, png: &[u8]) -> Result<DepthMessage, CaptureError> {
    let data = [&[0; 12], png].concat();
    let image = CompressedImage { header, format: "16UC1; compressedDepth png".into(), data };
    Ok(DepthMessage { type_name: COMPRESSED, data: encoded(&image)? })
}

fn raw(header: Header, (width, height): (usize, usize), data: Vec<u8>) -> Result<DepthMessage, CaptureError> {
    let image = Image {
        header,
        height: height as u32,
        width: width as u32,
        encoding: "16UC1".into(),
        is_bigendian: 0,
        step: 2 * width as u32,
        data,
    };
    Ok(DepthMessage { type_name: "sensor_msgs/msg/Image", data: encoded(&image)? })
}
