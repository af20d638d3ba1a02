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
    probe::{Settled, settle},
    source::Source,
    topics::INFO_TYPE,
    views::Views,
};
use capture::{CaptureConfig, CaptureError, Split};
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
    let mut found = Inspection::default();
    match Source::of(sources) {
        Ok(Source::States(paths)) => {
            for (state, bag) in paths.iter().enumerate() {
                found.recordings.push(inspect_bag(bag, config, state)?.0);
            }
        }
        Ok(Source::Both(bag)) => {
            let (recording, index) = inspect_bag(&bag, config, 0)?;
            found.recordings.push(recording);
            // A bag with both states must be split; checks whether the settings say how.
            found.problem = split_problem(&bag, &index, config);
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
            for state in 0..2 {
                let bag = path.join(format!("state{state}"));
                if Bag::is_at(&bag) {
                    found.recordings.push(inspect_bag(&bag, config, state)?.0);
                }
            }
            found.problem = Some(CaptureError::OneState { path }.to_string());
        }
        Err(error) => return Err(error),
    }
    Ok(found)
}

fn split_problem(bag: &Path, index: &BagIndex, config: &CaptureConfig) -> Option<String> {
    let (first, last) = index.span_nanos()?;
    if let Some(topic) = &config.topics.marker {
        return Split::at_markers(topic, index.markers.get(topic).map_or(&[][..], Vec::as_slice))
            .err()
            .map(|e| e.to_string());
    }
    if !config.split_secs.is_empty() {
        return Split::at_times(&config.split_secs, first, last).err().map(|e| e.to_string());
    }
    let markers: Vec<_> = index.markers.keys().map(String::as_str).collect();
    let hint = if markers.is_empty() {
        String::new()
    } else {
        format!(" (std_msgs topics that may be markers: {})", markers.join(", "))
    };
    Some(format!("{}{hint}", CaptureError::OneState { path: bag.to_owned() }))
}

fn inspect_bag(
    path: &Path,
    config: &CaptureConfig,
    state: usize,
) -> Result<(StateInspection, BagIndex), CaptureError> {
    let bag = Bag::open(path)?;
    let index = BagIndex::read(&bag, &Stop::never())?;
    let mut seen =
        StateInspection { path: path.to_owned(), format: bag.form(), ..StateInspection::default() };
    seen.span_secs = index.span_nanos().map(|(a, b)| (a as f64 * 1e-9, b as f64 * 1e-9));
    seen.topics = index.topics.keys().map(|name| inspect_topic(name, &index)).collect();
    seen.transforms = index.tf.describe();
    match settled_views(&bag, &index, config, state) {
        Ok(views) => {
            seen.views = views.views.len();
            seen.untracked = views.are_untracked();
            let board = board_note(&bag, &views, config);
            seen.chosen = views.notes;
            seen.chosen.extend(board);
            seen.warnings = views.warnings;
        }
        // An unusable recording is shown all the same, with the reason.
        Err(error) => {
            // The losses `Views` would have reported.
            seen.warnings = [bag.warnings.clone(), index.damage()].concat();
            seen.problem = Some(error.to_string());
            if seen.topics.iter().any(|t| is_of_joints(&t.type_name)) {
                seen.motion = inspect_motion(path);
            }
        }
    }
    Ok((seen, index))
}

/// The views of a bag, as a run would have them.
fn settled_views(
    bag: &Bag,
    index: &BagIndex,
    config: &CaptureConfig,
    state: usize,
) -> Result<Views, CaptureError> {
    let mut views = Views::find(bag, index, config, state)?;
    settle(&mut [Settled { bag, views: &mut views, state }], config, &Stop::never())?;
    Ok(views)
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
        let problems: Vec<_> =
            self.recordings.iter().filter_map(|r| r.problem.as_ref()).chain(&self.problem).collect();
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
