//! Recordings: MCAP files, what they hold, the folder around them.

use capture::CaptureConfig;
use common::stop::Stop;
use gap::record::{command::Told, drive::Hold, inputs::complete_run, tracks::Streams};
use io::{inspect, read_frame_run, read_joint_log, twin_of};

use super::{
    engine::{BYTES, Scratch, Target, plain, whole},
    recorded::{Style, WORDS, bag, frames, joint_log},
};

fn looked_into(path: &std::path::Path) -> bool {
    let Ok(found) = inspect(path) else { return false };
    for recording in &found.recordings {
        assert!(recording.span_secs.is_none_or(|(first, last)| first <= last), "{:?}", recording.span_secs);
        assert!(recording.views == 0 || recording.problem.is_none());
        assert!(
            recording.topics.iter().all(|t| t.rate_hz.is_none_or(|r| r >= 0.0)),
            "{:?}",
            recording.topics
        );
    }
    found.recordings.iter().any(|r| r.views > 0)
}

fn recordings() -> [Vec<Vec<u8>>; 6] {
    [
        frames(Style::Raw, 1, 1),
        frames(Style::Png, 2, 1),
        frames(Style::Rvl, 0, 1),
        frames(Style::Raw, 3, 2),
        frames(Style::Png, 1, 3),
        frames(Style::Rvl, 2, 2),
    ]
}

/// Bytes of a file: header, index, chunks, damage anywhere.
#[test]
fn bytes() {
    let name = "bags::bytes";
    let scratch = Scratch::new(name);
    let seeds = whole(recordings().map(|parts| bag(&parts)));
    let target = Target { name, seeds, words: &WORDS, assemble: plain, bytes: BYTES };
    target.run(|input| looked_into(&scratch.put("bag.mcap", input)));
}

/// Records in whole chunks, looked into.
#[test]
fn records() {
    let name = "bags::records";
    let scratch = Scratch::new(name);
    let target = Target { name, seeds: recordings().to_vec(), words: &WORDS, assemble: bag, bytes: BYTES };
    target.run(|input| looked_into(&scratch.put("bag.mcap", input)));
}

/// Records in whole chunks, with the pixels of the frames.
#[test]
fn views() {
    let name = "bags::views";
    let scratch = Scratch::new(name);
    let config = CaptureConfig::default();
    let seeds = [frames(Style::Raw, 3, 1), frames(Style::Png, 0, 1), frames(Style::Rvl, 0, 1)].to_vec();
    let target = Target { name, seeds, words: &WORDS, assemble: bag, bytes: BYTES };
    target.run(|input| {
        let bag = scratch.put("bag.mcap", input);
        let Ok((run, _)) = read_frame_run(&bag, &config, &mut Vec::new(), &Stop::never()) else {
            return false;
        };
        let range = config.depth_min_m as f32..=config.depth_max_m as f32;
        for frame in &run.frames {
            let pixels = frame.intrinsics.width * frame.intrinsics.height;
            assert_eq!((frame.rgb.len(), frame.depth_m.len()), (pixels, pixels));
            assert!(frame.mask.as_ref().is_none_or(|m| m.len() == pixels));
            assert!(frame.depth_m.iter().all(|d| *d == 0.0 || range.contains(d)));
            assert!(frame.world_from_camera.to_homogeneous().iter().all(|x| x.is_finite()));
        }
        !run.frames.is_empty()
    });
}

const DOOR: &str = r#"<robot name="twin"><link name="base"/><link name="door"><inertial><mass value="2"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link><link name="handle"/><link name="tray"/>
<joint name="hinge" type="revolute"><parent link="base"/><child link="door"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="3" effort="9" velocity="9"/></joint>
<joint name="grip" type="fixed"><parent link="door"/><child link="handle"/><origin xyz="1 0 0"/></joint>
<joint name="slide" type="prismatic"><parent link="door"/><child link="tray"/><axis xyz="1 0 0"/>
<limit lower="0" upper="3" effort="9" velocity="9"/></joint></robot>"#;

/// Joint states, wrenches and poses, up to the fit.
#[test]
fn joint_logs() {
    let name = "bags::joint_logs";
    let scratch = Scratch::new(name);
    let tree = twin_of(DOOR, [0.0, 0.0, -9.81]).unwrap();
    let names = ["hinge".to_owned(), "slide".to_owned()];
    let streams = Streams {
        wrenches: vec![("/wrench".into(), "handle".into())],
        poses: vec![("/door_pose".into(), "door".into())],
        commands: Vec::new(),
        links: tree.links.iter().map(|l| l.name.clone()).collect(),
        joints: Vec::new(),
    };
    let seeds = vec![joint_log(0, 101), joint_log(3, 104)];
    let words = [&WORDS[..], &["hinge", "slide", "door", "base", "/wrench", "/door_pose"]].concat();
    let target = Target { name, seeds, words: &words, assemble: bag, bytes: BYTES };
    target.run(|input| {
        let path = scratch.put("run.mcap", input);
        let streams = if input.len().is_multiple_of(2) {
            &streams
        } else {
            &Streams { links: streams.links.clone(), ..Streams::default() }
        };
        let Ok(mut run) = read_joint_log(&path, streams) else { return false };
        for joint in &run.joints {
            assert_eq!((joint.position.len(), joint.effort.len()), (joint.time_s.len(), joint.time_s.len()));
        }
        if complete_run(&mut run, &tree, Hold::Sampled).is_err() {
            return false;
        }
        let mut usable = false;
        for joint in &names {
            let Ok(log) = run.joint(joint, &names, &Told::default(), &mut Vec::new()) else { continue };
            assert!(log.time_s.windows(2).all(|pair| pair[0] < pair[1]));
            assert!(log.position.iter().chain(&log.effort).all(|x| x.is_finite()));
            assert!(log.others.iter().all(|o| o.len() == log.time_s.len()));
            usable = true;
        }
        usable
    });
}

/// `metadata.yaml` beside the file, whose messages may be compressed one by one.
#[test]
fn metadata() {
    let name = "bags::metadata";
    let scratch = Scratch::new(name);
    let yaml = |mode: &str, format: &str| {
        format!(
            "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n  duration: \
             {{nanoseconds: 1}}\n  \
             compression_format: '{format}'\n  compression_mode: '{mode}'\n  relative_file_paths:\n    - \
             bag.mcap\n  custom_data: ~\n"
        )
    };
    scratch.put("bag.mcap", bag(&frames(Style::Raw, 3, 1)));
    let shipped = include_str!("../../bags/drawer/state0/metadata.yaml").replace("state0.mcap", "bag.mcap");
    let seeds = whole([yaml("", ""), yaml("none", "zstd"), yaml("file", "zstd"), shipped]);
    let words = [
        "sqlite3",
        "mcap",
        "message",
        "MESSAGE",
        "file",
        "zstd",
        "../bag.mcap",
        "/bag.mcap",
        "bag.db3",
        "[",
        "{",
        "&a ",
        "*a",
    ];
    let target = Target { name, seeds, words: &words, assemble: plain, bytes: BYTES };
    target.run(|input| {
        scratch.put("metadata.yaml", input);
        looked_into(&scratch.0)
    });
}
