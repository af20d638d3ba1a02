//! Reads an RGB-D recording of an object at rest for a diagnosis: frames, the camera's velocity, joint
//! positions.

use std::{collections::BTreeMap, path::Path, slice};

use super::{
    probe::settle,
    read_joint_log,
    recording::IndexedBag,
    ros2msg::{JointState, definitions::RosMessage as _},
    views::Views,
};
use capture::{CaptureConfig, CaptureError, RgbdFrame, TrackCamera};
use common::note::{Note, NoteCode};
use common::stop::Stop;
use gap::{camera::record::frames::FrameRun, record::tracks::Streams};
use numeric::statistics::median;

/// The camera's velocity comes from its poses this long before and after a frame, nanoseconds.
const VELOCITY_NANOS: i64 = 1_000_000;

/// Reads a recording (rosbag2 folder or `.mcap` file) as a reconstruction does, with masks and with the depth
/// as measured; the depth noise is that of the settings. Losses of frames are added to `warnings`; those of
/// joint positions are returned beside the result.
///
/// # Errors
/// [`CaptureError`] where the recording cannot be used.
pub fn read_frame_run(
    path: &Path,
    config: &CaptureConfig,
    warnings: &mut Vec<Note>,
    stop: &Stop,
) -> Result<(FrameRun, Vec<Note>), CaptureError> {
    config.check()?;
    let bag = IndexedBag::read(path, 0, stop)?;
    let has_positions = bag.index.summaries().iter().any(|t| t.type_name == JointState::TYPE);
    // Frames are compared with a twin in the world of the recorded poses.
    let config = &CaptureConfig { tracking: TrackCamera::Never, ..config.clone() };
    let mut recording = bag.unsettled(config)?;
    settle(slice::from_mut(&mut recording), config, stop)?;
    let views = &recording.views;
    let chosen: Vec<(usize, usize)> =
        recording.spread(&recording.all(), config).into_iter().map(|v| (0, v)).collect();
    config.check_memory(&[views.sizes(chosen.len())])?;
    let decoded = recording.decode(&chosen, config, stop)?;
    warnings.extend(views.warnings.iter().cloned());
    if let Some(first) = decoded.lost.first() {
        warnings.push(Note::new(
            NoteCode::FramesBroken,
            format!(
                "{}: {} frames are broken and not used (first: {first})",
                path.display(),
                decoded.lost.len()
            ),
        ));
    }
    let frames: Vec<RgbdFrame> = decoded.frames.into_iter().map(|(_, f)| f).collect();
    let with_depth = frames.iter().any(|f| f.depth_m.iter().any(|d| *d > 0.0));
    if !with_depth {
        return Err(CaptureError::NoDepth {
            state: 0,
            frames: frames.len(),
            min_m: config.depth_min_m,
            max_m: config.depth_max_m,
        });
    }
    let velocities: Option<Vec<_>> = frames.iter().map(|f| velocity(views, f, config)).collect();
    let name =
        path.file_stem().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned());
    let mut of_positions = Vec::new();
    let run = FrameRun {
        name,
        frames,
        velocities: velocities.unwrap_or_default(),
        positions: if has_positions { positions(path, &mut of_positions) } else { BTreeMap::new() },
        noise: config.noise,
    };
    Ok((run, of_positions))
}

/// Velocity of the camera in its own frame at a frame's stamp.
fn velocity(views: &Views, frame: &RgbdFrame, config: &CaptureConfig) -> Option<[nalgebra::Vector3<f64>; 2]> {
    let at = |nanos: i64| views.pose_at(nanos, config);
    let here = (0, at(frame.stamp_nanos)?);
    // The first and the last frame may have poses on one side only.
    let before = at(frame.stamp_nanos - VELOCITY_NANOS).map_or(here, |p| (-VELOCITY_NANOS, p));
    let after = at(frame.stamp_nanos + VELOCITY_NANOS).map_or(here, |p| (VELOCITY_NANOS, p));
    let seconds = (after.0 - before.0) as f64 * 1e-9;
    let step = before.1.inverse() * after.1;
    (seconds > 0.0).then(|| [step.translation.vector / seconds, step.rotation.scaled_axis() / seconds])
}

/// Median joint positions of a recording with joint states.
fn positions(path: &Path, warnings: &mut Vec<Note>) -> BTreeMap<String, f64> {
    let recording = match read_joint_log(path, &Streams::default()) {
        Ok(recording) => recording,
        Err(error) => {
            warnings.push(Note::new(NoteCode::PositionsUnreadable, error.to_string()));
            return BTreeMap::new();
        }
    };
    // The object is at rest, so one value stands for all, and the median ignores single wrong readings.
    let middle = |v: Vec<f64>| median(v.into_iter().filter(|x| x.is_finite()).collect());
    recording.joints.into_iter().filter_map(|j| Some((j.name, middle(j.position)?))).collect()
}
