//! A recording that grows: whether it is closed, and what can be worked out of it so far.

use std::{
    collections::BTreeSet,
    fs,
    io::{Read, Seek, SeekFrom},
    path::{Path, PathBuf},
    sync::Arc,
    time::Instant,
};

use super::{
    bag::Bag,
    bag_index::BagIndex,
    pixels::decode_views,
    recording::spread,
    tracked_state::TrackedState,
    tracking::{track, unmasked, views_at_a_time},
    views::Views,
};
use capture::{CaptureConfig, CaptureError, RgbdFrame, look_at};
use common::{ahead::Ahead, files};

/// A growing recording is read for one part of the time in so many and one, as all of it is read again.
/// measured: shared/bags/laptop played to the node, 2 cores: with 3 its twin came 0.2 s later
const REST: u32 = 1;

/// The recording of one state, which may still be written.
pub struct GrowingState {
    path: PathBuf,
    state: usize,
    /// Stamps of the views whose images were looked at, nanoseconds.
    seen: BTreeSet<i64>,
    /// Bytes when it was looked at last.
    bytes: u64,
    /// Whether all was worked out that can be.
    done: bool,
    /// When it may be read again while it grows.
    rest: Option<Instant>,
}

/// What is known of a growing recording.
#[derive(Clone, Debug, Default)]
pub struct Grown {
    /// Views so far.
    pub views: usize,
    /// Those that a run would take now.
    pub taken: usize,
    /// Whether its poses were recorded.
    pub is_posed: bool,
    /// Frames of it that were not looked at before.
    pub frames: Vec<RgbdFrame>,
}

impl GrowingState {
    /// The recording of a state, which need not be there yet.
    #[must_use]
    pub fn new(path: &Path, state: usize) -> Self {
        Self { path: path.to_owned(), state, seen: BTreeSet::new(), bytes: 0, done: false, rest: None }
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether its recorder has closed it.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        if !self.path.is_dir() {
            return ends_as_mcap(&self.path).unwrap_or(false);
        }
        // rosbag2 writes metadata.yaml before it ends the last file. One that it compresses as a whole it has
        // ended by then.
        let has_end = |file: &PathBuf| {
            file.extension().is_none_or(|e| e != "mcap") || ends_as_mcap(file).unwrap_or(false)
        };
        self.path.join("metadata.yaml").is_file()
            && Bag::open(&self.path).is_ok_and(|bag| bag.files.last().is_some_and(has_end))
    }

    /// Bytes of its files; 0 where there are none.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        if !Bag::is_at(&self.path) {
            return 0;
        }
        let files = Bag::open(&self.path).map(|bag| bag.files).unwrap_or_default();
        files.iter().filter_map(|f| fs::metadata(f).ok()).map(|m| m.len()).sum()
    }

    /// Works out what a run would have to, of what is new: features of the images that it would take, and of
    /// a closed recording without poses the camera's way. `None` where nothing is new, or it was read just
    /// now.
    ///
    /// # Errors
    /// [`CaptureError`]: of a recording that has only begun, nothing to mind.
    pub fn work_ahead(
        &mut self,
        config: &CaptureConfig,
        seed: u64,
        ahead: &Ahead,
    ) -> Result<Option<Grown>, CaptureError> {
        let closed = self.is_closed();
        let bytes = self.bytes();
        let rests = self.rest.is_some_and(|rest| Instant::now() < rest) && !closed;
        if self.done || rests || bytes == 0 || (bytes == self.bytes && !closed) {
            return Ok(None);
        }
        let begun = Instant::now();
        let grown = self.read(closed, bytes, config, seed, ahead);
        self.rest = Some(Instant::now() + REST * begun.elapsed());
        // What a closed recording lacks will not come.
        self.done |= closed && grown.is_err();
        grown.map(Some)
    }

    fn read(
        &mut self,
        closed: bool,
        bytes: u64,
        config: &CaptureConfig,
        seed: u64,
        ahead: &Ahead,
    ) -> Result<Grown, CaptureError> {
        let bag = Bag::open(&self.path)?;
        let views = Views::find(&bag, &BagIndex::read(&bag)?, config, self.state)?;
        let all: Vec<usize> = (0..views.views.len()).collect();
        let untracked = views.are_untracked();
        if untracked && closed {
            let state = (self.state, seed);
            let key = TrackedState::key(&bag, config, state);
            if let Some(key) = key.filter(|key| !ahead.knows(key)) {
                ahead.keep(key, 1, Arc::new(track(&bag, &views, &all, config, state, ahead)?));
            }
            self.done = true;
            return Ok(Grown { views: all.len(), taken: all.len(), is_posed: false, frames: Vec::new() });
        }
        let taken = if untracked { all.clone() } else { spread(&views.views, &all, config) };
        let new: Vec<(usize, usize)> = taken
            .iter()
            .filter(|v| self.seen.insert(views.views[**v].stamp_nanos))
            .map(|v| (self.state, *v))
            // Not more at once than the tracker would take: memory stays bounded.
            .take(views_at_a_time(&views))
            .collect();
        if new.len() < views_at_a_time(&views) {
            (self.bytes, self.done) = (bytes, closed);
        }
        let decoded = decode_views(&bag, &if untracked { unmasked(&views) } else { views }, &new, config)?;
        let frames: Vec<RgbdFrame> = decoded.frames.into_iter().map(|(_, frame)| frame).collect();
        frames.iter().for_each(|frame| look_at(frame, ahead));
        Ok(Grown { views: all.len(), taken: taken.len(), is_posed: !untracked, frames })
    }
}

/// Whether a file ends as a closed MCAP file does.
fn ends_as_mcap(path: &Path) -> std::io::Result<bool> {
    let mut file = files::open(path)?;
    let magic = mcap::MAGIC.len() as u64;
    if file.metadata()?.len() < 2 * magic {
        return Ok(false);
    }
    file.seek(SeekFrom::End(-(magic as i64)))?;
    let mut end = Vec::new();
    file.take(magic).read_to_end(&mut end)?;
    Ok(end == mcap::MAGIC)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{open, open_ahead};

    /// What a run reads of a recording is the same with what was worked out while it grew, and it looks at no
    /// image again.
    #[test]
    fn a_recording_that_grew_is_read_as_any_other() {
        let shipped = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../bags/drawer");
        let folder = tempfile::tempdir().unwrap();
        let config = CaptureConfig { frames_per_state: 8, ..CaptureConfig::default() };
        let ahead = Ahead::new();
        let paths = ["state0", "state1"].map(|s| folder.path().join(s));
        for (state, path) in paths.iter().enumerate() {
            let mut growing = GrowingState::new(path, state);
            assert!(!growing.is_closed() && growing.work_ahead(&config, 0, &ahead).unwrap().is_none());
            let from = shipped.join(format!("state{state}"));
            let name = format!("state{state}.mcap");
            let bytes = fs::read(from.join(&name)).unwrap();
            fs::create_dir(path).unwrap();
            let mut views = 0;
            for share in [4, 7, 10] {
                fs::write(path.join(&name), &bytes[..bytes.len() * share / 10]).unwrap();
                growing.rest = None;
                let grown = growing.work_ahead(&config, 0, &ahead).unwrap().unwrap();
                assert!(grown.views > views && grown.taken <= 8, "{} {}", grown.views, grown.taken);
                views = grown.views;
                assert!(growing.work_ahead(&config, 0, &ahead).unwrap().is_none(), "nothing is new");
            }
            fs::write(path.join(&name), &bytes[..bytes.len() - 1]).unwrap();
            fs::copy(from.join("metadata.yaml"), path.join("metadata.yaml")).unwrap();
            assert!(!growing.is_closed(), "the file has no end yet");
            fs::write(path.join(&name), &bytes).unwrap();
            assert!(growing.is_closed());
            growing.work_ahead(&config, 0, &ahead).unwrap().unwrap();
            assert!(growing.work_ahead(&config, 0, &ahead).unwrap().is_none());
        }
        let known = ahead.count();
        let with = open_ahead(&paths, &config, 0, &ahead).unwrap();
        assert_eq!(ahead.count(), known, "an image was looked at again");
        let without = open(&paths, &config, 0).unwrap();
        assert_eq!(with.poses, without.poses);
        for (a, b) in with.states.iter().flatten().zip(without.states.iter().flatten()) {
            assert!(a.depth_m == b.depth_m && a.mask == b.mask && a.world_from_camera == b.world_from_camera);
        }
    }

    /// What cannot be used is looked at once.
    #[test]
    fn a_closed_recording_that_cannot_be_used_is_let_go() {
        let folder = tempfile::tempdir().unwrap();
        let from = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../bags/drawer/state0/state0.mcap");
        let path = folder.path().join("state0.mcap");
        fs::copy(from, &path).unwrap();
        let mut config = CaptureConfig::default();
        config.topics.color = Some("/none".into());
        let mut growing = GrowingState::new(&path, 0);
        assert!(growing.is_closed() && growing.work_ahead(&config, 0, &Ahead::new()).is_err());
        assert!(growing.work_ahead(&config, 0, &Ahead::new()).unwrap().is_none());
    }

    /// A closed recording without poses is tracked ahead, and not by the run.
    #[test]
    fn the_way_of_a_camera_is_found_ahead_once() {
        let config = CaptureConfig { tracking: capture::TrackCamera::Always, ..CaptureConfig::default() };
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../bags/drawer/state0");
        let ahead = Ahead::new();
        let mut growing = GrowingState::new(&path, 0);
        assert!(growing.work_ahead(&config, 3, &ahead).unwrap().is_some());
        let bag = Bag::open(&path).unwrap();
        let key = |seed| TrackedState::key(&bag, &config, (0, seed)).unwrap();
        assert!(ahead.knows(&key(3)) && !ahead.knows(&key(4)));
        let views = Views::find(&bag, &BagIndex::read(&bag).unwrap(), &config, 0).unwrap();
        let all: Vec<usize> = (0..views.views.len()).collect();
        let again = track(&bag, &views, &all, &config, (0, 3), &Ahead::default()).unwrap();
        let found: TrackedState = ahead.take(&key(3)).unwrap();
        assert_eq!((found.track.poses, found.views), (again.track.poses, again.views));
        assert!(!ahead.knows(&key(3)));
    }
}
