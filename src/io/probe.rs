//! What a few images of recordings say about their poses, depth and masks, before all of them are used.
//!
//! The first reading of a bag chooses by names and stamps. Here a few views of all states are decoded:
//! motions between them by the images are compared with those of each source of poses, which shows whose
//! poses these are, how that frame stands to the camera, and in what unit depth is.

use super::{
    pixels::decode_views,
    pose_candidate::PoseCandidate,
    poses::{Certainty, PoseSource, poses_unused},
    recording::{Recording, unmasked},
    views::{View, Views},
};
use capture::{
    CaptureConfig, CaptureError, MotionPair, Mounting, NoiseConfig, Observation, RgbdFrame, TrackCamera,
    seen_motion,
};
use common::ahead::Ahead;
use common::note::{Note, NoteCode};
use common::stop::Stop;
use geometry::Pose;
use numeric::{random::stage_rng, statistics::median};

/// Number of places in the time of a recording that are looked at, each with two views.
/// chosen: half of the motions may fail and four are left
const PLACES: usize = 6;
/// Time between the two views of a place, nanoseconds.
/// chosen: a hand moves a camera by 5 to 10 cm, and nearly all of the image is still in view
const APART_NANOS: i64 = 300_000_000;
/// Views up to this many apart, of those looked at, are compared.
const REACH: usize = 3;
/// Share of the motions that must agree with poses that are the camera's by their names.
/// chosen: a majority, as for all frames later
const NAMED_SHARE: f64 = 0.5;
/// The same for poses that are taken for the camera's. chosen: a clear majority
const ASSUMED_SHARE: f64 = 0.7;
/// Lengths of poses and of depth that differ by less, as a ratio less one, are left to the calibration of the
/// sensor. chosen: far beyond the scale error of a sensor, below the ratio of any two units
const SAME_LENGTH: f64 = 0.2;
/// Units of depth in use, meters.
/// measured: data sheets of the D405, of structured light, of TUM's recordings, of the L515, ...
const UNITS_M: [f64; 7] = [1e-4, 1.25e-4, 2e-4, 2.5e-4, 5e-4, 1e-2, 1.0];
/// Millimeters in a meter. derived: the unit of poses that are not in meters
const MILLIMETERS: f64 = 1000.0;
/// Largest relative difference between the ratio of lengths and that of units. chosen: scale errors of poses
const UNIT_TOLERANCE: f64 = 0.1;
/// Median depth of numbers that cannot be meters. chosen: beyond the reach of any camera indoors
const NO_METERS: f64 = 50.0;
/// Largest share of pixels that differ between views of a camera that stands still.
/// chosen: above what noise changes, and far below what another place of the camera does
const STANDS_SHARE: f64 = 0.1;
/// Difference of color, of 255, and of depth, share, that noise does not make. chosen: four deviations
const OTHER_COLOR: u8 = 40;
const OTHER_DEPTH_SHARE: f32 = 0.03;
/// Masks that cover a larger share of most images are no masks of an object, nor are those whose pixels
/// hardly ever have depth. chosen: what fills the image shows nothing beside it
const MOST_COVERED: f64 = 0.95;
const LEAST_READ: f64 = 0.05;

/// Poses are not of the camera's frame if that is turned or off by more, radians and meters.
/// derived: quarter turns are more, and what is less has no arm
const ELSEWHERE_RAD: f64 = 0.1;
const ELSEWHERE_M: f64 = 1e-6;

/// Decoded views of a recording.
struct Looked {
    /// Indices into all views, rising.
    views: Vec<usize>,
    frames: Vec<RgbdFrame>,
}

/// Settles masks, poses and the unit of depth of recordings of one camera. All of them get the poses of one
/// source, or all are left to be tracked: recorded poses do not relate to another state's map.
///
/// # Errors
/// Those of the decoding; [`CaptureError::NoPoses`] where poses must be used and are not the camera's.
pub fn settle(recordings: &mut [Recording], config: &CaptureConfig, stop: &Stop) -> Result<(), CaptureError> {
    let mut looked = Vec::new();
    for recording in recordings.iter_mut() {
        let mut frames = look(recording, config, stop)?;
        settle_masks(recording, &mut frames.frames);
        looked.push(frames);
    }
    settle_number_type(recordings, &mut looked);
    let found = settle_poses(recordings, &looked, config, stop)?;
    for (recording, name) in recordings.iter_mut().zip(found) {
        recording.views.tell_what_is_used(name.as_deref());
    }
    Ok(())
}

/// Decodes views at some places of a recording, at any depth.
fn look(recording: &Recording, config: &CaptureConfig, stop: &Stop) -> Result<Looked, CaptureError> {
    let wanted = places(&recording.views.views);
    let chosen: Vec<(usize, usize)> = wanted.iter().map(|&v| (v, v)).collect();
    let any_depth = CaptureConfig { depth_min_m: 0.0, depth_max_m: f64::from(f32::MAX), ..config.clone() };
    let found = decode_views(&recording.bag, &recording.views, &chosen, &any_depth, stop)?.frames;
    let (views, frames) = found.into_iter().unzip();
    Ok(Looked { views, frames })
}

/// The views that are looked at, by index: evenly over time, and for each one soon after it.
fn places(all: &[View]) -> Vec<usize> {
    let mut wanted = Vec::new();
    for k in 0..PLACES.min(all.len()) {
        let at = k * all.len() / PLACES.min(all.len());
        let until = all[at].stamp_nanos.saturating_add(APART_NANOS);
        let next = all.partition_point(|v| v.stamp_nanos < until).max(at + 1);
        wanted.extend([at, next.min(all.len() - 1)]);
    }
    wanted.extend(all.len().checked_sub(1));
    wanted.sort_unstable();
    wanted.dedup();
    wanted
}

/// Leaves out masks that show no object.
fn settle_masks(recording: &mut Recording, frames: &mut [RgbdFrame]) {
    let Some(topic) = recording.views.topics.mask.clone() else { return };
    let mut covered = Vec::new();
    let mut read = Vec::new();
    for frame in frames.iter() {
        let Some(mask) = &frame.mask else { continue };
        let count = mask.iter().filter(|m| **m).count();
        covered.push(count as f64 / mask.len().max(1) as f64);
        if count > 0 {
            let depth = mask.iter().zip(&frame.depth_m).filter(|(m, d)| **m && **d > 0.0).count();
            read.push(depth as f64 / count as f64);
        }
    }
    frames.iter_mut().for_each(|f| f.mask = None);
    let why = match (median(covered), median(read)) {
        (None, _) => return,
        (Some(_), None) => "they are empty".to_owned(),
        (Some(covered), _) if covered > MOST_COVERED => {
            format!("they cover {:.0} % of the images", 100.0 * covered)
        }
        (_, Some(read)) if read < LEAST_READ => "what they cover has no depth".to_owned(),
        _ => return,
    };
    let views = &mut recording.views;
    *views = unmasked(views);
    views.warnings.push(Note::new(
        NoteCode::MasksUnlike,
        format!(
            "state {}: images of {topic} are no masks of an object ({why}) and are not used; name the \
             topic of the masks with `--topic mask=TOPIC`",
            recording.state
        ),
    ));
}

/// Finds millimeters in floating point, which should be meters, by their size.
fn settle_number_type(recordings: &mut [Recording], looked: &mut [Looked]) {
    for (recording, looked) in recordings.iter_mut().zip(looked) {
        if recording.views.has_unknown_unit || median_depth(&looked.frames).is_none_or(|d| d < NO_METERS) {
            continue;
        }
        scale_depth(&mut recording.views, 0.001);
        looked.frames.iter_mut().flat_map(|f| &mut f.depth_m).for_each(|d| *d *= 0.001);
        let topic = &recording.views.topics.depth;
        let text = format!("{topic}: numbers beyond any reach in meters are taken as millimeters");
        recording.views.warnings.push(Note::new(NoteCode::DepthUnit, text));
    }
}

fn scale_depth(views: &mut Views, factor: f64) {
    views.depth_factor *= factor;
}

fn median_depth(frames: &[RgbdFrame]) -> Option<f64> {
    let depths = frames.iter().flat_map(|f| f.depth_m.iter().step_by(97)).filter(|d| **d > 0.0);
    median(depths.map(|d| f64::from(*d)).collect())
}

/// A motion between two looked at views of a recording, by the images.
struct SeenMotion {
    recording: usize,
    /// Indices into all of its views.
    views: [usize; 2],
    motion: Pose,
    depth: f64,
}

/// Chooses among the sources of poses; returns the name of the one that is used, by recording.
fn settle_poses(
    recordings: &mut [Recording],
    looked: &[Looked],
    config: &CaptureConfig,
    stop: &Stop,
) -> Result<Vec<Option<String>>, CaptureError> {
    let mut names: Vec<Option<String>> = vec![None; recordings.len()];
    if recordings.iter().all(|r| r.views.candidates.is_empty()) {
        return Ok(names);
    }
    match_candidates(recordings);
    let seen = seen_motions(looked, stop)?;
    let stands = looked.iter().all(stands_still);
    let count = recordings.iter().map(|r| r.views.candidates.len()).min().unwrap_or(0);
    let mut chosen: Option<(usize, Option<Mounting>)> = None;
    let mut rivals: Vec<(usize, Mounting)> = Vec::new();
    for c in 0..count {
        let candidate = &recordings[0].views.candidates[c];
        if candidate.source.certainty == Certainty::Stands {
            if stands && chosen.is_none() {
                chosen = Some((c, None));
            }
            continue;
        }
        let pairs = motion_pairs(&seen, recordings, c);
        let own = Mounting::of_camera(&pairs);
        let named = candidate.source.certainty == Certainty::Named;
        if named && own.as_ref().is_some_and(|m| m.share >= NAMED_SHARE) {
            chosen = Some((c, own));
            break;
        }
        rivals.extend(Mounting::best(&pairs).filter(|m| m.share >= ASSUMED_SHARE).map(|m| (c, m)));
        // Too little moves to tell, or nothing agrees: names have to do, and all frames are compared later.
        if named && chosen.is_none() {
            chosen = Some((c, None));
        }
    }
    if chosen.as_ref().is_none_or(|(_, m)| m.is_none()) {
        // Of equals the first.
        let best = rivals.into_iter().rev().max_by(|a, b| a.1.share.total_cmp(&b.1.share));
        chosen = best.map(|(c, m)| (c, Some(m))).or(chosen);
    }
    let Some((c, mut mounting)) = chosen else {
        leave_out(recordings, config, "by what the images show they are not the camera's")?;
        return Ok(names);
    };
    if let Some(found) = mounting {
        let pairs = motion_pairs(&seen, recordings, c);
        let must = config.tracking == TrackCamera::Never || config.asks_for_poses();
        match settle_lengths(recordings, looked, &found) {
            Some(scale) if is_elsewhere(&found) => {
                let mut known = found.at_scale(&pairs, scale).unwrap_or(found);
                if scale == MILLIMETERS {
                    known.posed_from_camera.translation.vector /= MILLIMETERS;
                }
                mounting = Some(known);
            }
            None if !must => {
                let why = format!(
                    "their lengths are {:.3} times those of depth, which is the ratio of no two units",
                    found.scale
                );
                leave_out(recordings, config, &why)?;
                return Ok(names);
            }
            _ => {}
        }
    }
    for (recording, name) in recordings.iter_mut().zip(&mut names) {
        let views = &mut recording.views;
        views.take_poses(c, recording.state);
        let candidate = &views.candidates[c];
        *name = Some(candidate.name.clone());
        let notes = told(candidate, mounting.as_ref());
        if let Some(mounting) = mounting.as_ref().filter(|m| is_elsewhere(m)) {
            views.mount(&mounting.posed_from_camera);
        }
        views.warnings.extend(notes);
    }
    Ok(names)
}

/// Brings the sources of all recordings into one order, without those that are not in all of them.
fn match_candidates(recordings: &mut [Recording]) {
    let Some((first, others)) = recordings.split_first_mut() else { return };
    let has = |r: &Recording, name: &str| r.views.candidates.iter().any(|c| c.name == name);
    let names = first.views.candidates.iter().map(|c| c.name.clone());
    let common: Vec<String> = names.filter(|name| others.iter().all(|r| has(r, name))).collect();
    for recording in std::iter::once(first).chain(others) {
        let candidates = &mut recording.views.candidates;
        if common.is_empty() {
            // Poses in different worlds are refused later, with the names of both.
            candidates.truncate(1);
            continue;
        }
        let place = |c: &PoseCandidate| common.iter().position(|name| *name == c.name);
        candidates.retain(|c| place(c).is_some());
        candidates.sort_by_key(|c| place(c));
    }
}

/// Whether poses are of another frame than the camera's.
fn is_elsewhere(mounting: &Mounting) -> bool {
    let camera = &mounting.posed_from_camera;
    camera.rotation.angle() > ELSEWHERE_RAD || camera.translation.vector.norm() > ELSEWHERE_M
}

/// What is to be known about chosen poses.
fn told(candidate: &PoseCandidate, mounting: Option<&Mounting>) -> Option<Note> {
    if candidate.source.certainty == Certainty::Stands {
        let PoseSource { world, origin, .. } = &candidate.source;
        let from = if origin == "/tf" { "/tf_static" } else { origin };
        let text = format!(
            "the camera stands still: its pose in `{world}` is that of {from}; what it does not see from \
             there stays unknown"
        );
        return Some(Note::new(NoteCode::CameraStands, text));
    }
    let turned = mounting.filter(|m| is_elsewhere(m))?;
    let [x, y, z] = turned.posed_from_camera.translation.vector.into();
    let text = format!(
        "{} are not of the camera's optical frame, but of one such as its body: {:.0} % of the motions \
         between images agree with that; the camera was taken to be at ({:.0}, {:.0}, {:.0}) mm in it; \
         record /tf_static from that frame to the optical frame, or poses of the optical frame",
        candidate.name,
        100.0 * turned.share,
        1e3 * x,
        1e3 * y,
        1e3 * z
    );
    Some(Note::new(NoteCode::PosesTurned, text))
}

/// Leaves the camera to be tracked.
///
/// # Errors
/// Where the settings forbid that.
fn leave_out(recordings: &mut [Recording], config: &CaptureConfig, why: &str) -> Result<(), CaptureError> {
    for recording in recordings {
        let candidates = &recording.views.candidates;
        let names: Vec<&str> = candidates.iter().map(|c| c.name.as_str()).collect();
        let all_stand = candidates.iter().all(|c| c.source.certainty == Certainty::Stands);
        let text = format!("{}: {why}", names.join("; "));
        if config.tracking == TrackCamera::Never {
            return Err(match candidates.first().filter(|_| all_stand).map(|c| &c.source) {
                Some(s) => CaptureError::StaticCamera { frame: s.optical.clone(), root: s.world.clone() },
                None => CaptureError::NoPoses {
                    state: recording.state,
                    frames: recording.views.views.len(),
                    first: text,
                },
            });
        }
        // A static transform to a camera in the hand is no attempt at poses.
        if !all_stand {
            recording.views.warnings.push(poses_unused(&text));
        }
    }
    Ok(())
}

/// Settles the unit of depth, or of poses, where their lengths contradict each other; returns the ratio of
/// lengths of the poses to those of depth as it was decoded, `None` where it is that of no units.
fn settle_lengths(recordings: &mut [Recording], looked: &[Looked], mounting: &Mounting) -> Option<f64> {
    let scale = mounting.scale;
    if (scale - 1.0).abs() <= SAME_LENGTH {
        return Some(1.0);
    }
    let depths: Vec<f64> = looked.iter().filter_map(|l| median_depth(&l.frames)).collect();
    let depth_m = median(depths).unwrap_or(1.0);
    let is_near = |expected: f64| (scale / expected - 1.0).abs() <= UNIT_TOLERANCE;
    let unit = UNITS_M.into_iter().find(|unit| is_near(unit / 0.001));
    let says = format!("{} motions between images, {:.0} % agree", mounting.motions, 100.0 * mounting.share);
    if let Some(unit_m) = unit.filter(|_| recordings.iter().all(|r| r.views.has_unknown_unit)) {
        for recording in recordings {
            scale_depth(&mut recording.views, unit_m / 0.001);
            let topic = &recording.views.topics.depth;
            let text = format!(
                "{topic}: a unit is {} mm by the lengths of the camera poses, not 1 mm ({says}); say so \
                 with `--set capture.depth_unit_m={unit_m}`",
                unit_m * 1e3
            );
            recording.views.warnings.push(Note::new(NoteCode::DepthUnit, text));
        }
        return Some(unit_m / 0.001);
    }
    // Poses in millimeters.
    if is_near(MILLIMETERS) && depth_m < NO_METERS {
        for recording in recordings {
            for pose in recording.views.candidates.iter_mut().flat_map(|c| &mut c.poses).flatten() {
                pose.translation.vector *= 0.001;
            }
            let text =
                format!("camera poses are in millimeters by the lengths of depth, not in meters ({says})");
            recording.views.warnings.push(Note::new(NoteCode::DepthUnit, text));
        }
        return Some(MILLIMETERS);
    }
    None
}

/// Motions between looked at views that are near in time.
fn seen_motions(looked: &[Looked], stop: &Stop) -> Result<Vec<SeenMotion>, CaptureError> {
    let noise = NoiseConfig::default();
    let mut seen = Vec::new();
    for (recording, looked) in looked.iter().enumerate() {
        // At the depth for which noise is expected, whatever the unit.
        let unit = median_depth(&looked.frames).unwrap_or(1.0);
        let mut observed = Vec::new();
        for frame in &looked.frames {
            stop.check()?;
            let mut frame = frame.clone();
            frame.depth_m.iter_mut().for_each(|d| *d /= unit as f32);
            observed.push(Observation::of_frame(frame, &noise, &Ahead::default()));
        }
        for i in 0..observed.len() {
            for j in i + 1..(i + 1 + REACH).min(observed.len()) {
                stop.check()?;
                let mut rng = stage_rng(0, "probe", (i * observed.len() + j) as u64);
                let Some((mut motion, _)) = seen_motion(&observed[i], &observed[j], &mut rng) else {
                    continue;
                };
                motion.translation.vector *= unit;
                seen.push(SeenMotion {
                    recording,
                    views: [looked.views[i], looked.views[j]],
                    motion,
                    depth: unit,
                });
            }
        }
    }
    Ok(seen)
}

/// The motions by images beside those of a source of poses.
fn motion_pairs(seen: &[SeenMotion], recordings: &[Recording], candidate: usize) -> Vec<MotionPair> {
    seen.iter().filter_map(|s| motion_pair(s, recordings, candidate)).collect()
}

fn motion_pair(seen: &SeenMotion, recordings: &[Recording], candidate: usize) -> Option<MotionPair> {
    let poses = &recordings[seen.recording].views.candidates[candidate].poses;
    let [first, second] = seen.views.map(|v| poses[v]);
    Some(MotionPair { by_images: seen.motion, by_poses: second?.inverse() * first?, depth: seen.depth })
}

/// Whether all views of a recording show one picture.
fn stands_still(looked: &Looked) -> bool {
    let Some((first, others)) = looked.frames.split_first() else { return false };
    others.iter().all(|other| other_share(first, other) <= STANDS_SHARE)
}

/// Share of the pixels that differ between two views.
fn other_share(a: &RgbdFrame, b: &RgbdFrame) -> f64 {
    let mut all = 0;
    let mut other = 0;
    for p in 0..a.rgb.len().min(b.rgb.len()) {
        let colors = a.rgb[p].iter().zip(&b.rgb[p]).any(|(x, y)| x.abs_diff(*y) > OTHER_COLOR);
        let depths = [a.depth_m[p], b.depth_m[p]];
        let read = depths.iter().all(|d| *d > 0.0);
        all += 1;
        other += usize::from(colors || (read && (depths[0] / depths[1] - 1.0).abs() > OTHER_DEPTH_SHARE));
    }
    f64::from(other as u32) / f64::from(all.max(1))
}
