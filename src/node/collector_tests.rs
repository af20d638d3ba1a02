//! The collector fed with the messages of a shipped recording, without a network.

use super::*;
use crate::live_tracking::{Follower, TrackSettings};
use capture::CaptureConfig;
use common::ahead::Ahead;
use io::{
    self,
    ros2msg::{CompressedImage, Image, TfMessage, decode},
};

const COLOR: &str = "/camera/camera/color/image_raw/compressed";
const DEPTH: &str = "/camera/camera/aligned_depth_to_color/image_raw/compressedDepth";
const COLOR_INFO: &str = "/camera/camera/color/camera_info";
const DEPTH_INFO: &str = "/camera/camera/aligned_depth_to_color/camera_info";
const MASK: &str = "/object_mask";

fn shipped(state: usize) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../bags/drawer/state{state}"))
}

fn settings() -> CollectorSettings {
    let topics = Topics {
        color: COLOR.into(),
        depth: DEPTH.into(),
        color_info: COLOR_INFO.into(),
        depth_info: Some(DEPTH_INFO.into()),
        mask: Some(MASK.into()),
        pose: None,
    };
    let rule = KeyframeRule { translation_m: 0.02, rotation_rad: 0.03, most: 100 };
    CollectorSettings {
        capture: CaptureConfig::default(),
        topics,
        world_frame: None,
        pose_frame: None,
        slop_nanos: 15_000_000,
        max_gap_nanos: 500_000_000,
        queue: 30,
        rule,
        tracking: TrackCamera::Never,
        poses_asked: false,
        map_frame: "map".into(),
        hold: 0,
    }
}

/// The messages of a state in the order of recording: time and message.
fn samples(state: usize) -> Vec<(i64, Sample)> {
    let bytes = std::fs::read(shipped(state).join(format!("state{state}.mcap"))).unwrap();
    let compressed = |data: &[u8]| Picture::Compressed(decode::<CompressedImage>(data).unwrap());
    let sample = |topic: &str, data: &[u8]| {
        Some(match topic {
            COLOR => Sample::Color(compressed(data)),
            DEPTH => Sample::Depth(compressed(data)),
            MASK => Sample::Mask(Picture::Raw(decode::<Image>(data).unwrap())),
            COLOR_INFO => Sample::ColorInfo(Box::new(decode(data).unwrap())),
            DEPTH_INFO => Sample::DepthInfo(Box::new(decode(data).unwrap())),
            "/tf" => Sample::Transforms(decode::<TfMessage>(data).unwrap()),
            "/tf_static" => Sample::StaticTransforms(decode::<TfMessage>(data).unwrap()),
            _ => return None,
        })
    };
    let messages = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    messages.filter_map(|m| Some((m.log_time as i64, sample(&m.channel.topic, &m.data)?))).collect()
}

fn feed(collector: &mut Collector, state: usize) -> usize {
    let samples = samples(state);
    samples
        .into_iter()
        .map(|(time, sample)| collector.accept_sample(sample, time, false).unwrap().len())
        .sum()
}

#[test]
fn what_is_collected_has_the_frames_of_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let mut collector = Collector::new(settings(), folder.path());
    assert!(collector.finish_state(0).unwrap_err().to_string().contains("not being collected"));
    for state in 0..2 {
        collector.start_state(state).unwrap();
        assert!(collector.start_state(state).unwrap_err().to_string().contains("finish it first"));
        feed(&mut collector, state);
        assert_eq!(collector.finish_state(state).unwrap(), 16);
    }
    assert_eq!((collector.kept_views(), collector.match_counts()), ([16, 16], (32, [0; 3])));
    assert_eq!(collector.world_frame.as_deref(), Some("world"));
    let config = CaptureConfig::default();
    let open = |paths: &[PathBuf]| {
        run::capture::open(paths, &config, 0, &Ahead::default(), &run::Monitor::silent()).unwrap()
    };
    let own = open(&collector.recordings().map(Option::unwrap));
    let given = open(&[shipped(0), shipped(1)]);
    for (own, given) in own.states.iter().flatten().zip(given.states.iter().flatten()) {
        assert_eq!(own.stamp_nanos, given.stamp_nanos);
        assert_eq!(own.world_from_camera, given.world_from_camera);
        assert!(own.rgb == given.rgb && own.depth_m == given.depth_m && own.mask == given.mask);
    }
    assert_eq!(own.states.iter().map(Vec::len).collect::<Vec<_>>(), [16, 16]);
    let session = Collector::new(settings(), folder.path());
    assert_eq!(session.recordings(), collector.recordings(), "an earlier session is taken up");
}

#[test]
fn a_state_that_ends_without_views_does_not_count() {
    let folder = tempfile::tempdir().unwrap();
    let names = || {
        let mut names: Vec<_> = std::fs::read_dir(folder.path())
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    };
    let mut collector = Collector::new(settings(), folder.path());
    // As if never started.
    collector.start_state(0).unwrap();
    assert!(collector.finish_state(0).unwrap_err().to_string().contains("no view of state 0 was kept"));
    assert_eq!((collector.phase(), collector.recordings(), names()), (Phase::Idle, [None, None], vec![]));
    assert!(collector.finish_state(0).unwrap_err().to_string().contains("not being collected"));
    // What was there before counts again.
    collector.start_state(0).unwrap();
    feed(&mut collector, 0);
    collector.finish_state(0).unwrap();
    let recording = folder.path().join("state0/state0_0.mcap");
    let before = std::fs::read(&recording).unwrap();
    collector.start_state(0).unwrap();
    assert!(names().contains(&"state0_replaced1".to_owned()));
    assert!(collector.finish_state(0).is_err());
    assert_eq!(
        (collector.recordings(), collector.kept_views(), names()),
        ([Some(folder.path().join("state0")), None], [16, 0], vec!["state0".to_owned()])
    );
    assert_eq!(std::fs::read(&recording).unwrap(), before);
    // A reset forgets a state without views likewise.
    collector.start_state(1).unwrap();
    collector.reset_session(&folder.path().join("next")).unwrap();
    assert_eq!(names(), ["state0"]);
}

#[test]
fn known_views_and_a_second_replay_add_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut collector = Collector::new(settings(), folder.path());
    collector.start_state(0).unwrap();
    feed(&mut collector, 0);
    // The same stamps again: time went back, and what was kept stays the only copy.
    feed(&mut collector, 0);
    assert_eq!(collector.kept_views()[0], 16);
    assert!(collector.counts.jumps >= 1 && collector.counts.late > 0, "{:?}", collector.counts);
    assert_eq!(collector.finish_state(0).unwrap(), 16);
    let recordings = std::fs::read_dir(folder.path()).unwrap().count();
    collector.start_state(0).unwrap();
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        recordings + 1,
        "what was collected before is kept"
    );
    feed(&mut collector, 0);
    assert_eq!(collector.kept_views()[0], 16, "the transforms before the first image after a jump are there");
}

#[test]
fn without_poses_or_partners_the_answer_says_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let mut collector = Collector::new(settings(), folder.path());
    collector.start_state(0).unwrap();
    assert!(collector.finish_state(0).unwrap_err().to_string().contains(COLOR));
    collector.start_state(0).unwrap();
    let samples = samples(0);
    let without_tf =
        samples.iter().filter(|(_, s)| !matches!(s, Sample::Transforms(_) | Sample::StaticTransforms(_)));
    without_tf
        .for_each(|(time, s)| assert!(collector.accept_sample(s.clone(), *time, false).unwrap().is_empty()));
    let why = collector.finish_state(0).unwrap_err().to_string();
    assert!(why.contains("/tf"), "{why}");
    assert_eq!(collector.waiting_counts(), (0, 16));
    collector.reset_session(&folder.path().join("next")).unwrap();
    assert_eq!((collector.phase(), collector.waiting_counts()), (Phase::Idle, (0, 0)));
}

#[test]
fn broken_images_are_counted_and_not_kept() {
    let folder = tempfile::tempdir().unwrap();
    let mut collector = Collector::new(settings(), folder.path());
    collector.start_state(0).unwrap();
    let mut count = 0;
    for (time, mut sample) in samples(0) {
        if let Sample::Depth(Picture::Compressed(image)) = &mut sample {
            count += 1;
            match count {
                1 => image.data.truncate(40),
                2 => image.header.stamp.sec = -1,
                _ => {}
            }
        }
        collector.accept_sample(sample, time, false).unwrap();
    }
    assert_eq!(collector.finish_state(0).unwrap(), 14);
    assert_eq!((collector.counts.broken, collector.counts.bad_header), (1, 1));
    assert_eq!(collector.match_counts().1[0], 1, "its color image has no partner");
}

#[test]
fn views_without_transforms_are_tracked_kept_and_recorded_without_poses() {
    let folder = tempfile::tempdir().unwrap();
    let mut posed = Collector::new(settings(), &folder.path().join("posed"));
    let truth: Vec<Seen> = samples(0)
        .into_iter()
        .flat_map(|(time, sample)| posed.accept_sample(sample, time, true).unwrap())
        .collect();
    let settings = CollectorSettings { tracking: TrackCamera::Auto, ..settings() };
    let track = TrackSettings {
        config: CaptureConfig::default(),
        topics: settings.topics.clone(),
        seed: 0,
        most: 50,
    };
    let mut follower = Follower::new(&track);
    let mut collector = Collector::new(settings, folder.path());
    collector.start_state(0).unwrap();
    let mut found = Vec::new();
    for (time, sample) in samples(0).into_iter().filter(|(_, s)| !matches!(s, Sample::Transforms(_))) {
        assert!(collector.accept_sample(sample, time, false).unwrap().is_empty());
        for view in collector.take_to_track() {
            let tracked = follower.follow_view(view);
            found.extend(collector.accept_tracked(tracked, time).unwrap());
        }
    }
    // As many as offline, which loses four: the views of this recording are 12 deg apart.
    assert!(found.len() >= 11, "{}", found.len());
    // The first one may be of a map that no other view was placed in.
    for (seen, transform) in &found[1..] {
        let transform = transform.as_ref().unwrap();
        assert_eq!(
            (transform.header.frame_id.as_str(), transform.child_frame_id.as_str()),
            ("map", "camera_link")
        );
        assert_eq!(transform.header.stamp.nanos(), Some(seen.frame.stamp_nanos));
        let of =
            |stamp: i64| truth.iter().find(|t| t.frame.stamp_nanos == stamp).unwrap().frame.world_from_camera;
        let first = &found[found.len() - 1].0.frame;
        let seen = &seen.frame;
        let true_way = of(first.stamp_nanos).inverse() * of(seen.stamp_nanos);
        let way = first.world_from_camera.inverse() * seen.world_from_camera;
        let off = true_way.inverse() * way;
        assert!(off.translation.vector.norm() < 0.01 && off.rotation.angle() < 0.02, "{off}");
    }
    assert_eq!(collector.world_frame.as_deref(), Some("map"));
    assert_eq!(collector.twin_frame(), Some("world"));
    // The node's own transforms come back on /tf: they change nothing.
    let own = found.iter().filter_map(|(_, t)| t.clone()).collect();
    collector.accept_sample(Sample::Transforms(TfMessage { transforms: own }), 0, false).unwrap();
    assert_eq!(collector.tf.moving_root("camera_color_optical_frame"), None);
    // Those that were lost are recorded, too.
    assert_eq!(collector.finish_state(0).unwrap(), 16);
    let recorded = io::inspect(&folder.path().join("state0")).unwrap();
    let recorded = &recorded.recordings[0];
    assert!(recorded.untracked && recorded.views == 16, "{recorded:?}");
    assert!(recorded.transforms.iter().all(|t| t.contains("static")), "{recorded:?}");
}

#[test]
fn a_view_of_an_earlier_map_is_left_out_and_one_that_asks_for_poses_is_not_tracked() {
    let folder = tempfile::tempdir().unwrap();
    let mut always =
        Collector::new(CollectorSettings { tracking: TrackCamera::Always, ..settings() }, folder.path());
    let mut asked = Collector::new(
        CollectorSettings { tracking: TrackCamera::Auto, poses_asked: true, ..settings() },
        &folder.path().join("asked"),
    );
    let mut views = Vec::new();
    for (time, sample) in samples(0) {
        assert!(always.accept_sample(sample.clone(), time, false).unwrap().is_empty());
        views.extend(always.take_to_track());
        asked.accept_sample(sample, time, false).unwrap();
        assert!(asked.take_to_track().is_empty());
    }
    // Also where transforms come.
    assert_eq!(views.len(), 16);
    // What is set during a state counts from the next one on.
    always.start_state(0).unwrap();
    always.set_tracking(TrackCamera::Never);
    assert_eq!((feed(&mut always, 0), always.take_to_track().is_empty()), (0, false));
    assert!(always.finish_state(0).is_err());
    always.start_state(0).unwrap();
    feed(&mut always, 0);
    assert_eq!((always.kept_views()[0], always.take_to_track().is_empty()), (16, true));
    always.begin_map();
    let view = View { stamp_nanos: 1, images: [None, None, None], world_from_camera: Pose::identity() };
    let outcome = crate::live_tracking::Outcome::Lost(capture::Lost::Dark);
    let old = crate::live_tracking::Tracked { map: 0, view, outcome, keyframes: (1, false) };
    assert!(always.accept_tracked(old, 0).unwrap().is_none());
}

/// The depth image of a picture at half of its size, in a frame of its own.
fn half_depth(picture: &Picture) -> Picture {
    let full = picture.depth_raster().unwrap();
    let mut header = picture.header().clone();
    header.frame_id = "depth_frame".into();
    let width = full.width / 2;
    let height = full.height / 2;
    let of_row = |v: usize| (0..width).map(move |u| (2 * v, 2 * u));
    let millimeters = (0..height).flat_map(of_row).map(|(v, u)| 1e3 * full.pixels[v * full.width + u]);
    Picture::Raw(Image {
        header,
        height: height as u32,
        width: width as u32,
        encoding: "16UC1".into(),
        is_bigendian: 0,
        step: 2 * width as u32,
        data: millimeters.flat_map(|z| (z.round() as u16).to_le_bytes()).collect(),
    })
}

/// Frames of state 0 with depth at half the size, whose camera stands `behind_m` behind that of color.
fn frames_with_half_depth(behind_m: f64) -> Vec<RgbdFrame> {
    let folder = tempfile::tempdir().unwrap();
    let mut collector = Collector::new(settings(), folder.path());
    collector.start_state(0).unwrap();
    let mut beside = TransformStamped {
        header: Header { stamp: io::ros2msg::Time::default(), frame_id: "camera_color_optical_frame".into() },
        child_frame_id: "depth_frame".into(),
        transform: Transform::default(),
    };
    beside.transform.rotation.w = 1.0;
    beside.transform.translation.z = -behind_m;
    let related = Sample::StaticTransforms(TfMessage { transforms: vec![beside] });
    collector.accept_sample(related, 0, true).unwrap();
    let mut frames = Vec::new();
    for (time, sample) in samples(0) {
        let sample = match sample {
            Sample::Depth(picture) => Sample::Depth(half_depth(&picture)),
            Sample::DepthInfo(mut info) => {
                info.width /= 2;
                info.height /= 2;
                [0, 2, 4, 5].into_iter().for_each(|k| info.k[k] *= 0.5);
                Sample::DepthInfo(info)
            }
            other => other,
        };
        frames.extend(collector.accept_sample(sample, time, true).unwrap().into_iter().map(|s| s.frame));
    }
    assert_eq!(collector.counts.broken, 0, "{:?}", collector.problem);
    assert_eq!(collector.finish_state(0).unwrap(), 16);
    frames
}

fn median_depth_m(frame: &RgbdFrame) -> f32 {
    let mut read: Vec<f32> = frame.depth_m.iter().copied().filter(|z| *z > 0.0).collect();
    // A pixel of depth covers four of color.
    assert!(read.len() > frame.depth_m.len() / 2, "{} of {}", read.len(), frame.depth_m.len());
    read.sort_by(f32::total_cmp);
    read[read.len() / 2]
}

#[test]
fn depth_of_another_size_and_frame_is_brought_to_colors_pixels() {
    let beside = frames_with_half_depth(0.0);
    let behind = frames_with_half_depth(0.1);
    assert_eq!((beside.len(), behind.len()), (16, 16));
    for (beside, behind) in beside.iter().zip(&behind) {
        assert_eq!(beside.depth_m.len(), beside.rgb.len());
        let nearer_m = median_depth_m(beside) - median_depth_m(behind);
        // What is nearer is magnified, so that less of it is in sight.
        assert!((0.08..0.15).contains(&nearer_m), "{nearer_m}");
    }
}
