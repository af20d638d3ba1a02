//! Reads the path of a tag, a tracker or a gripper: from a bag, or from a text with a sample a line.
//!
//! A line of text is `x y z` or `x y z qx qy qz qw`, meters, with or without a stamp in seconds in front;
//! commas or blanks separate numbers, `#` starts a comment, and one line of names may come first.

use std::path::Path;

use nalgebra::UnitQuaternion;

use super::{bag::Bag, bag_index::BagIndex, ros2msg};
use capture::CaptureError;
use common::{
    files,
    limits::{NAMED, TRACK},
    note::{Note, NoteCode},
    stop::Stop,
};
use gap::track::trace::PointTrack;
use geometry::Pose;

/// Numbers of a line of positions and of poses, without a stamp.
const POSITION: usize = 3;
const POSE: usize = 7;
/// The same with a stamp.
const STAMPED_POSITION: usize = 1 + POSITION;
const STAMPED_POSE: usize = 1 + POSE;
/// Longest gap over which transforms above a moving frame are interpolated, nanoseconds: any.
const ANY_GAP_NANOS: i64 = i64::MAX;

/// Reads a track, of a topic or a frame of /tf where one is named; notes are on samples that are not used.
///
/// # Errors
/// [`CaptureError`] where the file cannot be read, is no track, or holds several and none is named.
pub fn read_track(path: &Path, named: Option<&str>) -> Result<(PointTrack, Vec<Note>), CaptureError> {
    if Bag::is_at(path) {
        return track_of_bag(path, named);
    }
    let text = files::read_text(path, TRACK)
        .map_err(|source| CaptureError::Read { path: path.to_owned(), source })?;
    track_of_text(&track_name(path), &text).map_err(|reason| refused(path, reason))
}

fn refused(path: &Path, reason: String) -> CaptureError {
    CaptureError::NotATrack { path: path.to_owned(), reason }
}

/// The last part of a path, without the ending of a file.
fn track_name(path: &Path) -> String {
    let name = if path.is_dir() { path.file_name() } else { path.file_stem() };
    name.map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned())
}

/// The track of a text.
///
/// # Errors
/// A sentence on the first line that cannot be read.
pub fn track_of_text(name: &str, text: &str) -> Result<(PointTrack, Vec<Note>), String> {
    let mut trace = PointTrack { name: name.to_owned(), ..PointTrack::default() };
    let mut columns = None;
    let mut broken = 0;
    let mut backward = 0;
    for (number, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default();
        let words: Vec<&str> = line
            .split(|c: char| c == ',' || c == ';' || c.is_whitespace())
            .filter(|w| !w.is_empty())
            .collect();
        if words.is_empty() {
            continue;
        }
        let numbers: Result<Vec<f64>, _> = words.iter().map(|w| w.parse::<f64>()).collect();
        let Ok(numbers) = numbers else {
            // A line of names comes first.
            if columns.is_none() && words.iter().all(|w| w.parse::<f64>().is_err()) {
                columns = Some(0);
                continue;
            }
            return Err(format!("line {}: `{}` holds no numbers", number + 1, io_line(line)));
        };
        let wanted = *columns.get_or_insert(numbers.len());
        if wanted == 0 {
            columns = Some(numbers.len());
        } else if wanted != numbers.len() {
            return Err(format!("line {}: {} numbers, {wanted} before", number + 1, numbers.len()));
        }
        let has_stamp = match numbers.len() {
            POSITION | POSE => 0,
            STAMPED_POSITION | STAMPED_POSE => 1,
            other => {
                return Err(format!(
                    "line {}: {other} numbers; give `x y z` or `x y z qx qy qz qw`, with or without a stamp \
                     in front",
                    number + 1
                ));
            }
        };
        match sample_of(&numbers[has_stamp..]) {
            Some(_) if has_stamp == 1 && !trace.time_s.last().is_none_or(|last| numbers[0] > *last) => {
                backward += 1;
            }
            Some(pose) if has_stamp == 0 || numbers[0].is_finite() => {
                trace.time_s.extend(numbers[..has_stamp].iter().copied());
                trace.position.push(pose.translation.vector);
                if numbers.len() >= POSE {
                    trace.rotation.push(pose.rotation);
                }
            }
            _ => broken += 1,
        }
    }
    if trace.position.is_empty() {
        return Err("it holds no samples".to_owned());
    }
    Ok((trace, notes_on_losses(name, broken, backward)))
}

/// A line shortened for a message.
fn io_line(line: &str) -> String {
    line.chars().take(40).collect()
}

/// The pose of a line; without a rotation for a position. `None` where it is none.
fn sample_of(numbers: &[f64]) -> Option<Pose> {
    let rotation = match *numbers {
        [_, _, _, x, y, z, w] => ros2msg::Quaternion { x, y, z, w },
        _ => ros2msg::Quaternion::default(),
    };
    let translation = ros2msg::Vector3 { x: numbers[0], y: numbers[1], z: numbers[2] };
    ros2msg::Transform { translation, rotation }.checked()
}

fn notes_on_losses(name: &str, broken: usize, backward: usize) -> Vec<Note> {
    let mut notes = Vec::new();
    if broken > 0 {
        let text = format!("{name}: {broken} samples hold NaN or no unit quaternion and are not used");
        notes.push(Note::new(NoteCode::TransformsInvalid, text));
    }
    if backward > 0 {
        let text = format!("{name}: {backward} samples have stamps that repeat or run backward");
        notes.push(Note::new(NoteCode::SamplesBackward, text));
    }
    notes
}

/// The track of a bag: of the only pose topic or frame of /tf that moves, or of the named one.
fn track_of_bag(path: &Path, named: Option<&str>) -> Result<(PointTrack, Vec<Note>), CaptureError> {
    let bag = Bag::open(path)?;
    let index = BagIndex::read(&bag, &Stop::never())?;
    let mut notes = bag.warnings.clone();
    notes.extend(index.damage());
    let topics: Vec<&str> =
        index.poses.iter().filter(|(_, p)| p.moves()).map(|(name, _)| name.as_str()).collect();
    let frames: Vec<&str> = index.tf.moving_ends();
    let mut all = topics.clone();
    // A topic of poses is what somebody recorded for this; /tf holds the whole robot.
    if all.is_empty() || named.is_some() {
        all.extend(&frames);
    }
    let listed = all.iter().take(NAMED).copied().collect::<Vec<_>>().join(", ");
    let chosen = match (named, &all[..]) {
        (Some(name), _) if index.poses.contains_key(name) || index.tf.has_parent(name) => name.to_owned(),
        (Some(name), _) => {
            return Err(refused(path, format!("it has no poses of `{name}`; what moves in it: {listed}")));
        }
        (None, [one]) => (*one).to_owned(),
        (None, []) => {
            return Err(refused(path, "no topic of poses and no frame of /tf in it moves".to_owned()));
        }
        (None, _) => {
            return Err(refused(path, format!("several things move in it; name one with --of: {listed}")));
        }
    };
    let (samples, invalid): (Vec<(i64, Pose)>, usize) = match index.poses.get(&chosen) {
        Some(topic) => (topic.samples.iter().map(|(t, p)| (*t, *p)).collect(), topic.invalid),
        None => (frame_samples(&index, &chosen), index.tf.invalid),
    };
    if samples.is_empty() {
        return Err(refused(path, format!("`{chosen}` has no usable poses")));
    }
    notes.extend(notes_on_losses(&track_name(path), invalid, 0));
    let first = samples[0].0;
    let trace = PointTrack {
        name: track_name(path),
        time_s: samples.iter().map(|(t, _)| (t - first) as f64 * 1e-9).collect(),
        position: samples.iter().map(|(_, p): &(i64, Pose)| p.translation.vector).collect(),
        rotation: samples.iter().map(|(_, p)| p.rotation).collect::<Vec<UnitQuaternion<f64>>>(),
    };
    Ok((trace, notes))
}

/// Poses of a frame in the root of its chain, at its own stamps.
fn frame_samples(index: &BagIndex, frame: &str) -> Vec<(i64, Pose)> {
    let root = index.tf.chain_of_frame(frame).root;
    let stamps = index.tf.stamps_of(frame);
    let posed = |t: i64| Some((t, index.tf.lookup(&root, frame, t, ANY_GAP_NANOS).ok()?));
    stamps.into_iter().filter_map(posed).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn all_forms_of_lines_are_read() {
        for (text, stamps, rotations) in [
            ("1 2 3\n1.5 2 3\n", 0, 0),
            ("# a comment\nx,y,z\n1, 2, 3\n\n1.5,2,3 # end\n", 0, 0),
            ("0.1 1 2 3\n0.2 1.5 2 3", 2, 0),
            ("1 2 3 0 0 0 1\n1.5 2 3 0 0 0 1", 0, 2),
            ("t x y z qx qy qz qw\n7 1 2 3 0 0 0 1\n8 1.5 2 3 0 0 0 1", 2, 2),
        ] {
            let (trace, notes) = track_of_text("a", text).unwrap();
            assert_eq!(trace.position, [Vector3::new(1.0, 2.0, 3.0), Vector3::new(1.5, 2.0, 3.0)], "{text}");
            assert_eq!((trace.time_s.len(), trace.rotation.len(), notes.len()), (stamps, rotations, 0));
        }
    }

    #[test]
    fn what_is_no_sample_is_counted_or_refused_with_its_line() {
        let (trace, notes) = track_of_text("a", "1 1 2 3\n1 1 2 3\n2 nan 2 3\n3 1 2 3").unwrap();
        assert_eq!((trace.position.len(), notes.len()), (2, 2));
        for (text, said) in [
            ("", "no samples"),
            ("1 2\n", "line 1: 2 numbers"),
            ("1 2 3\n1 2 3 4\n", "line 2: 4 numbers, 3 before"),
            ("1 2 3\n1 two 3\n", "line 2"),
        ] {
            let reason = track_of_text("a", text).unwrap_err();
            assert!(reason.contains(said), "{reason}");
        }
    }
}
