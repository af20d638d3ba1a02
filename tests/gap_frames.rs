//! `artitwin diagnose --frames` on made objects with effects hidden in the twin or in the recordings. The suite in full
//! counts: `cargo test --release --test gap_frames -- --ignored --nocapture`, which prints its table.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "a test may panic")]

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use artitwin::{
    geometry::Pose,
    io::{write_synth_bag, write_true_twin},
    synth::{Family, Object, PartJointKind, SynthConfig, SynthState, film, further_states, generate},
};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use serde_json::Value;

/// What is hidden.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Hidden {
    Nothing,
    DepthScale(f64),
    DepthBias(f64),
    Extrinsic(f64),
    Delay(f64),
    AxisTurn(f64),
    AxisShift(f64),
    FrameShift(f64),
    OtherType,
    Screw,
    Cut(usize),
}

impl Hidden {
    /// Name that the diagnosis should print first.
    fn name(self) -> Option<&'static str> {
        Some(match self {
            Self::Nothing => return None,
            Self::DepthScale(_) => "depth_scale",
            Self::DepthBias(_) => "depth_bias",
            Self::Extrinsic(_) => "camera_extrinsic_offset",
            Self::Delay(_) => "camera_time_offset",
            Self::AxisTurn(_) | Self::AxisShift(_) | Self::FrameShift(_) => "axis_offset",
            Self::OtherType | Self::Screw => "wrong_joint_type",
            Self::Cut(_) => "missing_geometry",
        })
    }
}

struct Temp(PathBuf);

impl Drop for Temp {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.0).ok();
    }
}

/// Makes a case and diagnoses it: summary and report.
fn diagnose(hidden: Hidden, seed: u64) -> (String, Value) {
    let temp = Temp(PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("gap-frames-{hidden:?}-{seed}-{}", std::process::id())));
    fs::remove_dir_all(&temp.0).ok();
    fs::create_dir_all(&temp.0).unwrap();
    let family = if hidden == Hidden::Screw { Some(Family::CappedBox) } else { None };
    let config = SynthConfig { seed, parts: Some(2), family, width: 320, height: 240, views: 12, ..SynthConfig::default() };
    let (object, config) = usable(&config, hidden);
    write_true_twin(&temp.0.join("twin"), &object).unwrap();
    let urdf = temp.0.join("twin/truth/twin.urdf");
    hide_in_twin(hidden, &object, &urdf);
    let mut command = Command::new(env!("CARGO_BIN_EXE_artitwin"));
    command.arg("diagnose").arg(&urdf).arg("--out").arg(temp.0.join("out"));
    for (k, state) in further_states(&object, 3, &config).unwrap().iter().enumerate() {
        let mut recording = film(state, 1, k + 2, &config);
        hide_in_recording(hidden, &mut recording);
        let bag = temp.0.join(format!("state{}", k + 2));
        write_synth_bag(&bag, k + 2, &recording).unwrap();
        command.arg("--frames").arg(bag);
    }
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let page = fs::read_to_string(temp.0.join("out/report.html")).unwrap();
    assert!(page.matches("<img").count() >= 4, "the page shows no pictures");
    let report = serde_json::from_str(&fs::read_to_string(temp.0.join("out/report.json")).unwrap()).unwrap();
    (String::from_utf8_lossy(&output.stdout).into_owned(), report)
}

/// The object of a seed, or of the next that has no screw where none is asked for.
fn usable(config: &SynthConfig, hidden: Hidden) -> (Object, SynthConfig) {
    let is_screw = |o: &Object| o.parts.iter().any(|p| p.joint.is_some_and(|j| matches!(j.kind, PartJointKind::Screw { .. })));
    (0..50)
        .map(|k| SynthConfig { seed: config.seed + 1000 * k, ..config.clone() })
        .filter_map(|c| generate(&c).ok().map(|o| (o, c)))
        .find(|(o, _)| is_screw(o) == (hidden == Hidden::Screw))
        .unwrap()
}

fn hide_in_recording(hidden: Hidden, recording: &mut SynthState) {
    for frame in &mut recording.frames {
        let [v, w] = frame.velocity;
        match hidden {
            Hidden::DepthScale(share) => {
                frame.depth_mm.iter_mut().for_each(|d| *d = (f64::from(*d) * (1.0 + share)).round() as u16);
            }
            Hidden::DepthBias(m) => {
                frame.depth_mm.iter_mut().filter(|d| **d > 0).for_each(|d| *d = (f64::from(*d) + 1000.0 * m).round() as u16);
            }
            Hidden::Extrinsic(m) => {
                let off = Pose::new(Vector3::new(0.7, -0.5, 0.5) * m, Vector3::new(0.6, 1.0, -0.4) * m);
                frame.told.iter_mut().for_each(|p| *p *= off);
            }
            Hidden::Delay(seconds) => frame.told.iter_mut().for_each(|p| *p *= Pose::new(v * seconds, w * seconds)),
            _ => {}
        }
    }
}

fn hide_in_twin(hidden: Hidden, object: &Object, urdf: &Path) {
    let joint = object.parts[1].joint.unwrap();
    let axis = joint.axis.into_inner();
    let across = axis.cross(&Vector3::new(0.3, 0.5, 0.8)).normalize();
    let text = fs::read_to_string(urdf).unwrap();
    let line = text.lines().find(|l| l.contains("<joint ")).unwrap().to_owned();
    let vector = |tag: &str| -> Vector3<f64> {
        let rest = &line[line.find(&format!("<{tag} xyz=\"")).unwrap() + tag.len() + 7..];
        let numbers: Vec<f64> = rest[..rest.find('"').unwrap()].split(' ').map(|n| n.parse().unwrap()).collect();
        Vector3::new(numbers[0], numbers[1], numbers[2])
    };
    let xyz = |v: &Vector3<f64>| format!("xyz=\"{} {} {}\"", v.x, v.y, v.z);
    // Directions of the rest frame as the parent's frame has them.
    let shifted = |m: f64| line.replace(&xyz(&vector("origin")), &xyz(&(vector("origin") + object.world_from_rest.rotation * across * m)));
    let new = match hidden {
        Hidden::AxisTurn(rad) => line.replace(&xyz(&axis), &xyz(&(UnitQuaternion::from_scaled_axis(across * rad) * axis))),
        Hidden::AxisShift(m) | Hidden::FrameShift(m) => shifted(m),
        Hidden::OtherType if joint.kind == PartJointKind::Prismatic => line.replace("type=\"prismatic\"", "type=\"revolute\""),
        Hidden::OtherType => line.replace("type=\"revolute\"", "type=\"prismatic\""),
        Hidden::Screw => {
            let thread = line.find("<artitwin:thread").unwrap();
            format!("{}</joint>", &line[..thread])
        }
        _ => line.clone(),
    };
    let mut text = text.replace(&line, &new);
    if let Hidden::AxisShift(m) = hidden {
        let moved = format!("<visual><origin {} rpy=\"0 0 0\"/><geometry><mesh filename=\"meshes/part_1", xyz(&(-across * m)));
        text = text.replace("<visual><origin xyz=\"0 0 0\" rpy=\"0 0 0\"/><geometry><mesh filename=\"meshes/part_1", &moved);
    }
    fs::write(urdf, text).unwrap();
    if let Hidden::Cut(part) = hidden {
        cut(&urdf.with_file_name("meshes").join(format!("part_{part}.obj")));
    }
}

/// Takes away what lies in the outer third of a mesh along its longest side.
fn cut(path: &Path) {
    let text = fs::read_to_string(path).unwrap();
    let numbers = |l: &str| l.split(' ').skip(1).map(|n| n.parse::<f64>().unwrap()).collect::<Vec<_>>();
    let points: Vec<Point3<f64>> = text.lines().filter(|l| l.starts_with("v ")).map(|l| Point3::from_slice(&numbers(l))).collect();
    let mut open: Vec<[Point3<f64>; 3]> =
        text.lines().filter(|l| l.starts_with("f ")).map(|l| [0, 1, 2].map(|k| points[numbers(l)[k] as usize - 1])).collect();
    let (low, high) = points.iter().fold((points[0], points[0]), |(l, h), p| (l.inf(p), h.sup(p)));
    let axis = (high - low).imax();
    let from = low[axis] + 0.65 * (high - low)[axis];
    let (mut vertices, mut faces, mut count) = (String::new(), String::new(), 0);
    while let Some(t) = open.pop() {
        let side = |i: usize| (t[i] - t[(i + 1) % 3]).norm();
        let longest = (0..3).max_by(|a, b| side(*a).total_cmp(&side(*b))).unwrap();
        let crosses = t.iter().any(|p| p[axis] < from) && t.iter().any(|p| p[axis] > from);
        if crosses && side(longest) > 0.01 {
            let [a, b, c] = [t[longest], t[(longest + 1) % 3], t[(longest + 2) % 3]];
            let middle = nalgebra::center(&a, &b);
            open.extend([[a, middle, c], [middle, b, c]]);
        } else if t.iter().all(|p| p[axis] <= from) {
            t.iter().for_each(|p| vertices.push_str(&format!("v {} {} {}\n", p.x, p.y, p.z)));
            faces.push_str(&format!("f {} {} {}\n", count + 1, count + 2, count + 3));
            count += 3;
        }
    }
    fs::write(path, vertices + &faces).unwrap();
}

fn first(report: &Value) -> Option<&str> {
    report["findings"][0]["effect"].as_str()
}

fn gap(report: &Value) -> [f64; 3] {
    ["before", "after", "noise_floor"].map(|k| report["gap"][k].as_f64().unwrap())
}

/// The first name is right and the held-out gap closes to a fifth, or to a millimeter.
fn check(hidden: Hidden, seed: u64) -> Value {
    let (summary, report) = diagnose(hidden, seed);
    assert_eq!(first(&report), hidden.name(), "{summary}");
    let [before, after, floor] = gap(&report);
    assert!(hidden == Hidden::Nothing || after - floor < (0.2 * (before - floor)).max(0.001), "{summary}");
    report
}

#[test]
fn a_twin_without_errors_gets_no_name() {
    let report = check(Hidden::Nothing, 1);
    assert_eq!(report["verdict"], "none", "{report:#}");
}

#[test]
fn a_depth_scale_is_named_with_its_value() {
    let report = check(Hidden::DepthScale(0.02), 1);
    let scale = &report["findings"][0]["parameters"][0];
    assert!((scale["value"].as_f64().unwrap() - 1.02).abs() < 0.002, "{scale}");
}

#[test]
fn an_offset_of_the_camera_is_named() {
    check(Hidden::Extrinsic(0.01), 4);
}

#[test]
fn missing_geometry_is_named() {
    check(Hidden::Cut(1), 5);
}

/// Cases of the suite: what, and how many.
fn suite() -> Vec<(&'static str, Vec<Hidden>)> {
    vec![
        ("nothing", vec![Hidden::Nothing; 20]),
        ("depth_scale", [0.01, 0.015, -0.02, 0.025, 0.03].map(Hidden::DepthScale).to_vec()),
        ("depth_bias", [0.003, 0.005, -0.006, 0.008, 0.01].map(Hidden::DepthBias).to_vec()),
        ("camera_extrinsic_offset", [0.005, 0.008, 0.01, 0.015, 0.02].map(Hidden::Extrinsic).to_vec()),
        ("camera_time_offset", [0.01, -0.015, 0.02, 0.025, -0.03].map(Hidden::Delay).to_vec()),
        ("axis_offset (direction)", [0.02, 0.03, 0.035, 0.045, 0.05].map(Hidden::AxisTurn).to_vec()),
        ("axis_offset (position)", [0.008, 0.01, 0.012, 0.015, 0.02].map(Hidden::AxisShift).to_vec()),
        ("axis_offset (frame)", [0.006, 0.008, 0.012, 0.015, 0.02].map(Hidden::FrameShift).to_vec()),
        ("wrong_joint_type", vec![Hidden::OtherType; 5]),
        ("wrong_joint_type (screw)", vec![Hidden::Screw; 5]),
        ("missing_geometry", [0, 1, 0, 1, 1].map(Hidden::Cut).to_vec()),
    ]
}

#[test]
#[ignore = "the whole suite takes about ten minutes of processor time"]
fn the_whole_suite() {
    println!("| hidden | cases | first name right | (after - floor) / (before - floor), median | others |\n|---|---|---|---|---|");
    let mut all = [0, 0];
    for (what, cases) in suite() {
        let (mut right, mut shares, mut others) = (0, Vec::new(), Vec::new());
        for (k, hidden) in cases.iter().enumerate() {
            let (_, report) = diagnose(*hidden, 100 + k as u64);
            let [before, after, floor] = gap(&report);
            shares.push(((after - floor) / (before - floor).max(1e-9)).max(0.0));
            if first(&report) == hidden.name() {
                right += 1;
            } else {
                others.push(format!("{} ({})", first(&report).unwrap_or("-"), report["verdict"].as_str().unwrap_or("")));
            }
        }
        shares.sort_unstable_by(f64::total_cmp);
        let share = if cases[0] == Hidden::Nothing { "-".to_owned() } else { format!("{:.3}", shares[shares.len() / 2]) };
        println!("| {what} | {} | {right} | {share} | {} |", cases.len(), others.join(", "));
        all = [all[0] + right, all[1] + cases.len()];
    }
    println!("| all | {} | {} | | |", all[1], all[0]);
    assert!(10 * all[0] >= 9 * all[1], "{} of {} right", all[0], all[1]);
}
