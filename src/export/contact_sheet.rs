//! One picture of a recording: the object in some views of each state, and the directions of all views.

use std::f64::consts::TAU;

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use capture::{Capture, Coverage, RgbdFrame, SECTORS};

/// Number of views shown of each state.
const VIEWS: usize = 3;
/// Size of a view, and side of the disc, pixels.
const VIEW: [usize; 2] = [320, 240];
/// Space between pictures, pixels.
const GAP: usize = 6;
const BACKGROUND: [u8; 3] = [255; 3];
const SEEN: [u8; 3] = [210, 232, 214];
const UNSEEN: [u8; 3] = [244, 214, 208];
const LINE: [u8; 3] = [120; 3];
const EYE: [u8; 3] = [20, 60, 160];

/// A PNG with a row for each state: some of its views, with the object bright, and a disc of the directions
/// of all views. The disc is seen from above with the front at the bottom; its rim is the horizon and its
/// center the zenith; directions without a view are red.
pub fn contact_sheet(capture: &Capture, coverage: &[Option<Coverage>]) -> Vec<u8> {
    let width = VIEWS * (VIEW[0] + GAP) + VIEW[1] + 2 * GAP;
    let height = capture.states.len() * (VIEW[1] + GAP) + GAP;
    let mut sheet = Sheet { width, height, rgb: vec![BACKGROUND; width * height] };
    for (state, (frames, coverage)) in capture.states.iter().zip(coverage).enumerate() {
        let top = GAP + state * (VIEW[1] + GAP);
        for (k, frame) in spread_views(frames).into_iter().enumerate() {
            sheet.draw_rectangle([GAP + k * (VIEW[0] + GAP), top], VIEW, |at| photo_pixel(frame, at));
        }
        if let Some(coverage) = coverage {
            let left = GAP + VIEWS * (VIEW[0] + GAP);
            sheet.draw_rectangle([left, top], [VIEW[1], VIEW[1]], |at| disc_pixel(coverage, at));
        }
    }
    sheet.png_bytes()
}

struct Sheet {
    width: usize,
    height: usize,
    rgb: Vec<[u8; 3]>,
}

impl Sheet {
    /// Draws a rectangle, `pixel` by pixel.
    fn draw_rectangle(
        &mut self,
        [x, y]: [usize; 2],
        [width, height]: [usize; 2],
        pixel: impl Fn([usize; 2]) -> [u8; 3],
    ) {
        for v in 0..height {
            for u in 0..width {
                self.rgb[(y + v) * self.width + x + u] = pixel([u, v]);
            }
        }
    }

    fn png_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        // Writing to memory fails only if size and pixels disagree.
        PngEncoder::new(&mut bytes)
            .write_image(
                self.rgb.as_flattened(),
                self.width as u32,
                self.height as u32,
                ExtendedColorType::Rgb8,
            )
            .ok();
        bytes
    }
}

/// One view each from the first, the middle and the last part of a state.
fn spread_views(frames: &[RgbdFrame]) -> Vec<&RgbdFrame> {
    let mut numbers: Vec<usize> = (0..VIEWS).map(|k| (2 * k + 1) * frames.len() / (2 * VIEWS)).collect();
    numbers.retain(|i| *i < frames.len());
    numbers.dedup();
    numbers.into_iter().map(|i| &frames[i]).collect()
}

/// A pixel of a view scaled to fit; dark gray around the photo.
fn photo_pixel(frame: &RgbdFrame, [u, v]: [usize; 2]) -> [u8; 3] {
    let width = frame.intrinsics.width;
    let height = frame.intrinsics.height;
    let scale = (width as f64 / VIEW[0] as f64).max(height as f64 / VIEW[1] as f64);
    let Some(x) = photo_coordinate(u, VIEW[0], width, scale) else { return BACKGROUND };
    let Some(y) = photo_coordinate(v, VIEW[1], height, scale) else { return BACKGROUND };
    let color = frame.rgb[y * width + x];
    if frame.is_object(y * width + x) {
        return color;
    }
    let gray = color.iter().map(|c| usize::from(*c)).sum::<usize>() / 3;
    [(gray / 4 + 30) as u8; 3]
}

/// Column or row of a photo of `size` pixels at pixel `at` of a view of `shown` pixels; `None` beside the
/// photo.
fn photo_coordinate(at: usize, shown: usize, size: usize, scale: f64) -> Option<usize> {
    let x = (at as f64 + 0.5 - 0.5 * shown as f64) * scale + 0.5 * size as f64;
    (x >= 0.0 && x < size as f64).then_some(x as usize)
}

/// A pixel of the disc of directions.
fn disc_pixel(coverage: &Coverage, [u, v]: [usize; 2]) -> [u8; 3] {
    let radius = 0.5 * VIEW[1] as f64 - 4.0;
    let [x, y] = [u, v].map(|p| p as f64 + 0.5 - 0.5 * VIEW[1] as f64);
    for [azimuth_rad, elevation_rad, _] in &coverage.eyes {
        // In the image y points down, to the front; the right side for an observer there is the image's
        // right.
        let out = radius * (1.0 - elevation_rad.max(0.0) / (0.25 * TAU));
        if (out * azimuth_rad.sin() - x).hypot(out * azimuth_rad.cos() - y) < 3.5 {
            return EYE;
        }
    }
    let out = x.hypot(y);
    if out > radius {
        return BACKGROUND;
    }
    let rings = [1.0, 2.0 / 3.0, 1.0 / 3.0].map(|share| share * radius);
    let turn = x.atan2(y).rem_euclid(TAU) / TAU * SECTORS.len() as f64 + 0.5;
    let off_border = (turn - turn.round()).abs() / SECTORS.len() as f64 * TAU * out;
    if rings.iter().any(|ring| (out - ring).abs() < 0.7) || off_border < 0.6 {
        return LINE;
    }
    if coverage.by_sector[turn as usize % SECTORS.len()] > 0 { SEEN } else { UNSEEN }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_without_a_view_are_red_and_views_stand_where_they_are() {
        let mut by_sector = [0; SECTORS.len()];
        by_sector[2] = 1;
        let coverage = Coverage {
            // To the right, at the horizon.
            eyes: vec![[0.25 * TAU, 0.0, 1.0]],
            by_sector,
            seen_by: 1.0,
            depth_m: 1.0,
            sigma_m: 0.001,
            unread: 0.0,
            cut: 0.0,
        };
        let middle = VIEW[1] / 2;
        assert_eq!(disc_pixel(&coverage, [VIEW[1] - 5, middle]), EYE);
        assert_eq!(disc_pixel(&coverage, [middle + 60, middle]), SEEN);
        assert_eq!(disc_pixel(&coverage, [middle - 60, middle]), UNSEEN);
        assert_eq!(disc_pixel(&coverage, [0, 0]), BACKGROUND);
    }

    #[test]
    fn a_sheet_is_a_picture_of_all_states() {
        let capture = Capture { states: vec![Vec::new(), Vec::new()], ..Capture::default() };
        let bytes = contact_sheet(&capture, &[None, None]);
        let picture = image::load_from_memory(&bytes).unwrap();
        assert_eq!(picture.height() as usize, 2 * (VIEW[1] + GAP) + GAP);
    }
}
