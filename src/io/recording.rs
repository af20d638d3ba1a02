//! Recordings opened: from paths to a [`Capture`] whose frames carry object masks.

use std::{
    fmt::Display,
    path::{Path, PathBuf},
};

use rayon::prelude::*;

use super::{
    bag::Bag,
    bag_index::BagIndex,
    dataset,
    depth_noise::measured_noise,
    pixels::{Decoded, decode_views},
    posed_states::{give_poses, posed_states},
    source::Source,
    topics::choose,
    tracking::{track, worlds},
    views::{View, Views, views_kept},
};
use capture::{
    Capture, CaptureConfig, CaptureError, PoseAgreement, PoseCorrection, PoseFindings, RefinePoses,
    RgbdFrame, Split, TrackCamera, cameras, denoise, fill_from_color, isolate, refine_poses, spread_views,
};
use common::ahead::Ahead;
use common::note::{Note, NoteCode};
use geometry::Pose;
use numeric::random::stage_rng;

/// Opens paths: a bag a state, a folder with `state0`, `state1`, ..., one bag with both states, or a dataset
/// folder. Every frame of the result has a mask, and each state has at least one frame with depth on the
/// object. `seed` is that of the run; the search for background planes draws from it.
///
/// # Errors
/// [`CaptureError`]; see its variants. What is merely degraded stands in [`Capture::warnings`].
pub fn open(sources: &[PathBuf], config: &CaptureConfig, seed: u64) -> Result<Capture, CaptureError> {
    open_ahead(sources, config, seed, &Ahead::default())
}

/// [`open`], with what was worked out ahead. It changes the time alone.
///
/// # Errors
/// Those of [`open`].
pub fn open_ahead(
    sources: &[PathBuf],
    config: &CaptureConfig,
    seed: u64,
    ahead: &Ahead,
) -> Result<Capture, CaptureError> {
    config.check()?;
    let source = Source::of(sources)?;
    let mut capture = match &source {
        Source::States(paths) => open_states(paths, config, seed, ahead)?,
        Source::Both(path) => open_both(path, config, seed, ahead)?,
        Source::Keyframes(path) => dataset::open_keyframes(path, config)?,
        Source::StartEnd(path) => dataset::open_start_end(path, config)?,
    };
    capture.name = source.object_name();
    // What can be refused at once is, before the costly steps.
    check_depth(&capture, config)?;
    check_states_differ(&capture)?;
    // The noise first (2.8): all gates behind it are multiples of it.
    measure_noise(&mut capture, config);
    // Poses before isolation, which puts the points of all frames together.
    if config.refine_poses == RefinePoses::Auto {
        correct_poses(&mut capture, ahead);
        place_on_board(&mut capture);
    }
    let had_masks = capture.states.iter().flatten().all(|frame| frame.mask.is_some());
    isolate(&mut capture, config, &mut stage_rng(seed, "capture/isolate", 0))?;
    // Denoising last: it works on the object's pixels and hides the noise that was measured.
    if config.denoise {
        let noise = capture.noise;
        let frames = capture.states.par_iter_mut().flat_map(|frames| frames.par_iter_mut());
        frames.for_each(|frame| denoise(frame, &noise));
    }
    // Without masks a pixel without depth may show anything.
    if had_masks {
        fill_holes(&mut capture, config, seed);
    }
    Ok(capture)
}

/// The name that the object gets from the recordings' paths: `[A-Za-z][A-Za-z0-9_]*`.
///
/// # Errors
/// Where the paths hold no recording.
pub fn object_name(sources: &[PathBuf]) -> Result<String, CaptureError> {
    Ok(Source::of(sources)?.object_name())
}

/// Poses of the optical frame by stamp, nanoseconds, in the order of time.
pub type Trajectory = Vec<(i64, Pose)>;

/// The camera's way through each state as it is tracked by what it sees, whether or not poses were
/// recorded; with what is to be said of it: notes, then warnings. Of bags, one a state.
///
/// # Errors
/// Those of [`open`].
pub fn track_camera(
    sources: &[PathBuf],
    config: &CaptureConfig,
    seed: u64,
) -> Result<(Vec<Trajectory>, [Vec<Note>; 2]), CaptureError> {
    config.check()?;
    let config = &CaptureConfig { tracking: TrackCamera::Always, ..config.clone() };
    let paths = match Source::of(sources)? {
        Source::States(paths) => paths,
        // A way of its own, whatever states it shows.
        Source::Both(path) => vec![path],
        _ => {
            let why = "bags are tracked, one a state";
            return Err(CaptureError::NotTracked { state: 0, views: 0, why });
        }
    };
    let mut capture = Capture::of_states(paths.len());
    let recordings = posed_states(&mut capture, &paths, config, seed, &Ahead::default())?;
    let trajectory = |(_, views): &(Bag, Views)| -> Trajectory {
        views.views.iter().filter_map(|v| Some((v.stamp_nanos, v.world_from_camera?))).collect()
    };
    Ok((recordings.iter().map(trajectory).collect(), [capture.notes, capture.warnings]))
}

/// Number of states that the recordings at the paths hold.
///
/// # Errors
/// Where the paths hold no recording.
pub fn state_count(sources: &[PathBuf]) -> Result<usize, CaptureError> {
    Ok(Source::of(sources)?.states())
}

fn open_states(
    paths: &[PathBuf],
    config: &CaptureConfig,
    seed: u64,
    ahead: &Ahead,
) -> Result<Capture, CaptureError> {
    // Refused, not ignored: somebody meant one of the two.
    if !config.split_secs.is_empty() || config.topics.marker.is_some() {
        return Err(CaptureError::Split {
            reason: format!(
                "a split was asked for, but {} recordings were given, one per state",
                paths.len()
            ),
        });
    }
    let mut capture = Capture::of_states(paths.len());
    let recordings = posed_states(&mut capture, paths, config, seed, ahead)?;
    let mut found = Vec::new();
    for (state, (bag, views)) in recordings.into_iter().enumerate() {
        let all: Vec<usize> = (0..views.views.len()).collect();
        let chosen: Vec<_> = spread(&views.views, &all, config).into_iter().map(|v| (state, v)).collect();
        let note = views_kept(state, chosen.len(), views.views.len());
        found.push((bag, views, chosen, note));
    }
    // Before anything is decoded.
    config.check_memory(
        &found.iter().map(|(_, views, chosen, _)| views.sizes(chosen.len())).collect::<Vec<_>>(),
    )?;
    let worlds: Vec<String> = found.iter().map(|(_, views, ..)| views.world_frame.clone()).collect();
    for (bag, views, chosen, note) in found {
        capture.notes.push(note);
        add_frames(&mut capture, &bag, views, &chosen, config)?;
    }
    match (1..worlds.len()).find(|&k| worlds[k] != worlds[0]) {
        Some(state) => {
            Err(CaptureError::WorldFrames { world0: worlds[0].clone(), state, world1: worlds[state].clone() })
        }
        None => Ok(capture),
    }
}

fn open_both(path: &Path, config: &CaptureConfig, seed: u64, ahead: &Ahead) -> Result<Capture, CaptureError> {
    let bag = Bag::open(path)?;
    let mut index = BagIndex::read(&bag)?;
    let topics = choose(&index.summaries(), &config.topics, &bag.path)?;
    let (first, last) = index.span_nanos().unwrap_or_default();
    let split = match (&topics.marker, config.split_secs.as_slice()) {
        (Some(topic), _) => Split::at_markers(topic, index.markers.get(topic).map_or(&[][..], Vec::as_slice)),
        (None, []) => Err(CaptureError::OneState { path: path.to_owned() }),
        (None, times) => Split::at(times, first, last),
    };
    if let Ok(split) = &split {
        index.leave_out_between(split, &topics.color);
    }
    // Of the whole bag: one choice of topics and one source of poses for both states.
    let mut views = Views::find(&bag, &index, config, 0)?;
    let split = split?;
    let mut capture = Capture::of_states(2);
    let mut of_states = Vec::new();
    for state in 0..2 {
        let of_state: Vec<usize> = (0..views.views.len())
            // By recording time: markers of std_msgs have no stamp.
            .filter(|v| split.state(views.views[*v].log_nanos) == Some(state))
            .collect();
        if of_state.is_empty() {
            return Err(CaptureError::Split {
                reason: format!("no usable view lies in state {state}; {} views in all", views.views.len()),
            });
        }
        of_states.push(of_state);
    }
    if views.are_untracked() {
        let mut tracked = Vec::new();
        for (state, of_state) in of_states.iter().enumerate() {
            tracked.push(track(&bag, &views, of_state, config, (state, seed), ahead)?);
        }
        let worlds = worlds(&tracked, seed, &mut capture.notes, &mut capture.warnings)?;
        capture.board = worlds.board;
        for (tracked, world) in tracked.into_iter().zip(worlds.from_maps) {
            give_poses(&mut capture, &mut views, tracked, (&world, worlds.scale));
        }
    }
    let mut chosen = Vec::new();
    for (state, of_state) in of_states.into_iter().enumerate() {
        let kept = spread(&views.views, &of_state, config);
        capture.notes.push(views_kept(state, kept.len(), of_state.len()));
        chosen.extend(kept.into_iter().map(|v| (state, v)));
    }
    config.check_memory(&[views.sizes(chosen.len())])?;
    add_frames(&mut capture, &bag, views, &chosen, config)?;
    Ok(capture)
}

/// The views kept of those given that have a pose, in time order.
pub(super) fn spread(views: &[View], of_state: &[usize], config: &CaptureConfig) -> Vec<usize> {
    // Farthest views first (2.4): neighbors in time show nearly the same.
    let (posed, poses): (Vec<usize>, Vec<Pose>) =
        of_state.iter().filter_map(|&v| Some((v, views[v].world_from_camera?))).unzip();
    spread_views(&poses, config.frames_per_state).into_iter().map(|i| posed[i]).collect()
}

fn add_frames(
    capture: &mut Capture,
    bag: &Bag,
    views: Views,
    chosen: &[(usize, usize)],
    config: &CaptureConfig,
) -> Result<(), CaptureError> {
    let Decoded { frames, lost } = decode_views(bag, &views, chosen, config)?;
    for (state, frame) in frames {
        push_frame(capture, state, frame);
    }
    if let Some(first) = lost.first() {
        capture.warnings.push(Note::new(
            NoteCode::FramesBroken,
            format!("{} frames are broken and not used (first: {first})", lost.len()),
        ));
    }
    for state in chosen.iter().map(|(state, _)| *state) {
        if capture.states[state].is_empty() {
            let reason =
                format!("all {} are broken (first: {})", lost.len(), lost.first().map_or("", String::as_str));
            return Err(CaptureError::NoFrames { state, reason });
        }
    }
    capture.notes.extend(views.notes);
    capture.warnings.extend(views.warnings);
    Ok(())
}

fn push_frame(capture: &mut Capture, state: usize, mut frame: RgbdFrame) {
    frame.id = format!("{state}_{:04}", capture.states[state].len());
    capture.states[state].push(frame);
}

/// Refuses one recording given for two states: noise makes images of two recordings differ. Poses that were
/// tracked differ by what brings the states together.
fn check_states_differ(capture: &Capture) -> Result<(), CaptureError> {
    let tracked = !capture.tracking.is_empty();
    let same = |(a, b): (&RgbdFrame, &RgbdFrame)| {
        let posed_alike = tracked || a.world_from_camera == b.world_from_camera;
        posed_alike && a.depth_m == b.depth_m && a.rgb == b.rgb
    };
    let twice = |a: &[RgbdFrame], b: &[RgbdFrame]| a.len() == b.len() && a.iter().zip(b).all(same);
    let states = &capture.states;
    let mut pairs = (0..states.len()).flat_map(|second| (0..second).map(move |first| (first, second)));
    match pairs.find(|&(first, second)| twice(&states[first], &states[second])) {
        Some((first, second)) => Err(CaptureError::SameRecording { first, second }),
        None => Ok(()),
    }
}

/// Scales the noise model to the recording.
fn measure_noise(capture: &mut Capture, config: &CaptureConfig) {
    capture.noise = config.noise;
    if let Some(factor) = measured_noise(capture.states.iter().flatten(), config) {
        capture.noise = config.noise.scaled(factor);
        capture.notes.push(Note::new(
            NoteCode::NoiseMeasured,
            format!(
                "depth noise is {factor:.2} times the model of the settings: {:.1} mm at 1 m",
                1e3 * capture.noise.sigma_m(1.0)
            ),
        ));
    }
}

/// Takes depth that the sensor did not read from color, and reports it.
fn fill_holes(capture: &mut Capture, config: &CaptureConfig, seed: u64) {
    let noise = capture.noise;
    for (state, frames) in capture.states.iter_mut().enumerate() {
        let Some(found) = fill_from_color(frames, &noise, config.color_depth, seed) else { continue };
        capture.notes.push(Note::new(
            NoteCode::DepthFromColor,
            format!(
                "state {state}: {:.1} % of the object is far from any depth; {:.0} % of its pixels without \
                 depth got one from color, good to {:.2} %",
                100.0 * found.unread,
                100.0 * found.filled as f64 / found.holes.max(1) as f64,
                100.0 * found.relative_sigma
            ),
        ));
    }
}

/// Corrects the camera poses of each state, and reports it.
fn correct_poses(capture: &mut Capture, ahead: &Ahead) {
    let tracked = !capture.tracking.is_empty();
    capture.poses = refine_poses(&mut capture.states, &capture.noise, tracked, ahead);
    for (state, found) in capture.poses.states.iter().enumerate() {
        capture.notes.extend(found.iter().map(|found| poses_checked(state, found)));
    }
    capture.notes.extend(
        capture.poses.sensor.iter().map(|found| Note::new(NoteCode::SensorChecked, found.to_string())),
    );
    capture.warnings.extend(beyond_expected(&capture.poses));
    capture.warnings.extend(several_sensors(&capture.states));
    // State 0 is what the others' worlds are corrected to.
    for (state, world) in (1..).zip(&capture.poses.worlds) {
        capture.notes.extend(world.iter().map(|found| poses_checked(state, found)));
    }
}

/// Places tracked frames on a board of tags by what was corrected.
fn place_on_board(capture: &mut Capture) {
    let Some(board) = &capture.board else { return };
    if let Some(found) = board.place_again(&mut capture.states, capture.poses.sensor.as_ref()) {
        capture.notes.push(Note::new(NoteCode::BoardSeen, found.to_string()));
    }
}

/// What goes beyond what errors of poses and sensors explain.
fn beyond_expected(poses: &PoseFindings) -> Vec<Note> {
    let far = |(state, found): (usize, &Option<PoseCorrection>)| {
        found.as_ref().filter(|f| f.beyond_expected())?;
        Some(Note::new(
            NoteCode::PosesFarOff,
            format!(
                "state {state}: camera poses err by as much as is looked for at most: 3 mm or 0.29 deg from \
                 one view to the next; check that poses and images are of one clock and of one camera"
            ),
        ))
    };
    let agreement = |(state, found): (usize, &Option<PoseAgreement>)| {
        let found = found.as_ref()?;
        let share = 100.0 * found.share;
        if let Some([delay_s, with_delay]) = found.delay {
            return Some(Note::new(
                NoteCode::PosesLate,
                format!(
                    "state {state}: camera poses seem {:.2} s {} than the images: by their stamps {share:.0} \
                     % of the features that frames share lie where the poses say, with that delay {:.0} %{}; \
                     give both one clock, or set capture.pose_delay_secs={delay_s:.3}",
                    delay_s.abs(),
                    older(delay_s),
                    100.0 * with_delay,
                    match found.certain_delay_s() {
                        Some(_) => "; poses between those of the kept frames are used",
                        None => "",
                    },
                ),
            ));
        }
        found.contradicts().then(|| {
            Note::new(
                NoteCode::PosesContradict,
                format!(
                    "state {state}: camera poses contradict the images: {share:.0} % of the features that \
                     frames share lie where the poses say, and no delay of the poses explains it; check the \
                     frame of the poses (capture.pose_frame), the camera's calibration, and that the \
                     tracking was not lost"
                ),
            )
        })
    };
    let agreement = poses.agreement.iter().enumerate().filter_map(agreement);
    let lag = poses.sensor.as_ref().filter(|s| s.has_late_poses()).map(|s| {
        let [lag_s, sigma_s] = s.pose_lag_s;
        Note::new(
            NoteCode::PosesLate,
            format!(
                "camera poses are {:.0} ms (standard deviation {:.0} ms) {} than the images; they were \
                 corrected, but give both one clock, or set capture.pose_delay_secs={lag_s:.3}",
                1e3 * lag_s.abs(),
                1e3 * sigma_s,
                older(lag_s)
            ),
        )
    });
    let sensor = poses.sensor.as_ref().filter(|s| s.beyond_data_sheets()).map(|s| {
        Note::new(
            NoteCode::SensorFarOff,
            format!(
                "the depth sensor errs by {:.1} % in scale and {:.1} % over the image, more than data sheets \
                 allow; check its calibration and the unit of its images",
                100.0 * s.scale[0],
                100.0 * s.warp_rms
            ),
        )
    });
    let states = poses.states.iter().enumerate().filter_map(far);
    agreement.chain(lag).chain(states).chain(sensor).collect()
}

fn older(delay_s: f64) -> &'static str {
    if delay_s > 0.0 { "older" } else { "younger" }
}

/// Where frames come from several cameras, which share no errors.
fn several_sensors(states: &[Vec<RgbdFrame>]) -> Option<Note> {
    let cameras = cameras(states.iter().flatten());
    (cameras.len() > 1).then(|| {
        Note::new(
            NoteCode::SeveralSensors,
            format!(
                "frames come from {} cameras by their intrinsics; depth is not calibrated, as each errs in \
                 its own way; record all states with one camera at one resolution",
                cameras.len()
            ),
        )
    })
}

fn poses_checked(state: usize, found: &impl Display) -> Note {
    Note::new(NoteCode::PosesChecked, format!("state {state}: {found}"))
}

/// Refuses a state without any depth reading.
fn check_depth(capture: &Capture, config: &CaptureConfig) -> Result<(), CaptureError> {
    for (state, frames) in capture.states.iter().enumerate() {
        if frames.is_empty() {
            return Err(CaptureError::NoFrames { state, reason: "the recording has none".into() });
        }
        if !frames.iter().any(|f| f.depth_m.iter().any(|d| *d > 0.0)) {
            return Err(CaptureError::NoDepth {
                state,
                frames: frames.len(),
                min_m: config.depth_min_m,
                max_m: config.depth_max_m,
            });
        }
    }
    Ok(())
}
