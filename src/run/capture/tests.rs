use std::{
    fs,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc,
    },
    thread,
    time::{Duration, Instant},
};

use super::{
    track::{StateSeed, track, tracked_key},
    *,
};
use crate::Event;
use ::capture::TrackedState;
use common::stop::Stop;
use io::{GrowingState, Recording};

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bags").join(name)
}

/// Opens a shipped recording, and asks to stop so long after an event of progress: views that went through
/// the steps, of all. It must end within a second.
fn stops(name: &str, config: &CaptureConfig, after: Duration, is_due: impl Fn(usize, usize) -> bool) {
    let (sender, events) = mpsc::channel();
    let flag = Arc::new(AtomicBool::new(false));
    let monitor = Monitor::new(sender, Arc::clone(&flag));
    thread::scope(|scope| {
        let opened = scope.spawn(move || {
            let opened = open(&[shipped(name)], config, 0, &Ahead::default(), &monitor);
            (opened.err(), Instant::now())
        });
        // Without such an event it ends with the recording.
        _ = events.iter().find(|e| matches!(e, Event::Count { done, total, .. } if is_due(*done, *total)));
        thread::sleep(after);
        let asked = Instant::now();
        flag.store(true, Ordering::Relaxed);
        let (error, ended) = opened.join().unwrap();
        assert!(matches!(error, Some(CaptureError::Stopped(_))), "{error:?}");
        let went_on = ended.saturating_duration_since(asked);
        assert!(went_on < Duration::from_secs(1), "{name}: {went_on:?}");
    });
}

/// Of a recording with poses: the moment when its frames went through so many of five steps.
fn after_steps(count: usize) -> impl Fn(usize, usize) -> bool {
    move |done, total| done * (1 + STEPS_OF_FRAMES) == total * count
}

const AT_ONCE: Duration = Duration::ZERO;
const SOON: Duration = Duration::from_millis(100);

fn tracked() -> CaptureConfig {
    CaptureConfig { tracking: TrackCamera::Always, ..CaptureConfig::default() }
}

#[test]
fn reading_stops() {
    let (sender, _events) = mpsc::channel();
    let monitor = Monitor::new(sender, Arc::new(AtomicBool::new(true)));
    let opened = open(&[shipped("drawer")], &CaptureConfig::default(), 0, &Ahead::default(), &monitor);
    assert!(matches!(opened, Err(CaptureError::Stopped(_))));
    // What is read for the tracking, too: the next block of views.
    stops("drawer", &tracked(), AT_ONCE, |done, _| done == 1);
}

#[test]
fn tracking_stops() {
    stops("drawer", &tracked(), AT_ONCE, |done, _| done == 5);
    stops("drawer", &tracked(), SOON, |done, _| done == 16);
}

#[test]
fn placing_stops() {
    // Both states of the drawer have 16 views: maps are finished and brought into one world.
    stops("drawer", &tracked(), AT_ONCE, |done, _| done == 32);
    stops("drawer", &tracked(), SOON, |done, _| done == 32);
}

#[test]
fn poses_stop() {
    stops("drawer", &CaptureConfig::default(), AT_ONCE, after_steps(1));
    stops("drawer", &CaptureConfig::default(), SOON, after_steps(1));
}

#[test]
fn isolation_stops() {
    // Without masks, and with costly steps behind it, which must not begin.
    let config = CaptureConfig { refine_poses: RefinePoses::Never, ..CaptureConfig::default() };
    stops("drawer_raw", &config, AT_ONCE, after_steps(2));
}

#[test]
fn denoising_and_filling_stop() {
    let config = CaptureConfig {
        refine_poses: RefinePoses::Never,
        color_depth: ::capture::UseColorDepth::Always,
        ..CaptureConfig::default()
    };
    stops("drawer", &config, AT_ONCE, after_steps(3));
    stops("drawer", &config, AT_ONCE, after_steps(4));
}

/// What a run reads of a recording is the same with what was worked out while it grew, and it looks at no
/// image again.
#[test]
fn a_recording_that_grew_is_read_as_any_other() {
    let folder = tempfile::tempdir().unwrap();
    let config = CaptureConfig { frames_per_state: 8, ..CaptureConfig::default() };
    let ahead = Ahead::new();
    let silent = Monitor::silent();
    let paths = ["state0", "state1"].map(|s| folder.path().join(s));
    for (state, path) in paths.iter().enumerate() {
        let mut growing = GrowingState::new(path, state);
        assert!(
            !growing.is_closed() && work_ahead(&mut growing, &config, 0, &ahead, &silent).unwrap().is_none()
        );
        let from = shipped("drawer").join(format!("state{state}"));
        let name = format!("state{state}.mcap");
        let bytes = fs::read(from.join(&name)).unwrap();
        fs::create_dir(path).unwrap();
        let mut views = 0;
        for share in [4, 7, 10] {
            fs::write(path.join(&name), &bytes[..bytes.len() * share / 10]).unwrap();
            growing.rest_after(Duration::ZERO);
            let grown = work_ahead(&mut growing, &config, 0, &ahead, &silent).unwrap().unwrap();
            assert!(grown.views > views && grown.taken <= 8, "{} {}", grown.views, grown.taken);
            views = grown.views;
            assert!(
                work_ahead(&mut growing, &config, 0, &ahead, &silent).unwrap().is_none(),
                "nothing is new"
            );
        }
        fs::write(path.join(&name), &bytes[..bytes.len() - 1]).unwrap();
        fs::copy(from.join("metadata.yaml"), path.join("metadata.yaml")).unwrap();
        assert!(!growing.is_closed(), "the file has no end yet");
        fs::write(path.join(&name), &bytes).unwrap();
        assert!(growing.is_closed());
        work_ahead(&mut growing, &config, 0, &ahead, &silent).unwrap().unwrap();
        assert!(work_ahead(&mut growing, &config, 0, &ahead, &silent).unwrap().is_none());
    }
    let known = ahead.count();
    let with = open(&paths, &config, 0, &ahead, &silent).unwrap();
    assert_eq!(ahead.count(), known, "an image was looked at again");
    let without = open(&paths, &config, 0, &Ahead::default(), &silent).unwrap();
    assert_eq!(with.poses, without.poses);
    for (a, b) in with.states.iter().flatten().zip(without.states.iter().flatten()) {
        assert!(a.depth_m == b.depth_m && a.mask == b.mask && a.world_from_camera == b.world_from_camera);
    }
}

/// A closed recording without poses is tracked ahead, and not by the run.
#[test]
fn the_way_of_a_camera_is_found_ahead_once() {
    let config = tracked();
    let path = shipped("drawer/state0");
    let ahead = Ahead::new();
    let mut growing = GrowingState::new(&path, 0);
    assert!(work_ahead(&mut growing, &config, 3, &ahead, &Monitor::silent()).unwrap().is_some());
    let recording = Recording::open(&path, &config, 0, &Stop::never()).unwrap();
    let key = |seed| tracked_key(&recording.bag.files, &config, StateSeed { state: 0, seed }).unwrap();
    assert!(ahead.knows(&key(3)) && !ahead.knows(&key(4)));
    let all = recording.all();
    let none = Ahead::default();
    let again =
        track(&recording, &all, &config, StateSeed { state: 0, seed: 3 }, &none, &Stop::never(), &mut || {})
            .unwrap();
    let found: TrackedState = ahead.take(&key(3)).unwrap();
    assert_eq!((found.track.poses, found.views), (again.track.poses, again.views));
    assert!(!ahead.knows(&key(3)));
}
