//! Messages, bags and package files against the tools of ROS 2 that need no ROS: rosbags, mcap-ros2-support,
//! catkin_pkg.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stderr,
    reason = "a test may panic, and says why it is left out"
)]

mod common;
#[path = "common/harness.rs"]
mod harness;
#[path = "common/venv.rs"]
mod venv;

use std::{
    io::Write as _,
    path::{Path, PathBuf},
    process::{Command, ExitCode, Stdio},
};

use harness::{Missing, tests};
use io::{
    BagWriter, OfferedQos,
    ros2msg::{
        CameraInfo, CompressedImage, Header, Image, JointState, PoseStamped, Quaternion, TfMessage, Time,
        Transform, TransformStamped, Vector3,
        definitions::{RosMessage, definitions},
        diagnostic::{DiagnosticArray, DiagnosticStatus, KeyValue},
        encode,
        gap::{GapFinding, GapParameter, GapReport},
        imu::Imu,
        markers::{Color, Marker, MarkerArray},
        odometry::FullOdometry,
        point_cloud::PointCloud2,
        status::CollectionStatus,
        text::{Clock, Text},
    },
};
use node::requests::{
    DiagnoseFeedback, DiagnoseGoal, DiagnoseResult, ReconstructFeedback, ReconstructGoal, ReconstructResult,
    SetStateRequest, SetStateResponse, TriggerResponse,
};
use serde_json::{Value, json};

fn main() -> ExitCode {
    harness::main(tests![
        every_message_has_the_bytes_of_rosbags,
        definitions_and_hashes_are_those_of_three_distributions,
        our_bags_are_read_by_others,
        package_and_launch_files_are_sound,
    ])
}

fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/ros").join(name)
}

fn succeed(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
    assert!(output.status.success(), "{command:?}: {}{}", text(&output.stdout), text(&output.stderr));
    text(&output.stdout)
}

fn header() -> Header {
    Header { stamp: Time { sec: 11, nanosec: 22 }, frame_id: "cam".into() }
}

fn transform() -> Transform {
    Transform { translation: [1.0, 2.0, 3.0].into(), rotation: Quaternion { x: 0.1, y: 0.2, z: 0.3, w: 0.4 } }
}

/// A line for `wire.py`.
fn line(kind: &str, message: &impl serde::Serialize, fields: Value) -> String {
    let hex: String = encode(message).unwrap().iter().map(|b| format!("{b:02x}")).collect();
    json!({"type": kind, "hex": hex, "fields": fields}).to_string()
}

fn case<M: RosMessage>(message: &M, fields: Value) -> String {
    line(M::TYPE, message, fields)
}

/// Messages whose fields all differ.
fn inputs() -> Vec<String> {
    let image = Image {
        header: header(),
        height: 2,
        width: 1,
        encoding: "rgb8".into(),
        is_bigendian: 1,
        step: 3,
        data: vec![1, 2, 3, 4, 5, 6],
    };
    let info = CameraInfo {
        header: header(),
        height: 480,
        width: 640,
        distortion_model: "plumb_bob".into(),
        d: vec![0.5, 0.25],
        k: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
        r: [10.0; 9],
        p: [11.0; 12],
        binning_x: 3,
        binning_y: 4,
        ..CameraInfo::default()
    };
    let stamped =
        TransformStamped { header: header(), child_frame_id: "link".into(), transform: transform() };
    let mut odometry = FullOdometry {
        header: header(),
        child_frame_id: "base".into(),
        pose: transform(),
        ..FullOdometry::default()
    };
    odometry.pose_covariance[1][2] = 7.0;
    odometry.twist = [Vector3 { x: 4.0, y: 5.0, z: 6.0 }, Vector3 { x: 7.0, y: 8.0, z: 9.0 }];
    odometry.twist_covariance[5][5] = 8.0;
    let joints = JointState {
        header: header(),
        name: vec!["a".into()],
        position: vec![1.0],
        velocity: vec![2.0],
        effort: vec![3.0],
    };
    let mut imu = Imu {
        header: header(),
        angular_velocity: Vector3 { x: 4.0, y: 5.0, z: 6.0 },
        linear_acceleration: Vector3 { x: 0.5, y: -9.75, z: 0.25 },
        ..Imu::default()
    };
    imu.orientation_covariance[0] = -1.0;
    imu.linear_acceleration_covariance[8] = 0.125;
    let compressed = CompressedImage { header: header(), format: "jpeg".into(), data: vec![9, 8, 7] };
    vec![
        case(
            &imu,
            json!({"orientation.w": 1.0, "orientation_covariance.0": -1.0, "angular_velocity.y": 5.0,
                   "linear_acceleration.x": 0.5, "linear_acceleration.y": -9.75,
                   "linear_acceleration_covariance.8": 0.125}),
        ),
        case(
            &image,
            json!({"header.stamp.sec": 11, "header.stamp.nanosec": 22, "header.frame_id": "cam", "height": 2,
                   "width": 1,
            "encoding": "rgb8", "is_bigendian": 1, "step": 3, "data": [1, 2, 3, 4, 5, 6]}),
        ),
        case(&compressed, json!({"format": "jpeg", "data": [9, 8, 7]})),
        case(
            &info,
            json!({"height": 480, "width": 640, "distortion_model": "plumb_bob", "d": [0.5, 0.25],
                   "k.1": 2.0, "r.0": 10.0, "p.11": 11.0,
            "binning_x": 3, "binning_y": 4}),
        ),
        case(
            &TfMessage { transforms: vec![stamped] },
            json!({"transforms.0.child_frame_id": "link",
            "transforms.0.transform.translation.z": 3.0, "transforms.0.transform.rotation.w": 0.4}),
        ),
        case(
            &PoseStamped { header: header(), pose: transform() },
            json!({"pose.position.x": 1.0, "pose.orientation.y": 0.2}),
        ),
        case(
            &odometry,
            json!({"child_frame_id": "base", "pose.pose.position.y": 2.0, "pose.covariance.8": 7.0,
                   "twist.twist.linear.z": 6.0,
            "twist.twist.angular.x": 7.0, "twist.covariance.35": 8.0}),
        ),
        case(&joints, json!({"name": ["a"], "position": [1.0], "velocity": [2.0], "effort": [3.0]})),
        case(&Clock { clock: Time { sec: 1, nanosec: 2 } }, json!({"clock.sec": 1, "clock.nanosec": 2})),
    ]
}

fn outputs() -> Vec<String> {
    let marker = Marker {
        header: header(),
        ns: "axes".into(),
        id: 7,
        kind: 4,
        action: 3,
        pose: transform(),
        scale: [0.1, 0.2, 0.3].into(),
        color: Color { r: 0.25, g: 0.5, b: 0.75, a: 1.0 },
        lifetime: Time { sec: 5, nanosec: 6 },
        frame_locked: true,
        points: vec![[1.0, 2.0, 3.0].into()],
        colors: vec![Color::default()],
        text: "text".into(),
        mesh_resource: "mesh".into(),
        mesh_use_embedded_materials: true,
        ..Marker::default()
    };
    let status = DiagnosticStatus {
        level: 1,
        name: "name".into(),
        message: "message".into(),
        hardware_id: "id".into(),
        values: vec![KeyValue { key: "k".into(), value: "v".into() }],
    };
    let collection = CollectionStatus {
        header: header(),
        phase: 2,
        state: 1,
        keyframes: [3, 4],
        matched: 5,
        unmatched: 6,
        session: "s".into(),
        tracked: true,
        views_per_second: 7.5,
        inliers: 0.9375,
        position_error: 0.001953125,
        hint: "h".into(),
    };
    let result = ReconstructResult {
        success: true,
        message: "m".into(),
        folder: "f".into(),
        joints: vec!["j".into(), "jj".into()],
        motions: vec![1.5, 2.5],
    };
    let feedback = (
        [3u8; 16],
        ReconstructFeedback { stage: "fusion".into(), fraction: 0.5, loss: 0.25, seconds_left: 9.0 },
    );
    vec![
        case(
            &MarkerArray { markers: vec![marker] },
            json!({"markers.0.ns": "axes", "markers.0.id": 7, "markers.0.type": 4, "markers.0.action": 3,
            "markers.0.pose.position.x": 1.0, "markers.0.scale.z": 0.3, "markers.0.color.b": 0.75,
            "markers.0.lifetime.nanosec": 6,
            "markers.0.frame_locked": true, "markers.0.points.0.y": 2.0, "markers.0.text": "text",
            "markers.0.mesh_resource": "mesh",
            "markers.0.mesh_use_embedded_materials": true}),
        ),
        case(
            &PointCloud2::colored(header(), &[([1.0, 2.0, 3.0], [4, 5, 6])]),
            json!({"height": 1, "width": 1, "point_step": 16, "row_step": 16,
            "fields.3.name": "rgb", "fields.3.offset": 12, "fields.3.datatype": 7, "fields.3.count": 1,
            "is_dense": true}),
        ),
        case(
            &DiagnosticArray { header: header(), status: vec![status] },
            json!({"status.0.level": 1, "status.0.name": "name",
            "status.0.message": "message", "status.0.hardware_id": "id", "status.0.values.0.key": "k",
            "status.0.values.0.value": "v"}),
        ),
        case(&Text { data: "<robot/>".into() }, json!({"data": "<robot/>"})),
        case(
            &collection,
            json!({"phase": 2, "state": 1, "keyframes": [3, 4], "matched": 5, "unmatched": 6,
                   "session": "s", "tracked": true, "views_per_second": 7.5, "inliers": 0.9375,
                   "position_error": 0.001953125, "hint": "h"}),
        ),
        line("artitwin_msgs/msg/SetState_Request", &SetStateRequest { state: 1 }, json!({"state": 1})),
        line(
            "artitwin_msgs/msg/SetState_Response",
            &SetStateResponse { success: true, message: "m".into(), keyframes: 9 },
            json!({"success": true, "message": "m", "keyframes": 9}),
        ),
        line(
            "artitwin_msgs/msg/Reconstruct_SendGoal_Request",
            &([7u8; 16], ReconstructGoal { parts: 2, name: "n".into() }),
            json!({"goal_id": vec![7; 16], "parts": 2, "name": "n"}),
        ),
        line(
            "artitwin_msgs/msg/Reconstruct_GetResult_Response",
            &(4i8, result),
            json!({"status": 4, "success": true, "folder": "f", "joints": ["j", "jj"],
            "motions": [1.5, 2.5]}),
        ),
        line(
            "artitwin_msgs/msg/Reconstruct_FeedbackMessage",
            &feedback,
            json!({"stage": "fusion", "fraction": 0.5, "loss": 0.25, "seconds_left": 9.0}),
        ),
        line(
            "artitwin_msgs/msg/Trigger_Response",
            &TriggerResponse { success: true, message: "m".into() },
            json!({"success": true, "message": "m"}),
        ),
    ]
}

fn diagnoses() -> Vec<String> {
    let parameter =
        GapParameter { name: "damping".into(), value: 1.0, lower: 0.5, upper: 1.5, unit: "N m s".into() };
    let finding = GapFinding {
        joint: "j".into(),
        effect: "viscous_friction".into(),
        weight: 0.75,
        parameters: vec![parameter],
    };
    let report = GapReport {
        header: header(),
        twin: "t".into(),
        folder: "f".into(),
        verdict: "named".into(),
        findings: vec![finding],
        gap_before: 2.0,
        gap_after: 3.0,
        noise_floor: 4.0,
        unit: "rad".into(),
        summary: "s".into(),
        report: "{}".into(),
    };
    let goal = DiagnoseGoal {
        twin: "t".into(),
        runs: vec!["a".into(), "bb".into()],
        held_out: vec!["c".into()],
        gravity: [1.0, 2.0, 3.0],
        linear_effort: true,
        seed: 7,
    };
    let result =
        DiagnoseResult { success: true, message: "m".into(), folder: "f".into(), verdict: "none".into() };
    let feedback = DiagnoseFeedback { stage: "diagnose/j".into(), fraction: 0.5, seconds_left: 9.0 };
    vec![
        case(
            &report,
            json!({"twin": "t", "folder": "f", "verdict": "named", "findings.0.joint": "j",
                   "findings.0.effect": "viscous_friction",
            "findings.0.weight": 0.75, "findings.0.parameters.0.lower": 0.5,
            "findings.0.parameters.0.unit": "N m s", "gap_before": 2.0,
            "gap_after": 3.0, "noise_floor": 4.0, "unit": "rad", "summary": "s", "report": "{}"}),
        ),
        line(
            "artitwin_msgs/msg/Diagnose_SendGoal_Request",
            &([7u8; 16], goal),
            json!({"twin": "t", "runs": ["a", "bb"], "held_out": ["c"], "gravity": [1.0, 2.0, 3.0],
                   "linear_effort": true, "seed": 7}),
        ),
        line(
            "artitwin_msgs/msg/Diagnose_GetResult_Response",
            &(4i8, result),
            json!({"status": 4, "success": true, "message": "m", "folder": "f", "verdict": "none"}),
        ),
        line(
            "artitwin_msgs/msg/Diagnose_FeedbackMessage",
            &([3u8; 16], feedback),
            json!({"stage": "diagnose/j", "fraction": 0.5, "seconds_left": 9.0}),
        ),
    ]
}

fn every_message_has_the_bytes_of_rosbags() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let cases = [inputs(), outputs(), diagnoses()].concat();
    let mut child = Command::new(python)
        .arg(script("wire.py"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(cases.join("\n").as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), cases.len().to_string());
    // Every type that has a definition is among them.
    for definition in definitions() {
        assert!(
            cases.iter().any(|c| c.contains(&format!("\"{}\"", definition.type_name))),
            "{}",
            definition.type_name
        );
    }
    Ok(())
}

fn definitions_and_hashes_are_those_of_three_distributions() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let text = succeed(Command::new(python).arg(script("definitions.py")).arg("--check"));
    assert!(text.contains("humble") && text.contains("jazzy"), "{text}");
    Ok(())
}

fn our_bags_are_read_by_others() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("own");
    let mut writer = BagWriter::create(&bag).unwrap();
    let qos = |latched| OfferedQos { reliable: latched, latched, depth: 5 };
    for i in 0..21 {
        let stamp = Time { sec: 100 + i, nanosec: 5 };
        let image = Image {
            header: Header { stamp, frame_id: "cam".into() },
            height: 48,
            width: 64,
            encoding: "rgb8".into(),
            is_bigendian: 0,
            step: 192,
            data: vec![i as u8; 48 * 192],
        };
        writer
            .write(
                "/camera/color/image_raw",
                Image::TYPE,
                qos(false),
                stamp.nanos().unwrap(),
                &encode(&image).unwrap(),
            )
            .unwrap();
    }
    let text = encode(&Text { data: "<robot/>".into() }).unwrap();
    writer.write("/robot_description", Text::TYPE, qos(true), 121_000_000_000, &text).unwrap();
    assert_eq!(writer.finish().unwrap(), 22);
    let told =
        succeed(Command::new(&python).arg(script("bags.py")).args(["read", &bag.display().to_string()]));
    // 20.999999995 s, and the nanosecond that rosbags counts beyond the last message.
    assert_eq!(told.trim(), "22 22 best_effort volatile reliable transient_local 20.999999996");
    assert!(BagWriter::create(&bag).is_err());

    // A recorder that was killed leaves no metadata.yaml; what was flushed is there.
    let killed = folder.path().join("killed");
    let mut writer = BagWriter::create(&killed).unwrap();
    writer.write("/robot_description", Text::TYPE, qos(true), 5, &text).unwrap();
    writer.flush().unwrap();
    let copy = folder.path().join("copy.mcap");
    std::fs::copy(killed.join("killed_0.mcap"), &copy).unwrap();
    let found = io::inspect(&copy).unwrap();
    assert_eq!(found.recordings[0].topics[0].count, 1);
    Ok(())
}

fn package_and_launch_files_are_sound() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    assert_eq!(
        succeed(Command::new(python).arg(script("packages.py")).arg(root)).trim(),
        "artitwin artitwin_msgs 7 interfaces 3 launch files"
    );
    Ok(())
}
