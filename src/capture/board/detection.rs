//! Tags in an image.

use std::cell::RefCell;

use apriltag::{DetectorBuilder, Family, Image};
use nalgebra::Point2;

use super::gray::Gray;

/// A tag in an image.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenTag {
    /// Its number in the tag family.
    pub tag: u16,
    /// Corners of its black border, pixels, accurate to about one: clockwise as the tag is read, from the
    /// upper left.
    pub corners: [Point2<f64>; 4],
}

/// Wrong bits accepted in a tag: any two tags of a board differ in eleven.
const WRONG_BITS: usize = 1;
/// Smallest side of an image that is searched for a board, pixels.
/// derived: two tags with cells of three pixels
const LEAST_SIDE: usize = 48;

/// Tags in an image, by number; a number seen twice is left out.
pub(super) fn detect_tags(gray: &Gray) -> Vec<SeenTag> {
    thread_local! {
        // The detector builds its tables once per thread.
        static DETECTOR: RefCell<Option<apriltag::Detector>> = RefCell::new(
            DetectorBuilder::new().add_family_bits(Family::tag_36h11(), WRONG_BITS).build().ok().map(|mut d| {
                // At full resolution: tags are small.
                d.set_decimation(1.0);
                d
            })
        );
    }
    if gray.width.min(gray.height) < LEAST_SIDE {
        return Vec::new();
    }
    let Ok(mut image) = Image::zeros_with_stride(gray.width, gray.height, gray.width) else {
        return Vec::new();
    };
    image.as_slice_mut().copy_from_slice(&gray.bytes());
    let found = DETECTOR.with_borrow_mut(|d| d.as_mut().map(|d| d.detect(&image)));
    let mut tags: Vec<SeenTag> = found.unwrap_or_default().iter().filter_map(seen_tag).collect();
    tags.sort_by_key(|t| t.tag);
    let twice: Vec<u16> = tags.windows(2).filter(|w| w[0].tag == w[1].tag).map(|w| w[0].tag).collect();
    tags.retain(|t| !twice.contains(&t.tag));
    tags
}

/// `None` for a number beyond 16 bits.
fn seen_tag(detection: &apriltag::Detection) -> Option<SeenTag> {
    let corners = detection.corners();
    Some(SeenTag {
        tag: u16::try_from(detection.id()).ok()?,
        // The detector begins with the lower left corner, runs the other way round, and counts from the
        // corner of the first pixel.
        corners: [3, 2, 1, 0].map(|k| Point2::from(corners[k].map(|v| v - 0.5))),
    })
}
