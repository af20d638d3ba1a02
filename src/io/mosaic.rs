//! Color of raw images that hold no red, green and blue for every pixel: YUV with fewer colors than
//! brightnesses, and Bayer mosaics. Names and layouts are those of `sensor_msgs/image_encodings.hpp`.

use super::{
    image_codec::{ImageError, Raster, broken, check_size, row_step},
    ros2msg::Image,
};

/// Where a YUV layout keeps the values of a pixel.
#[derive(Clone, Copy)]
enum Layout {
    /// Pairs of pixels in four bytes: positions of the first brightness, of U and of V among them.
    Packed([usize; 3]),
    /// All brightnesses, then pairs of U and V for squares of this many pixels a side; positions of U and V.
    Planes { side: usize, order: [usize; 2] },
}

/// Color of a YUV image by the lower-case name of its encoding; `None` for other encodings.
pub fn yuv_color(image: &Image, name: &str) -> Option<Result<Raster<[u8; 3]>, ImageError>> {
    let layout = match name {
        "yuv422" | "uyvy" => Layout::Packed([1, 0, 2]),
        "yuv422_yuy2" | "yuyv" | "yuy2" => Layout::Packed([0, 1, 3]),
        "nv12" => Layout::Planes { side: 2, order: [0, 1] },
        "nv21" => Layout::Planes { side: 2, order: [1, 0] },
        "nv24" => Layout::Planes { side: 1, order: [0, 1] },
        _ => return None,
    };
    Some(match layout {
        Layout::Packed(places) => packed_color(image, places),
        Layout::Planes { side, order } => planar_color(image, side, order),
    })
}

fn packed_color(image: &Image, [y, u, v]: [usize; 3]) -> Result<Raster<[u8; 3]>, ImageError> {
    let [width, height] = checked_size(image, [2, 1])?;
    let step = row_step(image, 2 * width, height)?;
    let mut pixels = Vec::with_capacity(width * height);
    for row in image.data.chunks_exact(step) {
        for pair in row[..2 * width].chunks_exact(4) {
            pixels.push(rgb_of_yuv(pair[y], pair[u], pair[v]));
            pixels.push(rgb_of_yuv(pair[y + 2], pair[u], pair[v]));
        }
    }
    Ok(Raster { width, height, pixels })
}

fn planar_color(image: &Image, side: usize, [u, v]: [usize; 2]) -> Result<Raster<[u8; 3]>, ImageError> {
    let [width, height] = checked_size(image, [side, side])?;
    // NV24 has a row of colors, of two bytes a pixel, for each row of brightnesses.
    let color_rows = height * 2 / (side * side);
    let step = row_step(image, width, height + color_rows)?;
    let colors = &image.data[height * step..];
    let color_step = 2 * step / side;
    let mut pixels = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let at = (y / side) * color_step + 2 * (x / side);
            pixels.push(rgb_of_yuv(image.data[y * step + x], colors[at + u], colors[at + v]));
        }
    }
    Ok(Raster { width, height, pixels })
}

/// Red, green and blue of full-range values, as JPEG has them (ITU-T T.871).
fn rgb_of_yuv(y: u8, u: u8, v: u8) -> [u8; 3] {
    let y = f32::from(y);
    let blue = f32::from(u) - 128.0;
    let red = f32::from(v) - 128.0;
    // A cast saturates.
    [y + 1.402 * red, y - 0.344_136 * blue - 0.714_136 * red, y + 1.772 * blue].map(|c| c.round() as u8)
}

/// Color of a Bayer mosaic by the lower-case name of its encoding; `None` for other encodings. A missing
/// channel of a pixel is the mean of its neighbors that have it (bilinear demosaicing).
pub fn bayer_color(image: &Image, name: &str) -> Option<Result<Raster<[u8; 3]>, ImageError>> {
    // Channels of the first two pixels of the first two rows.
    let (pattern, bits) = name.strip_prefix("bayer_")?.split_at_checked(4)?;
    let channels: [[usize; 2]; 2] = match pattern {
        "rggb" => [[0, 1], [1, 2]],
        "bggr" => [[2, 1], [1, 0]],
        "gbrg" => [[1, 2], [0, 1]],
        "grbg" => [[1, 0], [2, 1]],
        _ => return None,
    };
    match bits {
        "8" => Some(demosaiced(image, channels, 1)),
        "16" => Some(demosaiced(image, channels, 2)),
        _ => None,
    }
}

fn demosaiced(image: &Image, channels: [[usize; 2]; 2], bytes: usize) -> Result<Raster<[u8; 3]>, ImageError> {
    let [width, height] = checked_size(image, [2, 2])?;
    let step = row_step(image, bytes * width, height)?;
    // The upper byte of 16 bits.
    let upper = if image.is_bigendian == 0 { bytes - 1 } else { 0 };
    let value = |x: usize, y: usize| u32::from(image.data[y * step + bytes * x + upper]);
    let mut pixels = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let mut sums = [0u32; 3];
            let mut counts = [0u32; 3];
            for row in y.saturating_sub(1)..(y + 2).min(height) {
                for column in x.saturating_sub(1)..(x + 2).min(width) {
                    let channel = channels[row % 2][column % 2];
                    sums[channel] += value(column, row);
                    counts[channel] += 1;
                }
            }
            let mut pixel = [0, 1, 2].map(|c| ((sums[c] + counts[c] / 2) / counts[c].max(1)) as u8);
            pixel[channels[y % 2][x % 2]] = value(x, y) as u8;
            pixels.push(pixel);
        }
    }
    Ok(Raster { width, height, pixels })
}

/// Width and height, which must be multiples of the given numbers.
fn checked_size(image: &Image, multiples: [usize; 2]) -> Result<[usize; 2], ImageError> {
    let width = image.width as usize;
    let height = image.height as usize;
    check_size(width, height)?;
    if !width.is_multiple_of(multiples[0]) || !height.is_multiple_of(multiples[1]) {
        return broken(format!(
            "{width}x{height} pixels are no multiple of the colors of {}",
            image.encoding
        ));
    }
    Ok([width, height])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image of 4x4 pixels of one color.
    fn image(encoding: &str, data: Vec<u8>) -> Image {
        let step = (data.len() / 4) as u32;
        Image { encoding: encoding.into(), width: 4, height: 4, step, data, ..Image::default() }
    }

    /// Y, U and V of an orange.
    const ORANGE: [u8; 3] = [149, 66, 187];

    fn is_orange(found: Raster<[u8; 3]>) -> bool {
        let near = |p: &[u8; 3]| p.iter().zip([232, 128, 39]).all(|(a, b)| a.abs_diff(b) <= 2);
        found.pixels.len() == 16 && found.pixels.iter().all(near)
    }

    #[test]
    fn all_layouts_of_yuv_give_one_color() {
        let [y, u, v] = ORANGE;
        let decoded = |name: &str, data: Vec<u8>| yuv_color(&image(name, data), name).unwrap().unwrap();
        assert!(is_orange(decoded("yuv422", [u, y, v, y].repeat(8))));
        assert!(is_orange(decoded("yuv422_yuy2", [y, u, y, v].repeat(8))));
        let planes = |colors: Vec<u8>| Image { step: 4, ..image("nv12", [vec![y; 16], colors].concat()) };
        let found = |name: &str, colors| yuv_color(&planes(colors), name).unwrap().unwrap();
        assert!(is_orange(found("nv12", [u, v].repeat(4))));
        assert!(is_orange(found("nv21", [v, u].repeat(4))));
        assert!(is_orange(found("nv24", [u, v].repeat(16))));
        assert!(yuv_color(&image("nv12", vec![0; 16]), "nv12").unwrap().is_err());
        assert!(yuv_color(&image("rgb8", vec![0; 48]), "rgb8").is_none());
    }

    #[test]
    fn a_mosaic_of_one_color_is_that_color_everywhere() {
        let color = [200u8, 100, 50];
        for (name, channels) in [
            ("bayer_rggb8", [[0, 1], [1, 2]]),
            ("bayer_bggr8", [[2, 1], [1, 0]]),
            ("bayer_gbrg8", [[1, 2], [0, 1]]),
            ("bayer_grbg16", [[1, 0], [2, 1]]),
        ] {
            let mut data = Vec::new();
            for at in 0..16 {
                let value = color[channels[(at / 4) % 2][at % 2]];
                if name.ends_with("16") {
                    data.push(7);
                }
                data.push(value);
            }
            let found = bayer_color(&image(name, data), name).unwrap().unwrap();
            assert_eq!(found.pixels, [color; 16], "{name}");
        }
        assert!(bayer_color(&image("bayer_xxxx8", vec![0; 16]), "bayer_xxxx8").is_none());
    }
}
