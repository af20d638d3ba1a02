//! The ROS 2 node among neighbors that are not made of it: Cyclone DDS and rosbags, on the loopback network,
//! every test in a domain of its own.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stderr,
    reason = "a test may panic, and says why it is left out"
)]

mod common;
#[path = "common/doors.rs"]
mod doors;
#[path = "common/harness.rs"]
mod harness;
#[path = "common/opened.rs"]
mod opened;
#[path = "common/program.rs"]
mod program;
#[path = "common/ros.rs"]
mod ros;
#[path = "common/venv.rs"]
mod venv;

use std::{path::Path, process::ExitCode};

use geometry::Pose;
use harness::{Missing, tests};
use opened::open;
use program::{SMALL, end, reconstruct, shipped};
use ros::{Node, lossy_scenario, scenario, serial, with_fastdds};
use tempfile::TempDir;

fn main() -> ExitCode {
    harness::main(tests![
        a_session_has_one_node,
        a_replayed_recording_gives_the_twin_of_the_command_line,
        three_hundred_frames_at_30_hz_arrive,
        images_that_are_lost_on_the_way_are_counted,
        ten_thousand_broken_messages_are_counted_and_do_no_harm,
        simulated_time_may_jump_back,
        a_camera_without_transforms_is_followed_and_its_poses_come_back,
        what_is_collected_is_shown_as_it_comes,
        camera_poses_may_come_as_pose_or_odometry,
        a_publisher_may_be_killed_and_another_go_on,
        transforms_images_and_clock_may_jump_back,
        a_session_is_saved_and_another_begun,
        a_diagnosis_is_asked_for_canceled_and_published,
        the_node_is_seen_under_its_name,
        states_are_found_without_a_call,
        a_crash_loses_nothing_that_was_there_for_a_second,
        what_is_recorded_is_what_was_published,
        what_cannot_work_is_refused_at_the_start;
        on request:
        a_replayed_raw_recording_gives_the_twin_of_the_command_line =
            "the same with raw images: 1 minute more",
        a_replayed_recording_of_ones_own_gives_the_twin_of_the_command_line =
            "needs a recording with the topics of bags/drawer, named by ARTITWIN_BAG; 4 minutes for 30 views",
        a_hundred_thousand_broken_messages_are_counted_and_do_no_harm = "1e5 messages: 2 minutes",
        ten_minutes_of_images_need_no_more_memory_than_one = "10 minutes of images at 30 Hz",
    ])
}

/// Parameters that make a run of the node the one of [`reconstruct`] with [`SMALL`].
fn small_run(folder: &TempDir, raw: bool) -> Vec<String> {
    let settings = SMALL.map(|s| format!("'{s}'")).join(", ");
    let mut parameters = vec![
        "preset:=preview".to_owned(),
        format!("settings:=[{settings}]"),
        "parts:=2".to_owned(),
        "twin_name:=drawer".to_owned(),
        "session:=session".to_owned(),
        format!("out_folder:={}", folder.path().join("node").display()),
        "mask_topic:=/object_mask".to_owned(),
        "image_qos:=default".to_owned(),
    ];
    if !raw {
        parameters.extend([
            "color_transport:=compressed".to_owned(),
            "depth_transport:=compressedDepth".to_owned(),
        ]);
    }
    parameters
}

/// Numbers of a URDF's joints: every attribute value of every element below `joint`.
fn joints(urdf: &Path) -> Vec<(String, Vec<f64>)> {
    let robot = urdf_rs::read_file(urdf).unwrap();
    let numbers = |j: &urdf_rs::Joint| {
        [&j.origin.xyz.0[..], &j.origin.rpy.0, &j.axis.xyz.0, &[j.limit.lower, j.limit.upper]].concat()
    };
    robot
        .joints
        .iter()
        .map(|j| (format!("{} {:?} {} {}", j.name, j.joint_type, j.parent.link, j.child.link), numbers(j)))
        .collect()
}

/// A whole session: both states from bags at the pace of their recording, a goal that is canceled, one that
/// is not, and everything that is published then. The twin is that of the command line.
fn session(bag: &Path, domain: u16, raw: bool, cancel: bool) -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let node = Node::start(domain, &small_run(&folder, raw));
    let states = [0, 1].map(|s| bag.join(format!("state{s}")).display().to_string());
    let mut arguments = vec!["session", &states[0], &states[1]];
    arguments
        .extend([(raw, "--raw"), (cancel, "--cancel")].into_iter().filter(|(on, _)| *on).map(|(_, a)| a));
    let told = scenario(&python, domain, &arguments);
    let log = node.end();
    assert!(!log.contains("panicked"), "{log}");
    taken_up(&python, domain, &folder, &small_run(&folder, raw), &told);

    let cli = folder.path().join("cli");
    let ended = end(&mut reconstruct(&[bag], &cli, &["--parts", "2", "--name", "drawer"]));
    assert!(ended.code == 0 || ended.code == 3, "{}", ended.stderr);
    let twin = folder.path().join("node/session/drawer");
    assert_eq!(Path::new(told["folder"].as_str().unwrap()), twin);
    let (by_node, by_cli) = (joints(&twin.join("drawer.urdf")), joints(&cli.join("drawer/drawer.urdf")));
    assert_eq!(by_node.len(), by_cli.len());
    for ((name, a), (other, b)) in by_node.iter().zip(&by_cli) {
        assert_eq!(name, other);
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-6), "{name}: {a:?} and {b:?}");
    }

    // The recordings of the session and its settings give the same twin without the node, byte for byte.
    let again = folder.path().join("again");
    let sources = [0, 1].map(|s| folder.path().join(format!("node/session/state{s}")));
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_artitwin"));
    command.arg("reconstruct").args(&sources).arg("--out").arg(&again).args(["--name", "drawer", "--config"]);
    let ended = end(command.arg(folder.path().join("node/session/settings.yaml")));
    assert!(ended.code == 0 || ended.code == 3, "{}", ended.stderr);
    let read = |path: &Path| std::fs::read(path.join("drawer.urdf")).unwrap();
    assert_eq!(read(&twin), read(&again.join("drawer")));
    Ok(())
}

/// A node on the session of an earlier one publishes the twin made there; a damaged twin is a warning.
fn taken_up(python: &Path, domain: u16, folder: &TempDir, parameters: &[String], told: &serde_json::Value) {
    let texts = |key: &str| -> Vec<String> {
        told[key]
            .as_array()
            .unwrap()
            .iter()
            .map(|v| v.as_str().map_or_else(|| v.to_string(), str::to_owned))
            .collect()
    };
    let arguments = [
        vec!["taken_up".to_owned(), "--joints".to_owned()],
        texts("joints"),
        vec!["--motions".to_owned()],
        texts("motions"),
    ];
    let node = Node::start(domain, parameters);
    let again = scenario(python, domain, &arguments.iter().flatten().map(String::as_str).collect::<Vec<_>>());
    node.end();
    assert_eq!(again["description"], told["description"]);

    let report = folder.path().join("node/session/drawer/report.json");
    let text = std::fs::read(&report).unwrap();
    std::fs::write(&report, &text[..text.len() / 2]).unwrap();
    let node = Node::start(domain, parameters);
    scenario(python, domain, &["discovery"]);
    let log = node.end();
    assert!(log.contains("the last twin is not published again") && log.contains("report.json"), "{log}");
    std::fs::write(&report, text).unwrap();
}

fn a_session_has_one_node() {
    let folder = tempfile::tempdir().unwrap();
    let parameters =
        [format!("out_folder:={}", folder.path().join("out").display()), "session:=session".to_owned()];
    let first = Node::start(63, &parameters);
    ros::wait_for(&folder.path().join("out/session/.node.lock"));
    let mut second = std::process::Command::new(env!("CARGO_BIN_EXE_artitwin"));
    let arguments = ["node", "--ros-args", "-p", &parameters[0], "-p", &parameters[1]];
    let refused = end(second.args(arguments).env("ROS_DOMAIN_ID", "63"));
    assert_eq!(refused.code, 1, "{}", refused.stderr);
    assert!(refused.stderr.contains("another node works on the session"), "{}", refused.stderr);
    // A crash gives the session back.
    first.kill();
    let after = Node::start(63, &parameters);
    std::thread::sleep(std::time::Duration::from_secs(2));
    assert!(after.end().contains("session"));
}

fn a_replayed_recording_gives_the_twin_of_the_command_line() -> Result<(), Missing> {
    session(&shipped("drawer"), 41, false, true)
}

fn a_replayed_raw_recording_gives_the_twin_of_the_command_line() -> Result<(), Missing> {
    session(&shipped("drawer_raw"), 42, true, false)
}

/// 4 minutes for 30 views of 640x480 a state.
fn a_replayed_recording_of_ones_own_gives_the_twin_of_the_command_line() -> Result<(), Missing> {
    let bag = std::env::var_os("ARTITWIN_BAG").expect("ARTITWIN_BAG names a folder with state0 and state1");
    session(Path::new(&bag), 60, false, false)
}

fn three_hundred_frames_at_30_hz_arrive() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let parameters =
        ["image_qos:=default".to_owned(), format!("out_folder:={}", folder.path().join("out").display())];
    let node = Node::start(43, &parameters);
    // While a state is collected, and mapped as it comes.
    let told = scenario(&python, 43, &["rate", "--reliable", "--collect", "--frames", "300"]);
    let log = node.end();
    for part in ["color", "depth"] {
        assert_eq!(told[part]["received"], 300, "{told}\n{log}");
        assert_eq!(told[part]["lost"], 0, "{told}");
    }
    assert_eq!(told["matched"], 300, "{told}");
    // 3 mm from image to image, a view kept every 2 cm; what the map cannot take is left out of it alone.
    assert!((40..=45).contains(&told["kept"].as_u64().unwrap()), "{told}");
    let live = |key: &str| told["live_map"][key].as_str().unwrap().parse::<u64>().unwrap();
    assert_eq!(live("views_fused") + live("left_out_busy"), told["kept"].as_u64().unwrap(), "{told}");
    Ok(())
}

fn images_that_are_lost_on_the_way_are_counted() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    if with_fastdds() {
        return Err(ros::ONLY_CYCLONE.into());
    }
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let out = format!("out_folder:={}", folder.path().join("out").display());
    for (domain, qos, options) in [(52, "sensor_data", &[][..]), (53, "default", &["--reliable"])] {
        let node = Node::start(domain, &[out.clone(), format!("image_qos:={qos}")]);
        let told = lossy_scenario(&python, domain, 10, &[&["rate", "--frames", "150"], options].concat());
        node.end();
        for part in ["color", "depth"] {
            let count = |key: &str| told[part][key].as_u64().unwrap();
            let found = count("received") + count("lost");
            if qos == "default" {
                assert_eq!((count("received"), count("lost")), (150, 0), "{told}");
            } else {
                // Only a later image tells of one that was lost.
                assert!(count("lost") > 0 && (146..=150).contains(&found), "{told}");
            }
        }
    }
    Ok(())
}

fn ten_thousand_broken_messages_are_counted_and_do_no_harm() -> Result<(), Missing> {
    flood(44, "10000", "2000")
}

fn a_hundred_thousand_broken_messages_are_counted_and_do_no_harm() -> Result<(), Missing> {
    flood(45, "100000", "2000")
}

fn flood(domain: u16, count: &str, hz: &str) -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let mut parameters = small_run(&folder, false);
    parameters.retain(|p| !p.starts_with("mask_topic"));
    parameters.push("info_qos:=default".to_owned());
    let node = Node::start(domain, &parameters);
    let bag = shipped("drawer/state0").display().to_string();
    let told = scenario(&python, domain, &["hostile", &bag, "--count", count, "--hz", hz, "--short"]);
    assert!(node.lives());
    let log = node.end();
    assert!(!log.contains("panicked"), "{log}");
    let number = |v: &serde_json::Value| v.as_u64().unwrap();
    for (topic, input) in told["inputs"].as_object().unwrap() {
        let counted = number(&input["received"]) + number(&input["lost"]) + number(&input["malformed"]);
        assert_eq!(counted, number(&input["sent"]), "{topic}: {input}");
    }
    assert!(number(&told["refused"]) > 0, "{told}");
    assert!(number(&told["resident_bytes"]) < 600_000_000, "{told}");
    Ok(())
}

fn simulated_time_may_jump_back() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let parameters =
        ["use_sim_time:=true".to_owned(), format!("out_folder:={}", folder.path().join("out").display())];
    let node = Node::start(46, &parameters);
    let told = scenario(&python, 46, &["clock"]);
    node.end();
    assert!(told["jumps"].as_u64().unwrap() >= 1, "{told}");
    Ok(())
}

fn a_camera_without_transforms_is_followed_and_its_poses_come_back() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let node = Node::start(66, &small_run(&folder, false));
    let states = [0, 1].map(|s| shipped(&format!("drawer/state{s}")).display().to_string());
    let told = scenario(&python, 66, &["tracked", &states[0], &states[1]]);
    let log = node.end();
    assert!(!log.contains("panicked"), "{log}");
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    for (state, found) in told["states"].as_array().unwrap().iter().enumerate() {
        // Of 16 views, 12 deg apart, 12 are placed offline.
        assert!(number(&found["poses"]) >= 10.0 && number(&found["kept"]) >= 10.0, "{told}\n{log}");
        assert!(number(&found["moved_m"]) < 0.015 && number(&found["turned_rad"]) < 0.03, "{told}");
        // z up from the floor: the camera is above it, by no more than it is away.
        assert!(number(&found["lowest_m"]) > 0.05 && number(&found["highest_m"]) < 2.0, "{told}");
        let recorded = io::inspect(&folder.path().join(format!("node/session/state{state}")));
        let recorded = recorded.unwrap().to_text();
        assert!(recorded.contains("camera poses: none recorded"), "{recorded}");
    }
    assert!(number(&told["views_per_second"]) >= 2.0 && number(&told["inliers"]) > 0.88, "{told}");
    assert!((0.0..0.02).contains(&number(&told["position_error"])), "{told}");
    assert!(told["quality"]["position_error_m"].is_string(), "{told}");
    // The pipeline tracks what was recorded as it does any bag.
    assert_eq!(told["joints"].as_array().unwrap().len(), 1, "{told}");
    let motion = number(&told["motions"][0]);
    let posed = folder.path().join("posed");
    let ended = end(&mut reconstruct(&[&shipped("drawer")], &posed, &["--parts", "2", "--name", "drawer"]));
    assert!(ended.code == 0 || ended.code == 3, "{}", ended.stderr);
    let by_poses = io::read_run_summary(&posed.join("drawer")).unwrap();
    let expected = by_poses.joints[0].states[1] - by_poses.joints[0].states[0];
    assert!((motion.abs() - expected.abs()).abs() < 0.01, "{motion} m, by poses {expected} m");
    assert!(by_poses.object_box_m.is_some());
    Ok(())
}

/// The live map while the drawer is replayed: there in time, where the drawer is, and lit where it moved.
fn what_is_collected_is_shown_as_it_comes() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let node = Node::start(67, &small_run(&folder, false));
    let states = [0, 1].map(|s| shipped(&format!("drawer/state{s}")).display().to_string());
    let told = scenario(&python, 67, &["live", &states[0], &states[1]]);
    let log = node.end();
    assert!(!log.contains("panicked"), "{log}");
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    let points = |v: &serde_json::Value| -> Vec<nalgebra::Point3<f32>> {
        let point = |p: &serde_json::Value| [0, 1, 2].map(|k| p[k].as_f64().unwrap() as f32).into();
        v.as_array().unwrap().iter().map(point).collect()
    };
    let mut left_out_before = 0.0;
    for (state, found) in told["states"].as_array().unwrap().iter().enumerate() {
        let mut short = found.clone();
        ["mesh", "moved"].iter().for_each(|k| short[k] = found[k].as_array().unwrap().len().into());
        eprintln!("state {state}: {short}");
        // A machine too slow for the views that come may leave some out; it counts them.
        let left_out = number(&found["left_out"]) - left_out_before;
        left_out_before += left_out;
        assert_eq!(
            (number(&found["kept"]), number(&found["fused"])),
            (16.0, 16.0 - left_out),
            "{short}\n{log}"
        );
        assert!(left_out == 0.0 || number(&found["seconds_a_view"]) > 0.2, "{short}\n{log}");
        // From an image that is sent to the surface that holds it, and from a kept view to all of its
        // surface.
        let delays: Vec<f64> = found["delays"].as_array().unwrap().iter().map(number).collect();
        assert_eq!(delays.len(), 16);
        // Views come every 0.2 s: a machine that takes longer for one falls behind by the rest, with each.
        let most = 1.0 + 16.0 * (number(&found["seconds_a_view"]) - 0.2).max(0.0);
        assert!(delays.iter().all(|d| (0.0..most).contains(d)), "{delays:?}, {most} s at most");
        assert!((1e-3..most).contains(&number(&found["behind"])), "{short}");
        assert_eq!(found["frames"], serde_json::json!(["world"]), "{short}");
        assert!(number(&found["largest"]) < 300_000.0 && number(&found["map_bytes"]) < 64e6, "{short}");
        let truth = distance_to(&format!("drawer/truth/state{state}/whole.ply"));
        let errors = points(&found["mesh"]).iter().map(&truth).collect::<Vec<f32>>();
        let near = errors.iter().filter(|e| **e < 0.01).count() as f64 / errors.len() as f64;
        let mean = errors.iter().sum::<f32>() / errors.len() as f32;
        assert!(errors.len() > 500 && near > 0.95 && mean < 0.003, "{} {near} {mean}", errors.len());
        assert!(number(&found["unseen_m2"]) > 0.0 && number(&found["next_views"]) > 0.0, "{short}");
        assert!((0.0..1.0).contains(&number(&found["unseen_share"])), "{short}");
        // Nothing was there to compare state 0 with.
        if state == 0 {
            assert_eq!((found["moved"].as_array().unwrap().len(), &found["gone_m2"]), (0, &"unknown".into()));
        }
    }
    let last = &told["states"][1];
    let lit = points(&last["moved"]);
    let (before, after) =
        (distance_to("drawer/truth/state0/part_1.ply"), distance_to("drawer/truth/state1/part_1.ply"));
    let off = lit.iter().filter(|p| before(p).min(after(p)) > 0.015).count();
    // The front of the drawer, which is out by 0.16 m.
    assert!(lit.len() > 300 && off * 50 < lit.len(), "{off} of {}", lit.len());
    assert!(last["appeared_m2"].as_str().unwrap().parse::<f64>().unwrap() > 0.01, "{}", last["appeared_m2"]);
    assert!(number(&last["cleared"]) >= 2.0, "the markers of state 0 went");
    assert!(number(&told["late_secs"]) < 12.0 && told["left_after_reset"] == 0, "{}", told["late_secs"]);
    Ok(())
}

/// Distance of points to a shipped mesh, meters.
fn distance_to(mesh: &str) -> impl Fn(&nalgebra::Point3<f32>) -> f32 + use<> {
    let mesh = io::read_mesh(&shipped(mesh)).unwrap();
    let distance = surface::MeshDistance::new(&mesh).unwrap();
    move |p| distance.distances_m(&[*p])[0]
}

/// Starts a node on the drawer's topics, runs a scenario with its first state and ends the node.
fn with_drawer(
    domain: u16,
    parameters: &[&str],
    arguments: &[&str],
) -> Result<(TempDir, serde_json::Value), Missing> {
    let python = venv::ros_python()?;
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let mut all = small_run(&folder, false);
    all.push("info_qos:=default".to_owned());
    all.extend(parameters.iter().map(|p| (*p).to_owned()));
    let node = Node::start(domain, &all);
    let bag = shipped("drawer/state0").display().to_string();
    let told = scenario(&python, domain, &[&arguments[..1], &[&bag], &arguments[1..]].concat());
    let log = node.end();
    assert!(!log.contains("panicked"), "{log}");
    Ok((folder, told))
}

/// Camera poses of the views of a recording of state 0.
fn camera_poses(state0: &Path, pose_frame: Option<&str>) -> Vec<Pose> {
    let config = capture::CaptureConfig { pose_frame: pose_frame.map(str::to_owned), ..Default::default() };
    let capture = open(&[state0.to_owned(), shipped("drawer/state1")], &config, 0).unwrap();
    capture.states[0].iter().map(|f| f.world_from_camera).collect()
}

fn same_poses(found: &[Pose], expected: &[Pose]) {
    assert_eq!(found.len(), expected.len());
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        let offset = a.inverse() * b;
        assert!(
            offset.translation.vector.norm() < 1e-9 && offset.rotation.angle() < 1e-7,
            "view {i}: {offset}"
        );
    }
}

fn camera_poses_may_come_as_pose_or_odometry() -> Result<(), Missing> {
    let expected = camera_poses(&shipped("drawer/state0"), None);
    for (domain, form, frame) in [(54, "pose", "camera_link"), (55, "odometry", "")] {
        let (pose_type, pose_frame) = (format!("pose_type:={form}"), format!("pose_frame:='{frame}'"));
        let parameters = ["pose_topic:=/camera_pose", &pose_type, &pose_frame];
        let arguments = ["play", "--begin", "0", "--masks", "--poses", form, "--linger", "2"];
        let (folder, _) = with_drawer(domain, &parameters, &arguments)?;
        same_poses(
            &camera_poses(&folder.path().join("node/session/state0"), Some(frame).filter(|f| !f.is_empty())),
            &expected,
        );
    }
    Ok(())
}

fn a_publisher_may_be_killed_and_another_go_on() -> Result<(), Missing> {
    let (folder, told) = with_drawer(56, &[], &["restart"])?;
    assert_eq!(
        (&told["half"], &told["kept"], &told["lost"], &told["received"]),
        (&8.into(), &16.into(), &0.into(), &16.into()),
        "{told}"
    );
    same_poses(
        &camera_poses(&folder.path().join("node/session/state0"), None),
        &camera_poses(&shipped("drawer/state0"), None),
    );
    Ok(())
}

fn transforms_images_and_clock_may_jump_back() -> Result<(), Missing> {
    let (folder, told) = with_drawer(57, &["use_sim_time:=true"], &["jumps"])?;
    // What was kept stays as it is; older views are no part of it, and a new recording takes them.
    assert_eq!((&told["future"], &told["kept_after_jump"]), (&8.into(), &8.into()), "{told}");
    let (again, jumps) = (told["again"].as_u64().unwrap() as usize, told["jumps"].as_u64().unwrap());
    assert!((15..=16).contains(&again) && jumps >= 2, "{told}");
    let expected = camera_poses(&shipped("drawer/state0"), None);
    same_poses(&camera_poses(&folder.path().join("node/session/state0"), None), &expected[16 - again..]);
    Ok(())
}

fn a_session_is_saved_and_another_begun() -> Result<(), Missing> {
    let (_folder, told) = with_drawer(58, &[], &["resets"])?;
    assert_eq!((&told["on_disk"], &told["kept"]), (&8.into(), &8.into()), "{told}");
    let sessions: Vec<&Path> =
        told["sessions"].as_array().unwrap().iter().map(|s| Path::new(s.as_str().unwrap())).collect();
    assert_ne!(sessions[0], sessions[1]);
    for session in sessions {
        assert_eq!(
            io::inspect(&session.join("state0")).unwrap().recordings[0].views,
            8,
            "{}",
            session.display()
        );
    }
    Ok(())
}

fn a_diagnosis_is_asked_for_canceled_and_published() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let (twin, runs) = doors::write(&folder, 3, 10.0);
    let node = Node::start(
        59,
        &[format!("out_folder:={}", folder.path().join("out").display()), "session:=session".to_owned()],
    );
    let paths: Vec<String> = std::iter::once(&twin).chain(&runs).map(|p| p.display().to_string()).collect();
    let arguments: Vec<&str> = std::iter::once("diagnose").chain(paths.iter().map(String::as_str)).collect();
    let told = scenario(&python, 59, &arguments);
    let log = node.end();
    assert!(!log.contains("panicked"), "{log}");
    assert_eq!(told["verdict"], "named", "{told}");
    for ((joint, damping), finding) in
        ["left_hinge", "right_hinge"].iter().zip(doors::DAMPING).zip(told["findings"].as_array().unwrap())
    {
        assert_eq!((&finding[0], &finding[1]), (&(*joint).into(), &"viscous_friction".into()), "{told}");
        let value = finding[2][0][1].as_f64().unwrap();
        assert!((value / damping - 1.0).abs() < 0.1, "{told}");
    }
    assert_eq!(told["stages"], serde_json::json!(["diagnose/left_hinge", "diagnose/right_hinge"]), "{told}");
    assert_eq!(told["fractions"], serde_json::json!([0.0, 0.5]), "{told}");

    // The command line finds the same, byte for byte.
    let cli = folder.path().join("cli");
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_artitwin"));
    let ended = end(command.arg("diagnose").arg(&twin).args(&runs).arg("--out").arg(&cli));
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    let by_node = Path::new(told["folder"].as_str().unwrap());
    assert_eq!(by_node, folder.path().join("out/session/gap"));
    let node = Node::start(
        59,
        &[format!("out_folder:={}", folder.path().join("out").display()), "session:=session".to_owned()],
    );
    let again = scenario(&python, 59, &["reported"]);
    node.end();
    assert_eq!(
        (&again["verdict"], &again["folder"], &again["summary"]),
        (&told["verdict"], &told["folder"], &told["summary"])
    );
    assert_eq!(again["twin"], twin.display().to_string());
    for file in ["report.json", "twin.urdf"] {
        assert_eq!(
            std::fs::read(by_node.join(file)).unwrap(),
            std::fs::read(cli.join(file)).unwrap(),
            "{file}"
        );
    }
    Ok(())
}

fn the_node_is_seen_under_its_name() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let out = format!("out_folder:={}", folder.path().join("out").display());
    let node = Node::start_with(47, &[out], &["-r", "__node:=twin_maker", "-r", "__ns:=/lab"]);
    let told = scenario(&python, 47, &["discovery", "--name", "twin_maker"]);
    node.end();
    assert_eq!((&told["name"], &told["namespace"]), (&"twin_maker".into(), &"/lab".into()), "{told}");
    assert!(told["writers"].as_u64().unwrap() > 8, "{told}");
    Ok(())
}

fn states_are_found_without_a_call() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let mut parameters = small_run(&folder, false);
    parameters.extend(
        ["automatic_states:=true", "still_secs:=0.5", "min_keyframes:=5", "enough_keyframes:=10"]
            .map(str::to_owned),
    );
    let node = Node::start(48, &parameters);
    let states = [0, 1].map(|s| shipped(&format!("drawer/state{s}")).display().to_string());
    let told = scenario(&python, 48, &["automatic", &states[0], &states[1]]);
    let log = node.end();
    let phases: Vec<u64> = told["phases"].as_array().unwrap().iter().map(|p| p.as_u64().unwrap()).collect();
    assert!(phases.contains(&1) && phases.last() == Some(&3), "{phases:?}\n{log}");
    for state in 0..2 {
        assert!(folder.path().join(format!("node/session/state{state}/metadata.yaml")).is_file(), "{log}");
    }
    Ok(())
}

fn a_crash_loses_nothing_that_was_there_for_a_second() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let node = Node::start(49, &small_run(&folder, false));
    let bag = shipped("drawer/state0").display().to_string();
    scenario(&python, 49, &["play", &bag, "--begin", "0", "--masks", "--linger", "3"]);
    node.kill();
    let session = folder.path().join("node/session");
    assert!(!session.join("state0/metadata.yaml").exists());
    let found = io::inspect(&session.join("state0")).unwrap();
    assert_eq!(found.recordings[0].views, 16);
    Ok(())
}

fn what_is_recorded_is_what_was_published() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let mut parameters = small_run(&folder, false);
    parameters.push("info_qos:=default".to_owned());
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_artitwin"));
    command.arg("record").arg(&bag).arg("--ros-args").env("ROS_DOMAIN_ID", "50");
    parameters.iter().for_each(|p| _ = command.args(["-p", p]));
    let mut recorder = command.stdout(std::process::Stdio::piped()).spawn().unwrap();
    let source = shipped("drawer/state0").display().to_string();
    let told = scenario(&python, 50, &["play", &source, "--masks"]);
    std::process::Command::new("kill").args(["-TERM", &recorder.id().to_string()]).status().unwrap();
    let mut text = String::new();
    std::io::Read::read_to_string(&mut recorder.stdout.take().unwrap(), &mut text).unwrap();
    assert!(recorder.wait().unwrap().success(), "{text}");
    assert_eq!(told["sent"], 113);
    assert!(text.ends_with(": 113 messages\n"), "{text}");
    assert_eq!(io::inspect(&bag).unwrap().recordings[0].views, 16);
    Ok(())
}

fn ten_minutes_of_images_need_no_more_memory_than_one() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let parameters =
        ["image_qos:=default".to_owned(), format!("out_folder:={}", folder.path().join("out").display())];
    let node = Node::start(51, &parameters);
    let told = scenario(&python, 51, &["rate", "--reliable", "--collect", "--frames", "18000"]);
    node.end();
    for part in ["color", "depth"] {
        let count = |key: &str| told[part][key].as_u64().unwrap();
        assert_eq!(count("received") + count("lost"), 18_000, "{told}");
    }
    let resident: Vec<f64> =
        told["resident_every_20_s"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    let (early, late) = (resident[3], resident.iter().fold(0.0, |a: f64, b| a.max(*b)));
    assert!(late < 500e6 && late < 1.1 * early, "{told}");
    Ok(())
}

fn what_cannot_work_is_refused_at_the_start() {
    let refused = |environment: &[(&str, &str)], arguments: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_artitwin"));
        command.arg("node").args(arguments).envs(environment.iter().copied());
        let ended = end(&mut command);
        assert_eq!(ended.code, 2, "{}", ended.stderr);
        ended.stderr
    };
    let secure = [("ROS_SECURITY_ENABLE", "true"), ("ROS_SECURITY_STRATEGY", "Enforce")];
    assert!(refused(&secure, &[]).contains("no DDS security"));
    assert!(refused(&[("ROS_DOMAIN_ID", "300")], &[]).contains("0 to 232"));
    assert!(refused(&[], &["--ros-args", "-p", "parts:=many"]).contains("whole number"));
    assert!(refused(&[], &["--parts", "2"]).contains("--ros-args"));
    assert!(refused(&[], &["--ros-args", "-p", "settings:=[train.stepz=3]"]).contains("train.steps"));
}
