//! Opens recordings: from paths to views, and from views to frames.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use super::{
    bag::Bag,
    bag_index::BagIndex,
    pixels::{Decoded, decode_views},
    probe::{Settled, settle},
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

/// A bag whose views are known but not yet decoded.
pub struct Recording {
    /// Its files.
    pub bag: Bag,
    /// Its views, in the order of time.
    pub views: Views,
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
        let bag = Bag::open(path)?;
        let mut views = Views::find(&bag, &BagIndex::read(&bag, stop)?, config, state)?;
        settle(&mut [Settled { bag: &bag, views: &mut views, state }], config, stop)?;
        Ok(Self { bag, views })
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
        let bags: Vec<Bag> = paths.iter().map(|path| Bag::open(path)).collect::<Result<_, _>>()?;
        let mut indices: Vec<BagIndex> =
            bags.iter().map(|bag| BagIndex::read(bag, stop)).collect::<Result<_, _>>()?;
        let shared = share_static_transforms(&mut indices);
        let mut all = Vec::new();
        for (state, ((bag, index), note)) in bags.iter().zip(&indices).zip(shared).enumerate() {
            let mut views = Views::find(bag, index, config, state)?;
            views.warnings.extend(note.map(|note| note.about(format!("state {state}"))));
            all.push(views);
        }
        drop(indices);
        let mut settled = Vec::new();
        for (state, (bag, views)) in bags.iter().zip(&mut all).enumerate() {
            settled.push(Settled { bag, views, state });
        }
        settle(&mut settled, config, stop)?;
        Ok(bags.into_iter().zip(all).map(|(bag, views)| Self { bag, views }).collect())
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
    ) -> Result<(Self, Vec<Vec<usize>>), CaptureError> {
        let bag = Bag::open(path)?;
        let mut index = BagIndex::read(&bag, stop)?;
        let topics = choose(&index.summaries(), &config.topics, &bag.path)?;
        let (first, last) = index.span_nanos().unwrap_or_default();
        let split = match (&topics.marker, config.split_secs.as_slice()) {
            (Some(topic), _) => {
                Split::at_markers(topic, index.markers.get(topic).map_or(&[][..], Vec::as_slice))
            }
            (None, []) => Err(CaptureError::OneState { path: path.to_owned() }),
            (None, times) => Split::at_times(times, first, last),
        };
        if let Ok(split) = &split {
            index.leave_out_between(split, &topics.color);
        }
        // For the whole bag, so both states share one choice of topics and one source of poses.
        let mut views = Views::find(&bag, &index, config, 0)?;
        let split = split?;
        settle(&mut [Settled { bag: &bag, views: &mut views, state: 0 }], config, stop)?;
        let mut of_states = Vec::new();
        for state in 0..2 {
            let of_state: Vec<usize> = (0..views.views.len())
                // By recording time, as markers of std_msgs have no stamp.
                .filter(|v| split.state_at(views.views[*v].log_nanos) == Some(state))
                .collect();
            if of_state.is_empty() {
                return Err(CaptureError::Split {
                    reason: format!(
                        "no usable view lies in state {state}; {} views in all",
                        views.views.len()
                    ),
                });
            }
            of_states.push(of_state);
        }
        Ok((Self { bag, views }, of_states))
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

/// Gives each recording the static transforms of frames that have a parent in another one alone: they belong
/// to the camera and the robot, and recorders that start late miss them. Returns a note for each recording
/// that got some.
fn share_static_transforms(indices: &mut [BagIndex]) -> Vec<Option<Note>> {
    let mut known: BTreeMap<String, (String, Pose)> = BTreeMap::new();
    for index in indices.iter() {
        for (parent, child, pose) in index.tf.static_transforms() {
            known.entry(child.to_owned()).or_insert_with(|| (parent.to_owned(), pose));
        }
    }
    let mut notes = Vec::new();
    for index in indices {
        let mut got = Vec::new();
        for (child, (parent, pose)) in &known {
            if !index.tf.has_parent(child) {
                index.tf.add_static(parent, child, *pose);
                got.push(child.as_str());
            }
        }
        let named = got.iter().take(NAMED).copied().collect::<Vec<_>>().join(", ");
        notes.push((!got.is_empty()).then(|| {
            let text = format!(
                "static transforms were recorded with another state alone, and are taken from it ({named})"
            );
            Note::new(NoteCode::TransformsShared, text)
        }));
    }
    notes
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
