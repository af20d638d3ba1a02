//! Features of whole images, kept by the images' contents: images of a growing recording are not searched
//! again by the run.

use std::{
    collections::{BTreeMap, VecDeque},
    fmt,
    sync::{Arc, Mutex, PoisonError},
};

use sha2::{Digest, Sha256};

use super::feature::{Feature, FeatureConfig, image_features};
use crate::RgbdFrame;

/// Most features of an image.
const MOST: usize = 600;

/// Digest of an image.
type ImageDigest = [u8; 32];

/// Features of the last images; without room every image is searched anew.
#[derive(Default)]
pub struct KnownFeatures {
    most: usize,
    kept: Mutex<Kept>,
}

#[derive(Default)]
struct Kept {
    by_image: BTreeMap<ImageDigest, Arc<Vec<Feature>>>,
    /// The oldest first.
    order: VecDeque<ImageDigest>,
}

impl KnownFeatures {
    /// Room for those of so many images, about 160 kB each.
    #[must_use]
    pub fn of_at_most(images: usize) -> Self {
        Self { most: images, kept: Mutex::default() }
    }

    /// Features of the whole image of a frame, under its mask or not, strongest first.
    #[must_use]
    pub(crate) fn of(&self, frame: &RgbdFrame) -> Arc<Vec<Feature>> {
        if self.most == 0 {
            return Arc::new(found(frame));
        }
        let image = digest(frame);
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = kept().by_image.get(&image) {
            return Arc::clone(known);
        }
        // Not under the lock: others look at other images meanwhile.
        let found = Arc::new(found(frame));
        let mut kept = kept();
        if kept.by_image.insert(image, Arc::clone(&found)).is_none() {
            kept.order.push_back(image);
        }
        while kept.order.len() > self.most {
            let oldest = kept.order.pop_front();
            oldest.map(|image| kept.by_image.remove(&image));
        }
        found
    }

    /// Finds and keeps the features of a frame's image.
    pub fn look_at(&self, frame: &RgbdFrame) {
        drop(self.of(frame));
    }

    /// Number of known images.
    #[must_use]
    pub fn len(&self) -> usize {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).order.len()
    }

    /// Whether none is.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl fmt::Debug for KnownFeatures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "KnownFeatures({} of {})", self.len(), self.most)
    }
}

/// Features of the whole image.
fn found(frame: &RgbdFrame) -> Vec<Feature> {
    // At the size of the image: features of less than two pixels are noise in a view by hand.
    let config = FeatureConfig { upsample: false, limit: MOST, ..FeatureConfig::default() };
    image_features(frame, &config)
}

fn digest(frame: &RgbdFrame) -> ImageDigest {
    let size = [frame.intrinsics.width, frame.intrinsics.height].map(|n| (n as u64).to_le_bytes());
    Sha256::new().chain_update(size.concat()).chain_update(frame.rgb.as_flattened()).finalize().into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Intrinsics, Pose};

    fn frame(seed: usize) -> RgbdFrame {
        let intrinsics = Intrinsics { width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0 };
        let shade = |i: usize| ((i % 64 / (3 + seed) + i / 64 / 5) % 2 * 200) as u8;
        RgbdFrame {
            id: String::new(),
            stamp_nanos: 0,
            intrinsics,
            world_from_camera: Pose::identity(),
            rgb: (0..64 * 48).map(|i| [shade(i); 3]).collect(),
            depth_m: vec![1.0; 64 * 48],
            mask: None,
            readings: Vec::new(),
        }
    }

    #[test]
    fn an_image_is_known_by_what_it_holds_and_the_oldest_goes() {
        let known = KnownFeatures::of_at_most(2);
        let first = known.of(&frame(0));
        assert_eq!(*first, found(&frame(0)));
        // Depth, mask and pose do not matter; the image does.
        let masked = RgbdFrame { mask: Some(vec![false; 64 * 48]), stamp_nanos: 7, ..frame(0) };
        assert!(Arc::ptr_eq(&first, &known.of(&masked)));
        let mut other = frame(0);
        other.rgb[5] = [9; 3];
        assert!(!Arc::ptr_eq(&first, &known.of(&other)));
        known.look_at(&frame(1));
        assert_eq!(known.len(), 2);
        assert!(!Arc::ptr_eq(&first, &known.of(&frame(0))), "the oldest was to go");
        let none = KnownFeatures::default();
        none.look_at(&frame(0));
        assert!(none.is_empty());
    }
}
