//! A cache of the features of whole images, by image content: images searched during recording are not
//! searched again by the run.

use std::sync::Arc;

use super::feature::{Feature, FeatureConfig, image_features};
use crate::RgbdFrame;
use common::{ahead::Ahead, fingerprint::Key};

/// Most features per image.
const MOST: usize = 600;
/// Number of cached images, about 160 kB each.
/// derived: two states of the 150 views each that the node keeps by default, and as many again
const MOST_IMAGES: usize = 600;

/// Features in the whole image of a frame, strongest first; its mask is ignored.
#[must_use]
pub(crate) fn whole_image_features(frame: &RgbdFrame, ahead: &Ahead) -> Arc<Vec<Feature>> {
    ahead.get_or_compute(|| key(frame), MOST_IMAGES, || features_of_image(frame))
}

/// Puts the features of a frame's image into the cache.
pub fn look_at(frame: &RgbdFrame, ahead: &Ahead) {
    drop(whole_image_features(frame, ahead));
}

fn features_of_image(frame: &RgbdFrame) -> Vec<Feature> {
    // At full size: in handheld views, features below two pixels are noise.
    let config = FeatureConfig { upsample: false, limit: MOST };
    image_features(frame, &config)
}

fn key(frame: &RgbdFrame) -> Key {
    let size = [frame.intrinsics.width, frame.intrinsics.height].map(|n| (n as u64).to_le_bytes());
    Key::of("features", [size.as_flattened(), frame.rgb.as_flattened()])
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Intrinsics, Pose};

    #[test]
    fn an_image_is_known_by_what_it_holds() {
        let ahead = Ahead::new();
        let intrinsics = Intrinsics { width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0 };
        let frame = RgbdFrame {
            id: String::new(),
            stamp_nanos: 0,
            intrinsics,
            world_from_camera: Pose::identity(),
            rgb: (0..64 * 48).map(|i| [((i % 64 / 3 + i / 64 / 5) % 2 * 200) as u8; 3]).collect(),
            depth_m: vec![1.0; 64 * 48],
            mask: None,
            readings: Vec::new(),
        };
        let first = whole_image_features(&frame, &ahead);
        assert_eq!(*first, features_of_image(&frame));
        // Depth, mask and pose do not matter, only the image.
        let masked = RgbdFrame { mask: Some(vec![false; 64 * 48]), stamp_nanos: 7, ..frame.clone() };
        assert!(Arc::ptr_eq(&first, &whole_image_features(&masked, &ahead)));
        let mut other = frame;
        other.rgb[5] = [9; 3];
        assert!(!Arc::ptr_eq(&first, &whole_image_features(&other, &ahead)));
    }
}
