//! Recordings and options that cannot be used, given to the program: it says what, where and the remedy, ends
//! with the right code, and leaves nothing behind. What can be used in part is used, and said.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

mod common;
#[path = "common/program.rs"]
mod program;

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use common::{BagWriter, START};
use io::{
    Place, ResultKind, RunDir,
    ros2msg::{CompressedImage, Image, TfMessage, decode, encode},
};
use program::{Ended, Message, change_picture, drawer, end, reconstruct, rewrite, shipped};
use tempfile::TempDir;

const COLOR: &str = "/color/image_raw/compressed";
const DEPTH: &str = "/aligned_depth_to_color/image_raw/compressedDepth";
const PROGRAM: &str = env!("CARGO_BIN_EXE_artitwin");
/// What the first stage says.
const BEGUN: &str = "capture: started";

/// Asserts that a message holds all words.
fn says(ended: &Ended, words: &[&str]) {
    for word in words {
        assert!(ended.stderr.contains(word), "`{word}` is not in:\n{}", ended.stderr);
    }
}

/// Runs on sources that must be refused; `out` is not there before and must not be there after.
fn refused(folder: &TempDir, sources: &[&Path], options: &[&str], code: i32, words: &[&str]) -> Ended {
    let out = folder.path().join("runs");
    let ended = end(&mut reconstruct(sources, &out, options));
    assert_eq!(ended.code, code, "{}", ended.stderr);
    says(&ended, words);
    let last = ended.stderr.lines().last().unwrap();
    assert!(last.starts_with("error: "), "the last line is: {last}");
    assert_eq!(ended.stdout, "");
    let left: Vec<_> =
        std::fs::read_dir(&out).into_iter().flatten().flatten().map(|e| e.file_name()).collect();
    assert!(!out.exists(), "left behind: {left:?}");
    ended
}

/// A drawer whose messages went through `change` must be refused with code 1.
fn refused_drawer(words: &[&str], change: impl FnMut(usize, &mut Message) -> bool) -> Ended {
    let folder = tempfile::tempdir().unwrap();
    let bag = drawer(&folder, change);
    refused(&folder, &[&bag], &["--parts", "2"], 1, words)
}

/// A drawer that must give a degraded result that tells all words in its warnings too.
fn degraded(folder: &TempDir, bag: &Path, words: &[&str]) {
    let out = folder.path().join("runs");
    let ended = end(&mut reconstruct(&[bag], &out, &["--parts", "2"]));
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(ended.stdout.contains("degraded: "), "{}", ended.stdout);
    says(&ended, words);
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("drawer/report.json")).unwrap()).unwrap();
    let warnings = report["warnings"].to_string();
    words.iter().for_each(|word| assert!(warnings.contains(word), "`{word}` is not in {warnings}"));
    assert!(out.join("drawer/drawer.urdf").is_file());
}

fn change_tf(message: &mut Message, change: impl FnOnce(&mut TfMessage)) {
    let mut tf: TfMessage = decode(&message.data).unwrap();
    change(&mut tf);
    message.data = encode(&tf).unwrap();
}

#[test]
fn no_depth_topic() {
    let words = [
        "no depth topic",
        "drawer/state0",
        "candidates looked at: /camera/camera/color",
        "enable_depth",
        "--topic depth=TOPIC",
    ];
    refused_drawer(&words, |_, m| !m.topic.contains("depth"));
}

#[test]
fn a_gap_in_the_transforms_costs_the_frames_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let bag = drawer(&folder, |state, m| !(state == 0 && m.is("/tf") && (12..20).contains(&m.ordinal)));
    let words = ["state 0: 4 of 16 frames have no camera pose", "a gap of ", "capture.tf_max_gap_secs = 0.5"];
    degraded(&folder, &bag, &words);
}

#[test]
fn no_transforms_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let bag = drawer(&folder, |_, m| !m.is("/tf"));
    let words = ["comes from static transforms alone", "camera_color_optical_frame", "--topic pose=TOPIC"];
    refused(&folder, &[&bag], &["--parts", "2", "--set", "capture.tracking=never"], 1, &words);
    // By default the camera is tracked, and what was lost of it is said.
    degraded(&folder, &bag, &["the camera was lost from", "which are not used: "]);
}

#[test]
fn transforms_of_another_clock_are_moved_to_that_of_the_images() {
    let folder = tempfile::tempdir().unwrap();
    let bag = drawer(&folder, |state, m| {
        let late = |tf: &mut TfMessage| tf.transforms.iter_mut().for_each(|t| t.header.stamp.sec += 100);
        if state == 1 && m.is("/tf") {
            change_tf(m, late);
        }
        true
    });
    degraded(&folder, &bag, &["stamps that are 100.000 s off those of the images", "give both one clock"]);
}

#[test]
fn states_without_overlap() {
    let words = [
        "states 0 and 1 have no place in common",
        "the static part must stand still",
        "check the camera poses",
    ];
    refused_drawer(&words, |state, m| {
        if state == 1 && m.is("/tf") {
            change_tf(m, |tf| tf.transforms[0].transform.translation.x += 1.0);
        }
        true
    });
}

#[test]
fn one_state_only() {
    let folder = tempfile::tempdir().unwrap();
    rewrite(&shipped("drawer/state0"), &folder.path().join("drawer/state0"), |_| true);
    let words = ["two states are needed", "folder with `state0` and `state1`", "--split"];
    for path in [
        folder.path().join("drawer"),
        folder.path().join("drawer/state0"),
        folder.path().join("drawer/state0/state0.mcap"),
    ] {
        let told = path.display().to_string();
        let words = [&words[..], &[&*told]].concat();
        refused(&folder, &[&path], &["--parts", "2"], 1, &words);
    }
}

#[test]
fn one_recording_given_twice() {
    let folder = tempfile::tempdir().unwrap();
    let state = shipped("drawer/state0");
    refused(
        &folder,
        &[&state, &state],
        &["--parts", "2"],
        1,
        &["one recording was given twice", "after the joints were moved"],
    );
}

#[test]
fn no_motion_between_the_states() {
    // The even and the odd images of one state: other views and other noise, but nothing moved.
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("drawer");
    for state in 0..2 {
        let keep = |m: &mut Message| {
            !(m.topic.contains("image_raw") || m.is("/object_mask")) || m.ordinal % 2 == state
        };
        rewrite(&shipped("drawer/state0"), &bag.join(format!("state{state}")), keep);
    }
    let words = [
        "no part moved between the two states",
        "stands still",
        "record the second state with the joints moved",
    ];
    refused(&folder, &[&bag], &["--parts", "2"], 1, &words);
}

#[test]
fn a_number_of_parts_that_no_run_can_have() {
    let folder = tempfile::tempdir().unwrap();
    let bag = shipped("drawer");
    for parts in ["0", "1", "17"] {
        let reason = format!("run.parts: {parts} parts; give 2 to 16, the static part included (--parts)");
        let ended = refused(&folder, &[&bag], &["--parts", parts], 2, &[&reason]);
        assert!(!ended.stderr.contains(BEGUN), "{}", ended.stderr);
    }
    let ended = end(&mut reconstruct(&[&bag], &folder.path().join("runs"), &["--parts", "two"]));
    assert_eq!(ended.code, 2);
    says(&ended, &["'two'", "--parts <N>"]);
}

#[test]
fn more_parts_than_the_recording_carries() {
    let folder = tempfile::tempdir().unwrap();
    let words = ["9 parts were asked for, but 2 are supported", "ask for 2 parts"];
    refused(&folder, &[&shipped("drawer")], &["--parts", "9"], 1, &words);
}

#[test]
fn what_radiance_fields_cannot_do_is_refused_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let radiance = ["--set", "run.method=radiance"];
    let many = [&radiance[..], &["--set", "run.init=identity", "--set", "radiance.many_parts=true"]].concat();
    let ended = refused(&folder, &[&shipped("drawer")], &many, 1, &["give it with --parts N"]);
    assert!(!ended.stderr.contains(BEGUN), "{}", ended.stderr);
    let burn = [&radiance[..], &["--set", "run.engine=burn"]].concat();
    let words = ["run.engine: radiance fields are trained on the CPU"];
    refused(&folder, &[&shipped("drawer")], &burn, 2, &words);
}

#[test]
fn all_depth_invalid() {
    let words = ["state 0: all depth is invalid", "10 frames", "16UC1 is millimeters", "capture.depth_max_m"];
    // Twelve bytes stand before the picture of a compressedDepth message.
    let blacken = |picture: &mut image::DynamicImage| picture.as_mut_luma16().unwrap().fill(0);
    refused_drawer(&words, |_, m| {
        if m.is(DEPTH) {
            change_picture(m, 12, image::ImageFormat::Png, blacken);
        }
        true
    });
}

#[test]
fn masks_that_hold_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let bag = drawer(&folder, |_, m| {
        if m.is("/object_mask") {
            let mut mask: Image = decode(&m.data).unwrap();
            mask.data.fill(0);
            m.data = encode(&mask).unwrap();
        }
        true
    });
    degraded(&folder, &bag, &["/object_mask are no masks of an object (they are empty) and are not used"]);
}

fn nan(tf: &mut TfMessage) {
    tf.transforms[0].transform.rotation.x = f64::NAN;
}

#[test]
fn poses_that_are_not_a_number() {
    let folder = tempfile::tempdir().unwrap();
    let bag = drawer(&folder, |_, m| {
        if m.is("/tf") {
            change_tf(m, nan);
        }
        true
    });
    let tracked = "the camera is tracked by the images: all 32 camera poses on `/tf` are invalid";
    degraded(&folder, &bag, &[tracked, "NaN", "check the odometry or robot driver"]);
}

#[test]
fn some_poses_that_are_not_a_number() {
    let folder = tempfile::tempdir().unwrap();
    let bag = drawer(&folder, |state, m| {
        // The last images have no pose after them then.
        if state == 1 && m.is("/tf") && m.ordinal >= 28 {
            change_tf(m, nan);
        }
        true
    });
    degraded(
        &folder,
        &bag,
        &["state 1: 2 of 16 frames have no camera pose", "state 1: 4 transforms from /tf are invalid (NaN"],
    );
}

/// A drawer whose file of state 0 is changed as a whole.
fn damaged(folder: &TempDir, change: impl FnOnce(&mut Vec<u8>)) -> PathBuf {
    let bag = drawer(folder, |_, _| true);
    let file = bag.join("state0/state0.mcap");
    let mut bytes = std::fs::read(&file).unwrap();
    change(&mut bytes);
    std::fs::write(&file, bytes).unwrap();
    bag
}

#[test]
fn a_truncated_bag_is_used_as_far_as_it_goes() {
    let folder = tempfile::tempdir().unwrap();
    let bag = damaged(&folder, |bytes| bytes.truncate(bytes.len() * 7 / 10));
    degraded(&folder, &bag, &["state0.mcap` is damaged: reading stopped early", "messages were read"]);
}

#[test]
fn a_corrupt_bag_is_used_but_for_its_damaged_chunks() {
    let folder = tempfile::tempdir().unwrap();
    let bag = damaged(&folder, |bytes| {
        let middle = bytes.len() / 2;
        bytes[middle..middle + 40].iter_mut().for_each(|b| *b ^= 0xa5);
    });
    degraded(
        &folder,
        &bag,
        &["state0.mcap` is damaged: 1 of ", "chunks left out as damaged", "messages were read"],
    );
}

#[test]
fn a_bag_of_which_nothing_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    for length in [0, 20] {
        let bag = damaged(&folder, |bytes| bytes.truncate(length));
        let words = ["state0/state0.mcap` is damaged and nothing in it could be read", "copy the file again"];
        refused(&folder, &[&bag], &["--parts", "2"], 1, &words);
    }
}

#[test]
fn color_of_16_bits() {
    let words = ["/camera/camera/color/image_raw: encoding `rgb48` is not supported", "rgb8"];
    refused_drawer(&words, |_, m| {
        if m.is(COLOR) {
            let compressed: CompressedImage = decode(&m.data).unwrap();
            let (width, height) = (320, 240);
            let data = vec![0; 6 * width * height];
            let (header, encoding) = (compressed.header, "rgb48".to_owned());
            let (w, h, step) = (width as u32, height as u32, 6 * width as u32);
            m.data = encode(&Image { header, height: h, width: w, encoding, is_bigendian: 0, step, data })
                .unwrap();
            m.topic = m.topic.trim_end_matches("/compressed").to_owned();
            m.type_name = "sensor_msgs/msg/Image".to_owned();
        }
        true
    });
}

#[test]
fn images_of_changing_size() {
    let words = ["image of 160x120", "320x240", "one size", "record again with a fixed profile"];
    refused_drawer(&words, |state, m| {
        if state == 1 && m.is(COLOR) && m.ordinal >= 5 {
            change_picture(m, 0, image::ImageFormat::Jpeg, |picture| {
                *picture = picture.crop_imm(0, 0, 160, 120)
            });
        }
        true
    });
}

#[test]
fn a_bag_of_another_type() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("chat");
    for state in 0..2 {
        std::fs::create_dir_all(&bag).unwrap();
        let mut writer = BagWriter::create(&bag.join(format!("state{state}.mcap")), None, 1000);
        writer.message("/chatter", "std_msgs/msg/String", START, &"hello");
        writer.finish();
    }
    let words = [
        "is not an RGB-D recording",
        "/chatter (std_msgs/msg/String, 1)",
        "record color, aligned depth, camera_info and /tf",
    ];
    refused(&folder, &[&bag], &["--parts", "2"], 1, &words);
}

#[test]
fn a_bag_in_sqlite3_storage() {
    let folder = tempfile::tempdir().unwrap();
    for state in 0..2 {
        let bag = folder.path().join(format!("old/state{state}"));
        std::fs::create_dir_all(&bag).unwrap();
        std::fs::write(bag.join(format!("state{state}_0.db3")), b"SQLite format 3\0").unwrap();
    }
    // By what it begins with, whatever its name is.
    std::fs::write(folder.path().join("renamed.mcap"), b"SQLite format 3\0and its pages").unwrap();
    std::fs::create_dir_all(folder.path().join("listed")).unwrap();
    std::fs::write(folder.path().join("listed/a.bag"), b"SQLite format 3\0").unwrap();
    let metadata = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: ''\n  \
                    relative_file_paths: [a.bag]\n";
    std::fs::write(folder.path().join("listed/metadata.yaml"), metadata).unwrap();
    let twin = folder.path().join("twin.urdf");
    let robot = "<robot name='r'><link name='a'/><link name='b'/><joint name='j' type='continuous'>\
                 <parent link='a'/><child link='b'/></joint></robot>";
    std::fs::write(&twin, robot).unwrap();
    let words = [
        "is an sqlite3 (.db3) bag",
        "`rosbags-convert --src ",
        "_mcap --dst-storage mcap`",
        "`ros2 bag convert -i ",
        " -o convert.yaml` with this line in convert.yaml: `output_bags: [{uri: ",
        "storage_id: mcap, all: true}]`",
    ];
    for name in ["old", "old/state0", "old/state0/state0_0.db3", "renamed.mcap", "listed"] {
        let path = folder.path().join(name);
        refused(&folder, &[&path], &["--parts", "2"], 1, &words);
        let ended = end(Command::new(PROGRAM).arg("inspect").arg(&path));
        assert_eq!(ended.code, 1, "{name}: {}", ended.stderr);
        says(&ended, &words);
        if name != "old" {
            let ended = end(Command::new(PROGRAM)
                .arg("diagnose")
                .arg(&twin)
                .args([&path, &path, &path])
                .arg("--out")
                .arg(folder.path().join("gap")));
            assert_eq!(ended.code, 1, "{name}: {}", ended.stderr);
            says(&ended, &words);
        }
    }
}

#[test]
fn a_folder_without_bags() {
    let folder = tempfile::tempdir().unwrap();
    let papers = folder.path().join("papers");
    std::fs::create_dir_all(&papers).unwrap();
    let words =
        ["papers` is not a recording: the folder is empty", "give a rosbag2 folder, an .mcap or .bag file"];
    refused(&folder, &[&papers], &["--parts", "2"], 1, &words);
    std::fs::write(papers.join("notes.txt"), "hello").unwrap();
    refused(
        &folder,
        &[&papers],
        &["--parts", "2"],
        1,
        &["papers` is not a recording: the folder holds notes.txt"],
    );
    refused(&folder, &[&papers.join("notes.txt")], &["--parts", "2"], 1, &["begins neither as an MCAP file"]);
    let ended = refused(
        &folder,
        &[&folder.path().join("gone")],
        &["--parts", "2"],
        1,
        &["cannot read `", "gone`", "No such file"],
    );
    assert_eq!(ended.stderr.matches("No such file").count(), 1, "{}", ended.stderr);
}

#[test]
fn an_out_that_cannot_be_written_is_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("notes.txt");
    std::fs::write(&file, "mine").unwrap();
    let mut outs = vec![file.clone(), file.join("runs")];
    if cfg!(target_os = "linux") {
        // Not even root can make a folder there.
        outs.push("/proc/artitwin-runs".into());
    }
    for out in outs {
        let ended = end(&mut reconstruct(&[&shipped("drawer")], &out, &["--parts", "2"]));
        assert_eq!(ended.code, 1, "{}", ended.stderr);
        says(&ended, &["cannot write into ", "choose another --out or make it writable"]);
        assert!(!ended.stderr.contains(BEGUN), "{}", ended.stderr);
    }
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "mine");
}

#[test]
fn what_stands_under_the_final_name_is_never_harmed() {
    let folder = tempfile::tempdir().unwrap();
    let (out, mine) = (folder.path().join("runs"), folder.path().join("runs/drawer/notes.txt"));
    std::fs::create_dir_all(mine.parent().unwrap()).unwrap();
    std::fs::write(&mine, "mine").unwrap();
    let ended = end(&mut reconstruct(&[&shipped("drawer")], &out, &["--parts", "2"]));
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    says(
        &ended,
        &[
            "runs/drawer is left as it is: it holds notes.txt, and no manifest.json",
            "give another --out or --name, or --force",
        ],
    );
    assert!(!ended.stderr.contains(BEGUN), "{}", ended.stderr);
    assert_eq!(std::fs::read_to_string(&mine).unwrap(), "mine");
    std::fs::remove_dir_all(out.join("drawer")).unwrap();

    // An earlier result may be replaced, but a run that fails leaves it as it was.
    let run = RunDir::open(&Place::named(&out, "drawer"), ResultKind::Reconstruct).unwrap();
    run.put("report.json", b"{}").unwrap();
    run.commit().unwrap();
    let bag = drawer(&folder, |_, m| !m.topic.contains("depth"));
    let ended = end(&mut reconstruct(&[&bag], &out, &["--parts", "2"]));
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    assert!(ended.stderr.contains(BEGUN), "{}", ended.stderr);
    assert_eq!(std::fs::read_to_string(out.join("drawer/report.json")).unwrap(), "{}");
    let names: Vec<_> = std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names, ["drawer"]);
}

#[test]
fn settings_that_no_run_can_use_are_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    for (setting, key) in [
        ("train.rays=0", "train.rays: 0;"),
        ("surface.nodes=2", "surface.nodes: 2;"),
        ("model.effort=0", "model.effort: 0;"),
    ] {
        let ended = refused(
            &folder,
            &[&shipped("drawer")],
            &["--parts", "2", "--set", setting],
            2,
            &[key, "(--set)"],
        );
        assert!(!ended.stderr.contains(BEGUN), "{}", ended.stderr);
    }
    for setting in ["train.noise.constant_m=1", "train.stepz=1", "capture.seed=1"] {
        refused(
            &folder,
            &[&shipped("drawer")],
            &["--parts", "2", "--set", setting],
            2,
            &["unknown key", "did you mean"],
        );
    }
}
