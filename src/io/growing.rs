//! A recording that is still growing: whether it is closed, and what can be computed from it so far.

use std::{
    collections::BTreeSet,
    fs,
    io::{Read, Seek, SeekFrom},
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use super::{
    bag::Bag,
    folder::ImageFolder,
    recording::{Recording, unmasked, views_at_a_time},
};
use capture::{CaptureConfig, CaptureError, RgbdFrame};
use common::files;
use common::stop::Stop;

/// After a reading, a growing recording is left alone for this many times as long, because each reading reads
/// all of it.
/// measured: shared/bags/laptop played to the node, 2 cores: with 3 its twin came 0.2 s later
const REST: u32 = 1;

/// The recording of one state, perhaps still being written.
pub struct GrowingState {
    path: PathBuf,
    state: usize,
    /// Stamps of the views with decoded images, nanoseconds.
    seen: BTreeSet<i64>,
    /// Its size when it was last looked at, bytes.
    bytes: u64,
    /// Whether everything possible has been read.
    done: bool,
    /// Time before which it is not read again while it grows.
    rest: Option<Instant>,
}

/// What a growing recording contains.
pub struct Grown {
    /// Number of views so far.
    pub views: usize,
    /// Number of views that a run would use now.
    pub taken: usize,
    /// Whether its poses were recorded.
    pub is_posed: bool,
    /// Frames not returned before.
    pub frames: Vec<RgbdFrame>,
    /// The whole recording, once, if it is closed and has no poses.
    pub to_track: Option<Recording>,
}

impl GrowingState {
    /// The recording of a state. It need not exist yet.
    #[must_use]
    pub fn new(path: &Path, state: usize) -> Self {
        Self { path: path.to_owned(), state, seen: BTreeSet::new(), bytes: 0, done: false, rest: None }
    }

    /// Index of its state.
    #[must_use]
    pub fn state(&self) -> usize {
        self.state
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
            return is_closed_ros1(&self.path) || ends_as_mcap(&self.path).unwrap_or(false);
        }
        // A folder of images is copied, not recorded.
        if ImageFolder::is_at(&self.path) {
            return true;
        }
        // rosbag2 writes metadata.yaml before it ends the last file; a file compressed as a whole has ended
        // by then.
        if !self.path.join("metadata.yaml").is_file() {
            return false;
        }
        let Ok(bag) = Bag::open(&self.path) else { return false };
        bag.files.last().is_some_and(|file| {
            file.extension().is_none_or(|e| e != "mcap") || ends_as_mcap(file).unwrap_or(false)
        })
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

    /// Reads new data: images that a run would use, or all of a closed recording without poses. `None` if
    /// there is nothing new, or it was read just now.
    ///
    /// # Errors
    /// [`CaptureError`]; if the recording has only just begun, it can be ignored.
    pub fn read_new(&mut self, config: &CaptureConfig, stop: &Stop) -> Result<Option<Grown>, CaptureError> {
        let closed = self.is_closed();
        let bytes = self.bytes();
        let rests = self.rest.is_some_and(|rest| Instant::now() < rest) && !closed;
        if self.done || rests || bytes == 0 || (bytes == self.bytes && !closed) {
            return Ok(None);
        }
        let begun = Instant::now();
        let grown = self.read(closed, bytes, config, stop);
        self.rest_after(begun.elapsed());
        // What is missing from a closed recording will not come.
        self.done |= closed && grown.is_err();
        grown.map(Some)
    }

    /// Postpones the next reading according to the time spent on this one.
    pub fn rest_after(&mut self, spent: Duration) {
        self.rest = Some(Instant::now() + REST * spent);
    }

    fn read(
        &mut self,
        closed: bool,
        bytes: u64,
        config: &CaptureConfig,
        stop: &Stop,
    ) -> Result<Grown, CaptureError> {
        let mut recording = Recording::open(&self.path, config, self.state, stop)?;
        let all = recording.all();
        let views = all.len();
        let untracked = recording.views.are_untracked();
        if untracked && closed {
            self.done = true;
            let to_track = Some(recording);
            return Ok(Grown { views, taken: views, is_posed: false, frames: Vec::new(), to_track });
        }
        let taken = if untracked { all } else { recording.spread(&all, config) };
        let most = views_at_a_time(&recording.views);
        let stamp = |v: usize| recording.views.views[v].stamp_nanos;
        let new: Vec<(usize, usize)> = taken
            .iter()
            .filter(|v| self.seen.insert(stamp(**v)))
            .map(|v| (self.state, *v))
            // At most as many at once as the tracker would take, so memory stays bounded.
            .take(most)
            .collect();
        if new.len() < most {
            (self.bytes, self.done) = (bytes, closed);
        }
        if untracked {
            recording.views = unmasked(&recording.views);
        }
        let frames = recording.decode(&new, config, stop)?.frames.into_iter().map(|(_, frame)| frame);
        Ok(Grown {
            views,
            taken: taken.len(),
            is_posed: !untracked,
            frames: frames.collect(),
            to_track: None,
        })
    }
}

/// Whether a file is a bag of ROS 1 that its recorder has renamed at the end.
fn is_closed_ros1(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "bag")
}

/// Whether a file ends as a closed MCAP file does.
fn ends_as_mcap(path: &Path) -> std::io::Result<bool> {
    let mut file = files::open_regular(path)?;
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
        assert!(growing.is_closed() && growing.read_new(&config, &Stop::never()).is_err());
        assert!(growing.read_new(&config, &Stop::never()).unwrap().is_none());
    }
}
