//! Opens recordings: from paths to views, and from views to frames.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    slice,
};

use super::{
    bag::Bag,
    bag_index::BagIndex,
    pixels::{Decoded, decode_views},
    probe::settle,
    source::Source,
    topics::choose,
    views::{View, Views},
};
use capture::{CaptureConfig, CaptureError, RgbdFrame, Split, spread_views};
use common::limits::{BYTES_PER_PIXEL, NAMED};
use common::note::{Note, NoteCode};
use common::stop::Stop;
use geometry::Pose;

/// Memory of the views decoded at a time, bytes.
/// derived: 64 views of 640x480; the bag is read once for each such block
const BLOCK_BYTES: u64 = 64 * 640 * 480 * BYTES_PER_PIXEL;

/// The object's name, from the recordings' paths: `[A-Za-z][A-Za-z0-9_]*`.
///
/// # Errors
/// Where the paths hold no recording.
pub fn object_name(sources: &[PathBuf]) -> Result<String, CaptureError> {
    Ok(Source::of(sources)?.object_name())
}

/// Number of states in the recordings at the paths.
///
/// # Errors
/// Where the paths hold no recording.
pub fn state_count(sources: &[PathBuf]) -> Result<usize, CaptureError> {
    Ok(Source::of(sources)?.states())
}

/// A bag whose messages are known.
pub(super) struct IndexedBag {
    /// Its files.
    pub bag: Bag,
    /// Its messages.
    pub index: BagIndex,
    /// Its state, for messages.
    state: usize,
    /// The note on static transforms that it has from another one.
    shared: Option<Note>,
}

impl IndexedBag {
    /// Reads a bag without its pixels.
    ///
    /// # Errors
    /// [`CaptureError`] about files.
    pub fn read(path: &Path, state: usize, stop: &Stop) -> Result<Self, CaptureError> {
        let bag = Bag::open(path)?;
        let index = BagIndex::read(&bag, stop)?;
        Ok(Self { bag, index, state, shared: None })
    }

    /// The bags of all states, with each other's static transforms.
    ///
    /// # Errors
    /// Those of [`Self::read`].
    pub fn of_states(paths: &[PathBuf], stop: &Stop) -> Result<Vec<Self>, CaptureError> {
        let bags = paths.iter().enumerate().map(|(state, path)| Self::read(path, state, stop));
        let mut bags = bags.collect::<Result<Vec<_>, _>>()?;
        share_static_transforms(&mut bags);
        Ok(bags)
    }

    /// When the states of a bag that holds both follow each other; what lies between them is left out.
    ///
    /// # Errors
    /// [`CaptureError::Split`] and [`CaptureError::OneState`] where it cannot be divided, and those about
    /// topics.
    pub fn divided(&mut self, config: &CaptureConfig) -> Result<Split, CaptureError> {
        let topics = choose(&self.index.summaries(), &config.topics, &self.bag.path)?;
        let (first, last) = self.index.span_nanos().unwrap_or_default();
        let split = match (&topics.marker, config.split_secs.as_slice()) {
            (Some(topic), _) => {
                Split::at_markers(topic, self.index.markers.get(topic).map_or(&[][..], Vec::as_slice))
            }
            (None, []) => Err(CaptureError::OneState { path: self.bag.path.clone() }),
            (None, times) => Split::at_times(times, first, last),
        }?;
        self.index.leave_out_between(&split, &topics.color);
        Ok(split)
    }

    /// Its views, to be settled.
    ///
    /// # Errors
    /// Those of [`Views::find`].
    pub fn unsettled(self, config: &CaptureConfig) -> Result<Recording, CaptureError> {
        let mut views = Views::find(&self.bag, &self.index, config, self.state)?;
        views.warnings.extend(self.shared);
        Ok(Recording { bag: self.bag, views, state: self.state })
    }
}

/// A bag whose views are known but not yet decoded.
pub struct Recording {
    /// Its files.
    pub bag: Bag,
    /// Its views, in the order of time.
    pub views: Views,
    /// Its state, for messages.
    pub(super) state: usize,
}

/// A recording with the numbers of its states, and the views of each.
pub struct RecordedStates {
    /// The recording.
    pub recording: Recording,
    /// Its states.
    pub states: Vec<(usize, Vec<usize>)>,
}

impl RecordedStates {
    /// A recording of one state.
    #[must_use]
    pub fn of_one(recording: Recording) -> Self {
        let states = vec![(recording.state, recording.all())];
        Self { recording, states }
    }

    /// A settled recording of both states.
    ///
    /// # Errors
    /// [`CaptureError::Split`] where a state has no view.
    pub(super) fn of_both(recording: Recording, split: &Split) -> Result<Self, CaptureError> {
        let views = &recording.views.views;
        let mut states = Vec::new();
        for state in 0..2 {
            // By recording time, as markers of std_msgs have no stamp.
            let is_of_state = |v: &usize| split.state_at(views[*v].log_nanos) == Some(state);
            let of_state: Vec<usize> = (0..views.len()).filter(is_of_state).collect();
            if of_state.is_empty() {
                let all = views.len();
                let reason = format!("no usable view lies in state {state}; {all} views in all");
                return Err(CaptureError::Split { reason });
            }
            states.push((state, of_state));
        }
        Ok(Self { recording, states })
    }
}

impl Recording {
    /// Reads a bag, of its pixels only some views. `state` is used in messages.
    ///
    /// # Errors
    /// Every [`CaptureError`] about files, topics, cameras, depth and poses.
    pub fn open(
        path: &Path,
        config: &CaptureConfig,
        state: usize,
        stop: &Stop,
    ) -> Result<Self, CaptureError> {
        let mut recording = IndexedBag::read(path, state, stop)?.unsettled(config)?;
        settle(slice::from_mut(&mut recording), config, stop)?;
        Ok(recording)
    }

    /// Reads the bags of all states, which were recorded with one camera: all of them have poses, or none.
    ///
    /// # Errors
    /// Those of [`Self::open`].
    pub fn open_states(
        paths: &[PathBuf],
        config: &CaptureConfig,
        stop: &Stop,
    ) -> Result<Vec<Self>, CaptureError> {
        let bags = IndexedBag::of_states(paths, stop)?.into_iter();
        let mut recordings = bags.map(|bag| bag.unsettled(config)).collect::<Result<Vec<_>, _>>()?;
        settle(&mut recordings, config, stop)?;
        Ok(recordings)
    }

    /// Reads a bag of all states one after the other, with the views of each.
    ///
    /// # Errors
    /// Those of [`Self::open`]; [`CaptureError::Split`] and [`CaptureError::OneState`] where it cannot be
    /// divided.
    pub fn open_divided(
        path: &Path,
        config: &CaptureConfig,
        stop: &Stop,
    ) -> Result<RecordedStates, CaptureError> {
        let mut bag = IndexedBag::read(path, 0, stop)?;
        let split = bag.divided(config);
        // For the whole bag, so both states share one choice of topics and one source of poses.
        let mut recording = bag.unsettled(config)?;
        let split = split?;
        settle(slice::from_mut(&mut recording), config, stop)?;
        RecordedStates::of_both(recording, &split)
    }

    /// All its views, by their numbers.
    #[must_use]
    pub fn all(&self) -> Vec<usize> {
        (0..self.views.views.len()).collect()
    }

    /// Those of some views that a run uses: of the views with a pose, the ones farthest from each other, in
    /// the order of time.
    #[must_use]
    pub fn spread(&self, of_state: &[usize], config: &CaptureConfig) -> Vec<usize> {
        // Farthest views first (2.4): neighbors in time show nearly the same.
        let posed = of_state.iter().filter_map(|&v| Some((v, self.views.views[v].world_from_camera?)));
        let (posed, poses): (Vec<usize>, Vec<Pose>) = posed.unzip();
        spread_views(&poses, config.frames_per_state).into_iter().map(|i| posed[i]).collect()
    }

    /// Frames of chosen views: state, and number of the view.
    ///
    /// # Errors
    /// [`CaptureError`] about the bag, or about all of its images.
    pub fn decode(
        &self,
        chosen: &[(usize, usize)],
        config: &CaptureConfig,
        stop: &Stop,
    ) -> Result<Decoded, CaptureError> {
        decode_views(&self.bag, &self.views, chosen, config, stop)
    }

    /// Frames of some views without their masks, with the views' indices, in blocks so that memory is
    /// bounded. Broken frames are left out. Masks are of the object, but its surroundings also show the
    /// camera's motion.
    ///
    /// # Errors
    /// In the items, those of [`Self::decode`].
    pub fn blocks<'a>(
        &'a self,
        of_state: &'a [usize],
        config: &'a CaptureConfig,
        stop: &'a Stop,
    ) -> impl Iterator<Item = Result<Vec<(usize, RgbdFrame)>, CaptureError>> + 'a {
        let unmasked = unmasked(&self.views);
        of_state.chunks(views_at_a_time(&self.views)).map(move |some| {
            let chosen: Vec<(usize, usize)> = some.iter().map(|&v| (v, v)).collect();
            Ok(decode_views(&self.bag, &unmasked, &chosen, config, stop)?.frames)
        })
    }
}

/// Gives each bag the static transforms of frames that have a parent in another one alone: they belong to the
/// camera and the robot, and recorders that start late miss them. Those that got some have a note on it.
fn share_static_transforms(bags: &mut [IndexedBag]) {
    let mut known: BTreeMap<String, (String, Pose)> = BTreeMap::new();
    for bag in bags.iter() {
        for (parent, child, pose) in bag.index.tf.static_transforms() {
            known.entry(child.to_owned()).or_insert_with(|| (parent.to_owned(), pose));
        }
    }
    for bag in bags {
        let mut got = Vec::new();
        for (child, (parent, pose)) in &known {
            if !bag.index.tf.has_parent(child) {
                bag.index.tf.add_static(parent, child, *pose);
                got.push(child.as_str());
            }
        }
        if got.is_empty() {
            continue;
        }
        let named = got.iter().take(NAMED).copied().collect::<Vec<_>>().join(", ");
        let text = format!(
            "static transforms were recorded with another state alone, and are taken from it ({named})"
        );
        let note = Note::new(NoteCode::TransformsShared, text);
        bag.shared = Some(note.about(format!("state {}", bag.state)));
    }
}

/// Views without their masks.
pub(super) fn unmasked(views: &Views) -> Views {
    let unmasked = views.views.iter().map(|v| View { mask: None, ..v.clone() }).collect();
    Views { views: unmasked, ..views.clone() }
}

/// Number of views decoded at a time.
pub(super) fn views_at_a_time(views: &Views) -> usize {
    let (_, width, height) = views.sizes(1);
    let of_view = (width * height) as u64 * BYTES_PER_PIXEL;
    (BLOCK_BYTES / of_view.max(1)).max(1) as usize
}
