//! What was worked out of recordings before the run that needs it, while they grew.

use std::{
    fmt, fs,
    path::PathBuf,
    sync::{Mutex, PoisonError},
    time::SystemTime,
};

use super::bag::Bag;
use capture::{CaptureConfig, KnownFeatures, TrackedState};

/// Images whose features are kept.
/// derived: two states of the 150 views that the node keeps of each by default, and as many again
const MOST_IMAGES: usize = 600;

/// Work done ahead of a run. Everything is found by what it was made of: a run with it writes the bytes of
/// one without.
#[derive(Default)]
pub struct Ahead {
    /// Features of images.
    pub features: KnownFeatures,
    tracked: Mutex<Vec<(TrackedOf, TrackedState)>>,
}

/// What the tracking of a state depends on.
#[derive(Clone, PartialEq)]
pub struct TrackedOf {
    /// Files with their lengths and times of change.
    files: Vec<(PathBuf, u64, SystemTime)>,
    config: CaptureConfig,
    /// State and seed.
    state: (usize, u64),
}

impl TrackedOf {
    /// Of a bag as it is now; `None` where a file is gone.
    #[must_use]
    pub fn now(bag: &Bag, config: &CaptureConfig, state: (usize, u64)) -> Option<Self> {
        let file = |path: &PathBuf| {
            let metadata = fs::metadata(path).ok()?;
            Some((path.clone(), metadata.len(), metadata.modified().ok()?))
        };
        let files = bag.files.iter().map(file).collect::<Option<_>>()?;
        Some(Self { files, config: config.clone(), state })
    }
}

impl Ahead {
    /// Nothing is worked out yet; with room for it, about 100 MB at most, and what the tracker keeps of the
    /// states' keyframes.
    #[must_use]
    pub fn new() -> Self {
        Self { features: KnownFeatures::of_at_most(MOST_IMAGES), tracked: Mutex::default() }
    }

    /// Keeps the camera's way through a state, one a state.
    pub fn keep(&self, of: TrackedOf, found: TrackedState) {
        let mut tracked = self.tracked.lock().unwrap_or_else(PoisonError::into_inner);
        tracked.retain(|(other, _)| other.state != of.state);
        tracked.push((of, found));
    }

    /// Whether the camera's way is known.
    #[must_use]
    pub fn knows(&self, of: &TrackedOf) -> bool {
        self.tracked.lock().unwrap_or_else(PoisonError::into_inner).iter().any(|(other, _)| other == of)
    }

    /// The camera's way through a state, where it is known. It is given once.
    pub fn take(&self, of: &TrackedOf) -> Option<TrackedState> {
        let mut tracked = self.tracked.lock().unwrap_or_else(PoisonError::into_inner);
        let place = tracked.iter().position(|(other, _)| other == of)?;
        Some(tracked.swap_remove(place).1)
    }
}

impl fmt::Debug for Ahead {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tracked = self.tracked.lock().unwrap_or_else(PoisonError::into_inner).len();
        write!(f, "Ahead({:?}, {tracked} states tracked)", self.features)
    }
}
