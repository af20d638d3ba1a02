//! Camera poses of recordings that have none: their views go through a tracker, some at a time.

use rayon::prelude::*;

use super::{
    bag::Bag,
    depth_noise::measured_noise,
    pixels::decode_views,
    upright::upright_of,
    views::{View, Views},
};
use crate::{
    capture::{
        CaptureConfig, CaptureError, NoiseConfig, Observation, RgbdFrame, Track, Tracker, Unaligned,
        align_tracks,
    },
    geometry::Pose,
    limits::{BYTES_PER_PIXEL, NAMED},
    note::{Note, NoteCode},
};

/// Memory of the views that are decoded at a time, bytes.
/// derived: 64 views of 640x480; the bag is read once for each such block
const BLOCK_BYTES: u64 = 64 * 640 * 480 * BYTES_PER_PIXEL;

/// The camera's way through a state.
pub(super) struct TrackedState {
    pub track: Track,
    /// Views that were looked at, by their numbers among those of the bag.
    pub views: Vec<usize>,
    /// What was found.
    pub notes: Vec<Note>,
    /// What was lost.
    pub warnings: Vec<Note>,
}

/// Tracks the camera through some views of a bag, in the order of time.
///
/// # Errors
/// Those of the decoding; [`CaptureError::NotTracked`] where no two views hang together.
pub(super) fn track(
    bag: &Bag,
    views: &Views,
    of_state: &[usize],
    config: &CaptureConfig,
    (state, seed): (usize, u64),
) -> Result<TrackedState, CaptureError> {
    // Masks are of the object; what stands around it shows the camera's motion, too.
    let unmasked = Views {
        views: views.views.iter().map(|v| View { mask: None, ..v.clone() }).collect(),
        ..views.clone()
    };
    let (_, width, height) = views.sizes(1);
    let of_view = (width * height) as u64 * BYTES_PER_PIXEL;
    let block = (BLOCK_BYTES / of_view.max(1)).max(1) as usize;
    let mut tracker = Tracker::new(seed ^ state as u64);
    let (mut seen, mut reasons, mut noise) = (Vec::new(), Vec::new(), None);
    for some in of_state.chunks(block) {
        // Views take the place of states: what is broken is left out, and the numbers say which.
        let chosen: Vec<(usize, usize)> = some.iter().map(|&v| (v, v)).collect();
        let frames = decode_views(bag, &unmasked, &chosen, config)?.frames;
        let noise: NoiseConfig = *noise.get_or_insert_with(|| noise_of(&frames, config));
        let observations: Vec<(usize, Observation)> =
            frames.into_par_iter().map(|(view, frame)| (view, Observation::of(frame, &noise))).collect();
        for (view, observation) in observations {
            seen.push(view);
            reasons.push(tracker.add(observation).err());
        }
    }
    let mut track = tracker.finish();
    if track.findings.tracked < 2 {
        return Err(CaptureError::NotTracked { state, views: seen.len() });
    }
    track.measured_up = views.accelerometer.as_ref().map(|a| track.up_of(a));
    let notes = vec![Note::new(NoteCode::CameraTracked, format!("state {state}: {}", track.findings))];
    let stretch = |[first, last]: &[usize; 2]| {
        let why = (*first..=*last).find_map(|v| reasons[v]).map_or(
            "no other view hangs together with them; move slower, and look back at what was seen",
            |why| why.reason(),
        );
        let stamp = |v: usize| crate::capture::stamp_secs(views.views[seen[v]].stamp_nanos);
        let text = format!(
            "state {state}: the camera was lost from {:.3} to {:.3} s ({} views), which are not used: {why}",
            stamp(*first),
            stamp(*last),
            last - first + 1
        );
        Note::new(NoteCode::ViewsLost, text)
    };
    let mut warnings: Vec<Note> = track.findings.lost.iter().take(NAMED).map(stretch).collect();
    if let Some(more) = track.findings.lost.len().checked_sub(NAMED).filter(|n| *n > 0) {
        let text = format!("state {state}: the camera was lost in {more} more stretches");
        warnings.push(Note::new(NoteCode::ViewsLost, text));
    }
    Ok(TrackedState { track, views: seen, notes, warnings })
}

/// The noise model of the settings, scaled to what the first frames show.
fn noise_of(frames: &[(usize, RgbdFrame)], config: &CaptureConfig) -> NoiseConfig {
    measured_noise(frames.iter().map(|(_, f)| f), config)
        .map_or(config.noise, |factor| config.noise.scaled(factor))
}

/// Motion from every state's map to the world in which the twin stands: state 0's, upright.
///
/// # Errors
/// [`CaptureError::StatesUnaligned`] where nothing stands still between states.
pub(super) fn worlds(
    tracked: &[TrackedState],
    seed: u64,
    notes: &mut Vec<Note>,
    warnings: &mut Vec<Note>,
) -> Result<Vec<Pose>, CaptureError> {
    let Some((first, others)) = tracked.split_first() else { return Ok(Vec::new()) };
    let world_from_map = upright_of(&first.track, notes, warnings).world_from_map;
    let mut worlds = vec![world_from_map];
    for (state, other) in (1..).zip(others) {
        let (map0_from_map, agreeing) =
            align_tracks(&first.track, &other.track, seed).map_err(|why| unaligned(state, why))?;
        notes.push(Note::new(
            NoteCode::CameraTracked,
            format!(
                "state {state}: brought into the world of state 0 by what stands still; {:.0} % of the \
                 surface that both show lies in one place",
                100.0 * agreeing
            ),
        ));
        worlds.push(world_from_map * map0_from_map);
    }
    Ok(worlds)
}

fn unaligned(state: usize, why: Unaligned) -> CaptureError {
    let reason = match why {
        Unaligned::NothingAlike => "nothing looks alike in both".to_owned(),
        Unaligned::Ambiguous { cells: [best, next] } => {
            format!("two motions explain about as much of what looks alike ({best} and {next} places)")
        }
    };
    CaptureError::StatesUnaligned { state, reason }
}
