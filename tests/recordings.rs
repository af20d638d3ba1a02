//! Recordings made on the spot: every supported form gives the same frames, and every broken one a clear
//! message.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

mod common;
#[path = "common/opened.rs"]
mod opened;

use std::path::{Path, PathBuf};

use capture::{Capture, CaptureConfig, CaptureError, TrackCamera};
use common::*;
use io::inspect;
use opened::open;
use tempfile::TempDir;

fn config() -> CaptureConfig {
    // Frames are compared with what was written.
    CaptureConfig { denoise: false, ..CaptureConfig::default() }
}

fn open_one(path: &Path) -> Result<Capture, CaptureError> {
    open(&[path.to_owned()], &config(), 0)
}

fn states_with(change: impl Fn(&mut Options)) -> (TempDir, Result<Capture, CaptureError>) {
    let folder = tempfile::tempdir().unwrap();
    let mut options = Options::default();
    change(&mut options);
    write_states(&folder.path().join("cabinet"), &options);
    let capture = open_one(&folder.path().join("cabinet"));
    (folder, capture)
}

fn error_of(name: &str, change: impl Fn(&mut Options)) -> CaptureError {
    match states_with(change).1 {
        Err(error) => error,
        Ok(capture) => panic!("{name}: {} frames", capture.states[0].len()),
    }
}

/// What is said of poses of a kind where the camera is not to be tracked.
fn untracked_error(poses: PoseKind) -> CaptureError {
    let folder = tempfile::tempdir().unwrap();
    write_states(&folder.path().join("cabinet"), &Options { poses, ..Options::default() });
    let config = CaptureConfig { tracking: TrackCamera::Never, ..config() };
    open(&[folder.path().join("cabinet")], &config, 0).unwrap_err()
}

/// Compares with the rendered views; `color_tolerance` is the mean difference of a channel.
fn check_frames(capture: &Capture, what: &str, color_tolerance: f64) {
    for (state, frames) in capture.states.iter().enumerate() {
        assert_eq!(frames.len(), COUNT, "{what}");
        for (i, frame) in frames.iter().enumerate() {
            let truth = render(state, i);
            assert_eq!(frame.id, format!("{state}_{i:04}"));
            assert_eq!((frame.intrinsics.width, frame.intrinsics.height), (CAMERA.width, CAMERA.height));
            let offset = frame.world_from_camera.inverse() * truth.world_from_camera;
            assert!(
                offset.translation.vector.norm() < 1e-5 && offset.rotation.angle() < 1e-5,
                "{what}: {offset}"
            );
            let difference =
                |(a, b): (&[u8; 3], &[u8; 3])| (0..3).map(|k| f64::from(a[k].abs_diff(b[k]))).sum::<f64>();
            let mean =
                frame.rgb.iter().zip(&truth.rgb).map(difference).sum::<f64>() / (3 * frame.rgb.len()) as f64;
            assert!(mean <= color_tolerance, "{what}: color is off by {mean}");
            let mask = frame.mask.as_ref().unwrap();
            assert_eq!(mask, &truth.mask, "{what}");
            for (p, d) in frame.depth_m.iter().enumerate() {
                assert!(
                    (f64::from(*d) - f64::from(truth.depth_mm[p]) / 1000.0).abs() < 1e-5,
                    "{what}: pixel {p}"
                );
            }
        }
    }
}

#[test]
fn every_encoding_gives_the_same_frames() {
    let depths = [
        DepthKind::Raw16,
        DepthKind::Raw16BigEndian,
        DepthKind::RawFloat,
        DepthKind::CompressedPng,
        DepthKind::CompressedRvl,
    ];
    let colors = [ColorKind::Rgb8, ColorKind::Bgra8Padded, ColorKind::Png];
    for (i, depth) in depths.into_iter().enumerate() {
        let color = colors[i % 3];
        let (_folder, capture) = states_with(|o| (o.depth, o.color) = (depth, color));
        let capture = capture.unwrap();
        check_frames(&capture, &format!("{depth:?} {color:?}"), 0.0);
        assert_eq!((capture.name.as_str(), capture.warnings.len()), ("cabinet", 0), "{:?}", capture.warnings);
    }
    let (_folder, capture) = states_with(|o| o.color = ColorKind::Jpeg);
    check_frames(&capture.unwrap(), "jpeg", 8.0);
}

#[test]
fn poses_come_from_tf_or_from_a_pose_topic() {
    for poses in [PoseKind::PoseStamped, PoseKind::Odometry] {
        let (_folder, capture) = states_with(|o| o.poses = poses);
        let capture = capture.unwrap();
        check_frames(&capture, &format!("{poses:?}"), 0.0);
        let topic = if poses == PoseKind::Odometry { "/odom" } else { "/camera_pose" };
        assert!(capture.notes.iter().any(|n| n.text.contains(topic)), "{:?}", capture.notes);
    }
}

#[test]
fn every_compression_is_read() {
    for compression in [None, Some(mcap::Compression::Lz4), Some(mcap::Compression::Zstd)] {
        let (_folder, capture) = states_with(|o| o.compression = compression);
        check_frames(&capture.unwrap(), "compression", 0.0);
    }
}

#[test]
fn zstd_by_message_and_by_file_is_read() {
    let folder = tempfile::tempdir().unwrap();
    for state in 0..2 {
        let bag = folder.path().join(format!("state{state}"));
        write_state(&bag, state, &Options::default());
        let name = format!("state{state}.mcap");
        let plain = std::fs::read(bag.join(&name)).unwrap();
        if state == 0 {
            std::fs::write(bag.join(format!("{name}.zstd")), zstd::encode_all(plain.as_slice(), 1).unwrap())
                .unwrap();
            std::fs::remove_file(bag.join(&name)).unwrap();
            write_metadata(&bag, &[&format!("{name}.zstd")], "file");
        } else {
            let mut writer = BagWriter::create(&bag.join(&name), None, 100_000);
            for m in mcap::MessageStream::new(&plain).unwrap() {
                let m = m.unwrap();
                let type_name = m.channel.schema.as_ref().unwrap().name.clone();
                let data = zstd::encode_all(&m.data[..], 1).unwrap();
                writer.bytes(&m.channel.topic, &type_name, "cdr", m.log_time as i64, &data);
            }
            writer.finish();
            write_metadata(&bag, &[&name], "message");
        }
    }
    check_frames(&open_one(folder.path()).unwrap(), "zstd", 0.0);
}

#[test]
fn two_bags_one_folder_and_one_split_bag_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    write_states(folder.path(), &Options::default());
    let two = [folder.path().join("state0"), folder.path().join("state1/state1.mcap")];
    check_frames(&open(&two, &config(), 0).unwrap(), "two bags", 0.0);

    // One bag: state 0, a pause in which the object is moved, state 1.
    let both = folder.path().join("both");
    std::fs::create_dir_all(&both).unwrap();
    let mut writer = BagWriter::create(&both.join("both_0.mcap"), None, 100_000);
    let pause = START + 10 * PERIOD;
    let second = pause + 10_000_000_000;
    add_state(&mut writer, 0, START, &Options::default());
    writer.message("/moved", "std_msgs/msg/Empty", pause, &0u8);
    writer.message("/moved", "std_msgs/msg/Empty", second - PERIOD, &0u8);
    writer.finish();
    let mut writer = BagWriter::create(&both.join("both_1.mcap"), None, 100_000);
    add_state(&mut writer, 1, second, &Options::default());
    writer.finish();
    // The files in the wrong order.
    write_metadata(&both, &["both_1.mcap", "both_0.mcap"], "");
    for split in [vec![4.0], vec![2.5, 9.0], vec![pause as f64 * 1e-9 + 1.0]] {
        let config = CaptureConfig { split_secs: split.clone(), ..config() };
        check_frames(&open(std::slice::from_ref(&both), &config, 0).unwrap(), &format!("{split:?}"), 0.0);
    }
    let mut marked = config();
    marked.topics.marker = Some("/moved".into());
    check_frames(&open(std::slice::from_ref(&both), &marked, 0).unwrap(), "marker", 0.0);

    let error = open_one(&both).unwrap_err();
    assert!(
        matches!(error, CaptureError::OneState { .. }) && error.to_string().contains("--split"),
        "{error}"
    );
    assert!(inspect(&both).unwrap().to_text().contains("/moved"));
    let late = CaptureConfig { split_secs: vec![500.0], ..config() };
    assert!(matches!(open(&[both], &late, 0), Err(CaptureError::Split { .. })));
}

#[test]
fn damaged_bags_give_what_can_be_read_and_say_so() {
    let folder = tempfile::tempdir().unwrap();
    write_states(folder.path(), &Options { chunk_bytes: 60_000, ..Options::default() });
    let file = folder.path().join("state0/state0.mcap");
    let whole = std::fs::read(&file).unwrap();

    std::fs::write(&file, &whole[..whole.len() * 6 / 10]).unwrap();
    let capture = open_one(folder.path()).unwrap();
    let kept = capture.states[0].len();
    assert!((2..COUNT).contains(&kept) && capture.states[1].len() == COUNT, "{kept}");
    assert!(
        capture.warnings.iter().any(|w| w.text.contains("damaged") && w.text.contains("messages were read")),
        "{:?}",
        capture.warnings
    );

    let mut flipped = whole.clone();
    let middle = whole.len() / 2;
    flipped[middle..middle + 50].iter_mut().for_each(|b| *b ^= 0xa5);
    std::fs::write(&file, &flipped).unwrap();
    let capture = open_one(folder.path()).unwrap();
    assert!((COUNT / 2..COUNT).contains(&capture.states[0].len()));
    assert!(
        capture.warnings.iter().any(|w| w.text.contains("1 of") && w.text.contains("chunks left out")),
        "{:?}",
        capture.warnings
    );
    let text = inspect(folder.path()).unwrap().to_text();
    assert!(text.contains("chunks left out") && text.contains("usable: yes"), "{text}");

    std::fs::write(&file, &whole[..20]).unwrap();
    assert!(matches!(open_one(folder.path()), Err(CaptureError::Corrupt { .. })));
    std::fs::write(&file, b"").unwrap();
    let error = open_one(folder.path()).unwrap_err();
    assert!(matches!(error, CaptureError::Corrupt { .. }) && error.to_string().contains("empty"), "{error}");
}

#[test]
fn without_metadata_the_files_are_used_and_metadata_cannot_point_outside() {
    let folder = tempfile::tempdir().unwrap();
    write_states(folder.path(), &Options::default());
    let yaml = folder.path().join("state0/metadata.yaml");
    std::fs::remove_file(&yaml).unwrap();
    let capture = open_one(folder.path()).unwrap();
    check_frames(&capture, "no metadata", 0.0);
    assert!(capture.warnings[0].text.contains("no metadata.yaml"));
    for evil in ["../state1/state1.mcap", "/etc/passwd", ".."] {
        write_metadata(&folder.path().join("state0"), &[evil], "");
        let error = open_one(folder.path()).unwrap_err();
        assert!(
            matches!(error, CaptureError::Metadata { .. }) && error.to_string().contains("outside"),
            "{error}"
        );
    }
    std::fs::write(
        &yaml,
        "rosbag2_bagfile_information:\n  storage_identifier: sqlite3\n  relative_file_paths: [a.db3]\n",
    )
    .unwrap();
    let error = open_one(folder.path()).unwrap_err().to_string();
    assert!(error.contains("rosbags-convert") && error.contains("--dst-storage mcap"), "{error}");
}

#[test]
fn missing_topics_are_named_with_a_remedy() {
    let text = error_of("nodepth", |o| (o.depth, o.depth_info) = (DepthKind::None, false)).to_string();
    assert!(text.contains("no depth topic") && text.contains("enable_depth"), "{text}");
    let text = error_of("nocolor", |o| o.color = ColorKind::None).to_string();
    assert!(text.contains("no color topic"), "{text}");
    let text = error_of("noinfo", |o| (o.info, o.depth_info) = (false, false)).to_string();
    assert!(
        text.contains("no camera_info topic") && text.contains("/camera/camera/color/camera_info"),
        "{text}"
    );
}

#[test]
fn missing_poses_are_dropped_or_refused() {
    let (_folder, capture) = states_with(|o| o.poses = PoseKind::TfHalf);
    let capture = capture.unwrap();
    assert_eq!(capture.states[0].len(), COUNT / 2);
    assert!(
        capture
            .warnings
            .iter()
            .any(|w| w.text.contains("5 of 10 frames have no camera pose") && w.text.contains("end at")),
        "{:?}",
        capture.warnings
    );

    let error = untracked_error(PoseKind::None);
    assert!(
        matches!(error, CaptureError::NoTransform { .. }) && error.to_string().contains(OPTICAL),
        "{error}"
    );
    let error = untracked_error(PoseKind::Static);
    assert!(
        matches!(error, CaptureError::StaticCamera { .. }) && error.to_string().contains("--topic pose="),
        "{error}"
    );
    let error = untracked_error(PoseKind::TfNan);
    assert!(
        matches!(error, CaptureError::InvalidPoses { .. }) && error.to_string().contains("NaN"),
        "{error}"
    );
}

#[test]
fn bad_images_are_refused() {
    // Sixteen bits are read by their upper bytes.
    assert!(states_with(|o| o.color = ColorKind::Rgb16).1.is_ok());
    for color in [ColorKind::Rgb8, ColorKind::Jpeg] {
        let error = error_of("shrink", |o| (o.color, o.shrink_from) = (color, 6));
        assert!(matches!(error, CaptureError::ImageSize { width: 60, expected_width: 120, .. }), "{error}");
    }
    let error = error_of("empty", |o| o.depth = DepthKind::Empty);
    assert!(
        matches!(error, CaptureError::NoDepth { .. }) && error.to_string().contains("all depth is invalid"),
        "{error}"
    );
    let error = error_of("unaligned", |o| o.depth_info_width = 64);
    assert!(
        matches!(error, CaptureError::NotAligned { .. }) && error.to_string().contains("depth_info=TOPIC"),
        "{error}"
    );
    let error = error_of("fisheye", |o| o.distortion = ("equidistant", vec![0.1; 4]));
    assert!(
        matches!(error, CaptureError::Distortion { .. }) && error.to_string().contains("`equidistant`"),
        "{error}"
    );
    let error = error_of("late", |o| o.depth_delay = 100_000_000);
    assert!(
        matches!(error, CaptureError::NoFrames { .. }) && error.to_string().contains("sync_slop_secs"),
        "{error}"
    );
}

#[test]
fn other_things_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let text = folder.path().join("notes.txt");
    std::fs::write(&text, "hello").unwrap();
    assert!(matches!(open_one(&text), Err(CaptureError::NotARecording { .. })));
    assert!(matches!(open_one(folder.path()), Err(CaptureError::NotARecording { .. })));
    assert!(matches!(open_one(&folder.path().join("gone")), Err(CaptureError::Missing { .. })));
    assert!(matches!(open(&[], &config(), 0), Err(CaptureError::NotARecording { .. })));

    // A bag of another kind altogether.
    for state in 0..2 {
        let mut writer = BagWriter::create(&folder.path().join(format!("state{state}.mcap")), None, 1000);
        writer.message("/chatter", "std_msgs/msg/String", START, &"hello");
        writer.finish();
    }
    let error = open_one(folder.path()).unwrap_err();
    assert!(
        matches!(error, CaptureError::NotRgbd { .. }) && error.to_string().contains("/chatter"),
        "{error}"
    );
    std::fs::remove_file(folder.path().join("state1.mcap")).unwrap();
    assert!(matches!(open_one(folder.path()), Err(CaptureError::OneState { .. })));

    // Messages of ROS 1 without their definition cannot be read.
    let mut writer = BagWriter::create(&folder.path().join("ros1.mcap"), None, 1000);
    writer.bytes("/image", "sensor_msgs/Image", "ros1", START, &[0; 40]);
    writer.finish();
    let ros1 = folder.path().join("ros1.mcap");
    assert!(matches!(open_one(&ros1), Err(CaptureError::NotRgbd { .. })));
    assert!(inspect(&ros1).unwrap().to_text().contains("does not fit its definition"));
}

#[test]
fn topics_and_budget_can_be_set() {
    let folder = tempfile::tempdir().unwrap();
    write_states(folder.path(), &Options::default());
    let mut few = CaptureConfig { frames_per_state: 4, ..config() };
    few.topics.depth = Some(DEPTH.into());
    let capture = open(std::slice::from_ref(&folder.path().to_owned()), &few, 0).unwrap();
    assert_eq!(capture.states.iter().map(Vec::len).collect::<Vec<_>>(), [4, 4]);
    assert!(capture.notes.iter().any(|n| n.text.contains("4 of 10 views kept")), "{:?}", capture.notes);
    few.topics.depth = Some("/nope".into());
    assert!(matches!(
        open(std::slice::from_ref(&folder.path().to_owned()), &few, 0),
        Err(CaptureError::BadTopic { .. })
    ));
}

#[test]
fn distorted_images_are_undistorted() {
    let (_folder, capture) = states_with(|o| {
        o.distortion = ("rational_polynomial", vec![0.05, 0.0, 0.001, 0.0, 0.0, 0.0, 0.0, 0.0])
    });
    let capture = capture.unwrap();
    assert!(capture.notes.iter().any(|n| n.text.contains("undistorted")));
    let truth = render(0, 0);
    let differing = capture.states[0][0].rgb.iter().zip(&truth.rgb).filter(|(a, b)| a != b).count();
    assert!(differing > truth.rgb.len() / 4, "{differing}");
    // The principal point stays, but for the tangential part.
    let center = 44 * CAMERA.width + 60;
    assert!(capture.states[0][0].rgb[center].iter().zip(truth.rgb[center]).all(|(a, b)| a.abs_diff(b) < 20));
}

#[test]
fn without_masks_the_floor_goes_and_both_boxes_stay() {
    let (folder, capture) = states_with(|o| o.mask = false);
    let capture = capture.unwrap();
    let mut counts = [0usize; 4];
    for (state, frames) in capture.states.iter().enumerate() {
        for (i, frame) in frames.iter().enumerate() {
            let truth = render(state, i);
            let mask = frame.mask.as_ref().unwrap();
            for p in 0..mask.len() {
                // Pixels without depth speak for nothing.
                let seen = mask[p] && frame.depth_m[p] > 0.0;
                counts[usize::from(seen) + 2 * usize::from(truth.mask[p])] += 1;
            }
        }
    }
    let [_, wrong, missed, right] = counts.map(|c| c as f64);
    assert!(wrong < 0.002 * right, "{counts:?}");
    assert!(missed < 0.12 * right, "{counts:?}");
    let note = capture.notes.iter().find(|n| n.text.contains("background plane taken away")).unwrap();
    assert!(note.text.replace('-', "").contains("normal (0.000, 0.000, 1.000), 0.000"), "{note}");

    let again = open_one(&folder.path().join("cabinet")).unwrap();
    for (a, b) in capture.states.iter().flatten().zip(again.states.iter().flatten()) {
        assert_eq!((&a.mask, &a.depth_m), (&b.mask, &b.depth_m));
    }

    // A box around the larger box alone.
    let mut boxed = config();
    boxed.isolate.workspace = Some([[-0.2, -0.2, -0.1], [0.08, 0.2, 0.3]]);
    let capture = open(&[folder.path().join("cabinet")], &boxed, 0).unwrap();
    for frame in capture.states.iter().flatten() {
        for p in (0..frame.depth_m.len()).filter(|p| frame.is_object(*p)) {
            if let Some(q) = frame.world_point(p) {
                assert!(q.x <= 0.08 && q.z > 0.0);
            }
        }
    }
}

#[test]
fn states_in_different_places_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for state in 0..2 {
        write_state(&folder.path().join(format!("state{state}")), state, &Options::default());
    }
    // State 1 again, with the camera's poses shifted by a meter.
    let plain = std::fs::read(folder.path().join("state1/state1.mcap")).unwrap();
    let mut writer = BagWriter::create(&folder.path().join("state1/state1.mcap"), None, 100_000);
    for m in mcap::MessageStream::new(&plain).unwrap() {
        let m = m.unwrap();
        let type_name = m.channel.schema.as_ref().unwrap().name.clone();
        let mut data = m.data.to_vec();
        if m.channel.topic == "/tf" {
            let mut tf: io::ros2msg::TfMessage = io::ros2msg::decode(&data).unwrap();
            tf.transforms[0].transform.translation.x += 1.0;
            data = io::ros2msg::encode(&tf).unwrap();
        }
        writer.bytes(&m.channel.topic, &type_name, "cdr", m.log_time as i64, &data);
    }
    writer.finish();
    let error = open_one(folder.path()).unwrap_err();
    assert!(matches!(error, CaptureError::NoOverlap { .. }), "{error}");
}

#[test]
fn dataset_folders_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let keyframes = folder.path().join("washer");
    write_keyframes(&keyframes);
    let capture = open_one(&keyframes).unwrap();
    check_frames(&capture, "keyframes", 0.0);
    assert_eq!((capture.name.as_str(), capture.matches.len()), ("washer", 0));
    assert!(inspect(&keyframes).unwrap().is_usable());

    // Matches of frames 0_0001 and 1_0002 (tests/golden), of images larger than these.
    let matches = keyframes.join("correspondence_loftr/no_filter");
    std::fs::create_dir_all(&matches).unwrap();
    let golden = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden/matches.npz");
    std::fs::copy(golden, matches.join("src_0_0001_tgt_all_top30.npz")).unwrap();
    let capture = open_one(&keyframes).unwrap();
    let frames: Vec<_> = capture.matches.iter().map(|m| (m.frame0, m.frame1, m.pixel0)).collect();
    assert_eq!(frames, [(1, 2, [10.0, 20.0]), (1, 2, [7.5, 8.25]), (1, 9, [1.0, 2.0])]);
    assert!(
        capture.warnings.iter().any(|w| w.text.contains("2 matches lie outside")),
        "{:?}",
        capture.warnings
    );

    let pairs = folder.path().join("stapler");
    write_start_end(&pairs, true);
    check_frames(&open_one(&pairs).unwrap(), "start/end", 0.0);
    let bare = folder.path().join("bare");
    write_start_end(&bare, false);
    let text = open_one(&bare).unwrap_err().to_string();
    assert!(text.contains("depth is needed") && text.contains("millimeters"), "{text}");
}

#[test]
fn inspection_tells_what_there_is() {
    let folder = tempfile::tempdir().unwrap();
    write_states(&folder.path().join("good"), &Options::default());
    let seen = inspect(&folder.path().join("good")).unwrap();
    assert!(seen.is_usable());
    let text = seen.to_text();
    for word in [
        COLOR,
        DEPTH,
        "16UC1",
        "120x90",
        "5.0 Hz",
        "world -> camera_link (20 samples",
        "posed RGB-D views: 10",
        "usable: yes",
    ] {
        assert!(text.contains(word), "{word}: {text}");
    }
    write_states(
        &folder.path().join("bad"),
        &Options { depth: DepthKind::None, depth_info: false, ..Options::default() },
    );
    let seen = inspect(&folder.path().join("bad")).unwrap();
    assert!(!seen.is_usable() && seen.to_text().contains("no depth topic"));
    write_state(&folder.path().join("half/state0"), 0, &Options::default());
    let text = inspect(&folder.path().join("half")).unwrap().to_text();
    assert!(text.contains("usable: no") && text.contains("two states are needed"), "{text}");
}

/// Bytes changed where no checksum guards them: whatever comes out, nothing panics and errors are sentences.
#[test]
fn changed_bytes_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    write_states(folder.path(), &Options { chunk_bytes: 0, compression: None, ..Options::default() });
    let file = folder.path().join("state0/state0.mcap");
    let whole = std::fs::read(&file).unwrap();
    let mut state = 0x2545_f491_4f6c_dd1du64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state as usize
    };
    let mut failed = 0;
    for _ in 0..60 {
        let mut bytes = whole.clone();
        for _ in 0..20 {
            // Most bytes are pixels; the fields that matter lie in the first tenth of each message.
            let at = random() % bytes.len();
            bytes[at] = random() as u8;
            let record = random() % 40 * (whole.len() / 40);
            bytes[(record + random() % 120).min(whole.len() - 1)] ^= 1 << (random() % 8);
        }
        std::fs::write(&file, &bytes).unwrap();
        if let Err(error) = open_one(folder.path()) {
            failed += 1;
            assert!(error.to_string().len() > 20);
        }
    }
    println!("{failed} of 60 refused");
}
