//! Inspects a recording: its contents, whether it can be reconstructed and, if not, what is missing.

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use super::{
    bag::Bag,
    bag_index::BagIndex,
    board_look::board_note,
    dataset,
    inspect_motion::{MotionInspection, inspect_motion, is_of_joints},
    probe::settle,
    recording::{IndexedBag, RecordedStates, Recording},
    source::Source,
    topics::INFO_TYPE,
};
use capture::{CaptureConfig, CaptureError};
use common::limits::SHOWN;
use common::note::Note;
use common::stop::Stop;

/// A topic of a bag.
#[derive(Clone, Debug, PartialEq)]
pub struct TopicInspection {
    /// Name.
    pub name: String,
    /// Type.
    pub type_name: String,
    /// Number of messages.
    pub count: usize,
    /// Messages per second; `None` with fewer than two.
    pub rate_hz: Option<f64>,
    /// Encoding, size and frame, as far as known of images and camera_info.
    pub details: String,
}

/// One recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StateInspection {
    /// The bag or folder.
    pub path: PathBuf,
    /// Name of its format.
    pub format: String,
    /// First and last recording time, seconds since the epoch.
    pub span_secs: Option<(f64, f64)>,
    /// Its topics, by name.
    pub topics: Vec<TopicInspection>,
    /// Its transform tree, a line per frame.
    pub transforms: Vec<String>,
    /// The topics a run would use.
    pub chosen: Vec<Note>,
    /// Damage and loss.
    pub warnings: Vec<Note>,
    /// Number of usable RGB-D views.
    pub views: usize,
    /// Whether they have no poses, so the camera must be tracked by its images.
    pub untracked: bool,
    /// Why `reconstruct` cannot use it.
    pub problem: Option<String>,
    /// Its joints, if `reconstruct` cannot use it.
    pub motion: MotionInspection,
}

/// Contents of a path.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inspection {
    /// The recordings found: one per state, or one.
    pub recordings: Vec<StateInspection>,
    /// Why all of it together cannot be reconstructed as it is.
    pub problem: Option<String>,
    /// Warnings about the images of all recordings together.
    pub warnings: Vec<Note>,
}

/// Looks into a recording with the default settings.
///
/// # Errors
/// [`CaptureError`] where it cannot be read at all; missing parts are reported in the result.
pub fn inspect(path: &Path) -> Result<Inspection, CaptureError> {
    inspect_with(&[path.to_owned()], &CaptureConfig::default())
}

/// Inspects recordings with the given settings; several are the states of one object.
///
/// # Errors
/// Those of [`inspect`].
pub fn inspect_with(sources: &[PathBuf], config: &CaptureConfig) -> Result<Inspection, CaptureError> {
    Ok(inspected(sources, config)?.0)
}

/// An inspection, and the bags as `reconstruct` reads them, where it can use all of them.
///
/// # Errors
/// Those of [`inspect`].
pub fn inspected(
    sources: &[PathBuf],
    config: &CaptureConfig,
) -> Result<(Inspection, Option<Vec<RecordedStates>>), CaptureError> {
    let mut found = Inspection::default();
    let stop = &Stop::never();
    let mut recorded = None;
    match Source::of(sources) {
        Ok(Source::States(paths)) => {
            let settled = found.settled_bags(IndexedBag::of_states(&paths, stop)?, config);
            recorded = settled.map(|all| all.into_iter().map(RecordedStates::of_one).collect());
        }
        Ok(Source::Both(path)) => {
            let mut bag = IndexedBag::read(&path, 0, stop)?;
            let hint = marker_hint(&bag.index);
            let split = bag.divided(config);
            let settled = found.settled_bags(vec![bag], config).and_then(|mut all| all.pop());
            let divided = match (split, settled) {
                (Ok(split), Some(recording)) => RecordedStates::of_both(recording, &split).map(Some),
                (split, _) => split.map(|_| None),
            };
            match divided {
                Ok(divided) => recorded = divided.map(|divided| vec![divided]),
                Err(error @ CaptureError::OneState { .. }) => found.problem = Some(format!("{error}{hint}")),
                Err(error) => found.problem = Some(error.to_string()),
            }
        }
        Ok(Source::Keyframes(folder)) => found.recordings.push(inspect_dataset(
            &folder,
            "keyframe dataset",
            config,
            dataset::open_keyframes,
        )),
        Ok(Source::StartEnd(folder)) => found.recordings.push(inspect_dataset(
            &folder,
            "start/end dataset",
            config,
            dataset::open_start_end,
        )),
        // A folder with one state only still has something to show.
        Err(CaptureError::OneState { path }) => {
            let mut bags = Vec::new();
            for state in 0..2 {
                let bag = path.join(format!("state{state}"));
                if Bag::is_at(&bag) {
                    bags.push(IndexedBag::read(&bag, state, stop)?);
                }
            }
            found.settled_bags(bags, config);
            found.problem = Some(CaptureError::OneState { path }.to_string());
        }
        Err(error) => return Err(error),
    }
    Ok((found, recorded))
}

/// Names the topics of a bag that may mark where one state ends.
fn marker_hint(index: &BagIndex) -> String {
    let markers: Vec<_> = index.markers.keys().map(String::as_str).collect();
    match markers.is_empty() {
        true => String::new(),
        false => format!(" (std_msgs topics that may be markers: {})", markers.join(", ")),
    }
}

fn inspect_topic(name: &str, index: &BagIndex) -> TopicInspection {
    let stat = &index.topics[name];
    let seconds = (stat.last_nanos - stat.first_nanos) as f64 * 1e-9;
    let mut details = Vec::new();
    if let Some(images) = index.images.get(name) {
        details.push(images.encoding.clone());
        details.extend(images.entries.first().and_then(|e| e.size).map(|(w, h)| format!("{w}x{h}")));
        details.push(format!("frame {}", images.frame));
    }
    if let (INFO_TYPE, Some(info)) =
        (stat.type_name.as_str(), index.infos.get(name).and_then(|i| i.distinct.first()))
    {
        details.push(format!("{}x{}", info.width, info.height));
        details.push(format!("fx {:.1}", info.k[0]));
        // Many drivers send zeros in place of no coefficients.
        let lens = if info.d.iter().all(|d| *d == 0.0) {
            "no distortion".into()
        } else {
            format!("{} {:?}", info.distortion_model, info.d)
        };
        details.push(lens);
    }
    if let Some(poses) = index.poses.get(name) {
        details.push(format!(
            "{} in {}",
            poses.child.as_deref().unwrap_or("a frame that is not named"),
            poses.parent
        ));
    }
    if stat.undecodable > 0 {
        details.push(format!("{} not decodable", stat.undecodable));
    }
    TopicInspection {
        name: name.to_owned(),
        type_name: stat.type_name.clone(),
        count: stat.count,
        // n messages have n - 1 intervals.
        rate_hz: (stat.count > 1 && seconds > 0.0).then(|| (stat.count - 1) as f64 / seconds),
        details: details.join(", "),
    }
}

fn inspect_dataset(
    folder: &Path,
    format: &str,
    config: &CaptureConfig,
    open: fn(&Path, &CaptureConfig, &Stop) -> Result<capture::Capture, CaptureError>,
) -> StateInspection {
    let mut seen =
        StateInspection { path: folder.to_owned(), format: format.to_owned(), ..StateInspection::default() };
    match open(folder, config, &Stop::never()) {
        Ok(capture) => {
            seen.views = capture.states.iter().map(Vec::len).sum();
            seen.chosen = capture.notes;
            seen.warnings = capture.warnings;
        }
        Err(error) => seen.problem = Some(error.to_string()),
    }
    seen
}

impl Inspection {
    /// Adds bags, and settles them together as a run does; returns them if all of them can be used.
    fn settled_bags(&mut self, bags: Vec<IndexedBag>, config: &CaptureConfig) -> Option<Vec<Recording>> {
        let mut recordings = Vec::new();
        for bag in bags {
            let mut seen = StateInspection::of_bag(&bag);
            match bag.unsettled(config) {
                Ok(recording) => recordings.push(recording),
                // An unusable recording is shown all the same, with the reason.
                Err(error) => seen.problem = Some(error.to_string()),
            }
            self.recordings.push(seen);
        }
        let settled = settle(&mut recordings, config, &Stop::never());
        let usable = self.recordings.iter_mut().filter(|seen| seen.problem.is_none());
        for (seen, recording) in usable.zip(&recordings) {
            match &settled {
                Ok(()) => seen.add_settled(recording, config),
                Err(error) => seen.problem = Some(error.to_string()),
            }
        }
        for seen in self.recordings.iter_mut().filter(|seen| seen.problem.is_some()) {
            if seen.topics.iter().any(|t| is_of_joints(&t.type_name)) {
                seen.motion = inspect_motion(&seen.path);
            }
        }
        self.is_reconstructible().then_some(recordings)
    }

    /// Whether `reconstruct` can use it as it is, or `diagnose` can because joints move in it.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        self.is_reconstructible() || self.is_diagnosable()
    }

    /// Whether nothing was found so far that keeps `reconstruct` from using it.
    #[must_use]
    pub fn is_reconstructible(&self) -> bool {
        self.problem.is_none() && self.recordings.iter().all(|r| r.problem.is_none())
    }

    fn is_diagnosable(&self) -> bool {
        !self.recordings.is_empty() && self.recordings.iter().all(|r| r.motion.is_usable)
    }

    /// Adds the warnings of a run that are not those of one recording.
    pub fn warn(&mut self, warnings: &[Note]) {
        let is_known = |w: &&Note| self.recordings.iter().any(|r| r.warnings.contains(w));
        self.warnings = warnings.iter().filter(|w| !is_known(w)).cloned().collect();
    }

    /// The inspection as text for a terminal.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut text = String::new();
        for recording in &self.recordings {
            recording.write(&mut text);
        }
        list(&mut text, "warnings about the images", &self.warnings);
        let mut problems: Vec<_> =
            self.recordings.iter().filter_map(|r| r.problem.as_ref()).chain(&self.problem).collect();
        problems.dedup();
        match problems.as_slice() {
            [] => text.push_str("usable: yes\n"),
            _ if self.is_diagnosable() => text.push_str("usable: yes, by diagnose\n"),
            problems => {
                text.push_str("usable: no\n");
                for problem in problems {
                    _ = writeln!(text, "  {}", printable(problem));
                }
            }
        }
        text
    }
}

impl StateInspection {
    /// The contents of a bag.
    fn of_bag(IndexedBag { bag, index, .. }: &IndexedBag) -> Self {
        Self {
            path: bag.path.clone(),
            format: bag.form(),
            span_secs: index.span_nanos().map(|(a, b)| (a as f64 * 1e-9, b as f64 * 1e-9)),
            topics: index.topics.keys().map(|name| inspect_topic(name, index)).collect(),
            transforms: index.tf.describe(),
            warnings: [bag.warnings.clone(), index.damage()].concat(),
            ..Self::default()
        }
    }

    /// Adds the views of a settled recording, and what is to be known about them.
    fn add_settled(&mut self, Recording { bag, views, .. }: &Recording, config: &CaptureConfig) {
        self.views = views.views.len();
        self.untracked = views.are_untracked();
        self.chosen = views.notes.clone();
        self.chosen.extend(board_note(bag, views, config));
        self.warnings.clone_from(&views.warnings);
    }

    fn write(&self, text: &mut String) {
        _ = writeln!(text, "{} ({})", printable(&self.path.display().to_string()), self.format);
        if let Some((first, last)) = self.span_secs {
            _ = writeln!(text, "  time: {:.3} s, from {first:.3} to {last:.3}", last - first);
        }
        if !self.topics.is_empty() {
            _ = writeln!(text, "  topics:");
            // Columns, unless a long name would push all others away.
            let width = self.topics.iter().map(|t| t.name.len()).max().unwrap_or(0).min(80);
            for t in self.topics.iter().take(SHOWN) {
                let rate = t.rate_hz.map_or(String::new(), |r| format!(" {r:.1} Hz"));
                let details = if t.details.is_empty() { String::new() } else { format!(" ({})", t.details) };
                _ = writeln!(
                    text,
                    "    {:width$} {:6}{rate} {}{}",
                    printable(&t.name),
                    t.count,
                    printable(&t.type_name),
                    printable(&details)
                );
            }
            more(text, self.topics.len());
        }
        list(text, "transforms", &self.transforms);
        list(text, "used", &self.chosen);
        list(text, "warnings", &self.warnings);
        list(text, "joints", &self.motion.joints);
        if self.untracked && self.problem.is_none() {
            _ = writeln!(text, "  RGB-D views: {}", self.views);
            _ = writeln!(
                text,
                "  camera poses: none recorded; the camera is tracked by what it sees (`artitwin track` \
                 shows how far)"
            );
        } else {
            _ = writeln!(text, "  posed RGB-D views: {}", self.views);
        }
    }
}

/// Adds a list with its title; nothing if it is empty.
fn list(text: &mut String, title: &str, lines: &[impl ToString]) {
    if lines.is_empty() {
        return;
    }
    _ = writeln!(text, "  {title}:");
    for line in lines.iter().take(SHOWN) {
        _ = writeln!(text, "    {}", printable(&line.to_string()));
    }
    more(text, lines.len());
}

/// Says how many lines of a long list are not shown.
fn more(text: &mut String, lines: usize) {
    if let Some(more) = lines.checked_sub(SHOWN).filter(|n| *n > 0) {
        _ = writeln!(text, "    and {more} more");
    }
}

/// Text from a file without control characters: a terminal would obey them.
#[must_use]
pub fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect()
}
