//! A page of a diagnosis that is known.

use nalgebra::{Matrix3, Point3, Vector3};

use super::*;
use common::note::NoteCode;
use gap::{
    fit::noise::EffortNoise,
    judge::{
        finding::{Finding, ParameterEstimate},
        law::{Curve, Law, Point, Way},
        locate::Variable,
        proof::{Gap, ResidualSeries, RunGap, RunSeries, WindowGap},
        report::{ExportStatus, Track, report, summary_of_joints},
        verdict::Diagnosis,
    },
    model::{
        actuator::Actuator,
        effect::Coverage,
        effects::catalogue,
        joint_model::JointModel,
        plant::{Load, Plant},
    },
    twin_tree::{TwinJoint, TwinLink},
};
use geometry::Pose;

/// Names out of files, which must not become markup.
const JOINT: &str = "<script>hinge";
const RUN: &str = "run\"><b>2";

fn plant() -> Plant {
    Plant {
        inertia: 2.0,
        damping: 0.3,
        friction: 0.1,
        load: Load::default(),
        most_load: 0.0,
        actuator: Actuator::default(),
    }
}

fn tree() -> TwinTree {
    let link = |name: &str, mass_kg: f64| TwinLink {
        name: name.into(),
        mass_kg,
        center_of_mass: Point3::new(0.4, 0.0, 0.0),
        inertia: Matrix3::identity() * mass_kg,
        inertia_excess: 0.0,
    };
    let joint = TwinJoint {
        name: JOINT.into(),
        motion: Motion::Turn,
        parent: 0,
        child: 1,
        parent_from_joint: Pose::identity(),
        axis: Vector3::z_axis(),
        damping: 0.3,
        friction: 0.1,
        limit: Some((-1.0, 2.0)),
        mimic: None,
        is_free: false,
    };
    let links = vec![link("wall", 0.0), link("door", 2.0)];
    TwinTree { name: "a & b".into(), links, joints: vec![joint], root: 0, gravity: Vector3::z() * -9.81 }
}

fn finding(index: usize, effect: &str, name: &str, value: f64, half: f64, unit: &str) -> Finding {
    Finding {
        index,
        effect: effect.into(),
        parameters: vec![ParameterEstimate::with_half_width(name, value, unit, half)],
        weight: 1.0,
        alternatives: Vec::new(),
        experiment: "reverse slowly six times or more, at two speeds".into(),
        is_sure: true,
    }
}

/// Two windows of a second each of a held-out run, after `length` samples of a fitted one.
fn joint(length: usize) -> JointReport {
    let effects = catalogue(0);
    let index = |name: &str| effects.iter().position(|e| e.name() == name).unwrap();
    let time: Vec<f64> = (0..length).map(|k| 0.01 * k as f64).collect();
    let wave: Vec<f64> = time.iter().map(|t| t.sin()).collect();
    let track = |run: &str, is_held_out: bool| Track {
        run: run.into(),
        is_held_out,
        time_s: time.clone(),
        position: wave.clone(),
    };
    let windows = ResidualSeries {
        time_s: time.clone(),
        position: wave.clone(),
        before: vec![0.01; length],
        after: vec![0.001; length],
        starts: vec![0, length / 2],
    };
    let run =
        RunGap { run: RUN.into(), before: 0.01, after: 0.001, full_before: f64::INFINITY, full_after: 0.02 };
    let window = WindowGap { before: 0.01, after: 0.001 };
    let mut diagnosis = Diagnosis {
        verdict: Verdict::Named,
        findings: vec![
            finding(index("coulomb_friction"), "coulomb_friction", "friction", 0.23, 0.02, "N m"),
            finding(index("torque_gain"), "torque_gain", "gain", 0.95, 0.02, "1"),
            finding(index("viscous_friction"), "viscous_friction", "damping", -0.1, 0.02, "N m s/rad"),
        ],
        before: Vec::new(),
        model: JointModel::of_plant(&plant()).with_effect(index("coulomb_friction"), &[0.23]),
        left: 0.0,
        score: 0.0,
        lacks: Vec::new(),
        noise: EffortNoise::default(),
        actuator: Vec::new(),
        nearest: None,
        spread: None,
        weighed: Vec::new(),
    };
    diagnosis.findings[0].alternatives = vec![("stribeck_friction".into(), 0.2)];
    let half = vec![0.02; 2];
    let curve = |x: [f64; 2], effort: f64| Curve {
        way: Way::Both,
        x: x.to_vec(),
        effort: vec![effort; 2],
        half: half.clone(),
    };
    let point =
        |x: f64, effort: f64, is_held_out: bool| Point { way: Way::Both, is_held_out, x, effort, half: 0.01 };
    JointReport {
        is_imposed: false,
        joint: JOINT.into(),
        turns: true,
        diagnosis,
        gap: Some(Gap {
            before: 0.01,
            after: 0.001,
            noise_floor: 0.0005,
            runs: vec![run],
            windows: vec![window; 2],
        }),
        series: vec![RunSeries { whole: ResidualSeries { starts: vec![0], ..windows.clone() }, windows }],
        laws: vec![Law {
            variable: Variable::Velocity,
            effects: vec!["coulomb_friction".into()],
            curves: vec![curve([0.0, -2.0], 0.23), curve([0.0, 2.0], -0.23)],
            points: vec![point(-1.0, 0.22, false), point(1.0, -0.24, true)],
        }],
        tracks: vec![track("run_0", false), track(RUN, true)],
        coverage: Coverage {
            position: (-1.0, 1.0),
            speed: (0.5, 1.0),
            effort_rms: 0.4,
            ..Coverage::default()
        },
        in_format: Vec::new(),
        replay: Vec::new(),
        nearest: None,
        off_axis: None,
        doubt: None,
    }
}

fn page(edit: impl FnOnce(&mut JointReport)) -> String {
    let mut joint = joint(200);
    edit(&mut joint);
    let note = ExportNote {
        format: "urdf".into(),
        file: "twin.urdf".into(),
        joint: JOINT.into(),
        effect: "coulomb_friction".into(),
        status: ExportStatus::InFile("native"),
        by: Vec::new(),
        rmse: Some(0.001),
        before: Some(0.01),
    };
    diagnosis_page(&DiagnosisFacts {
        joints: &[joint],
        effects: &catalogue(0),
        tree: &tree(),
        urdf: "<robot name=\"r\"/>",
        exports: &[note],
        warnings: &[Note::new(NoteCode::TopicsChosen, "a < b")],
    })
}

/// Text between tags, in order.
fn texts(html: &str) -> String {
    let inside = |part: &str| part.split_once('>').map_or(String::new(), |(_, text)| text.trim().to_owned());
    html.split('<').skip(1).map(inside).filter(|t| !t.is_empty()).collect::<Vec<_>>().join("|")
}

#[test]
fn values_are_twin_and_found_and_their_sum() {
    let html = page(|_| {});
    let text = texts(&html);
    for row in [
        // The twin has a friction of 0.1 already, and a damping of 0.3, of which a third goes.
        "coulomb friction|friction|0.100|+|0.230|=|0.330|N\u{a0}m|0.310 to 0.350",
        "torque gain|gain|1.000|\u{d7}|0.950|=|0.950|0.930 to 0.970",
        "viscous friction|damping|0.300|\u{2212}|0.100|=|0.200|N\u{a0}m\u{a0}s/rad|0.180 to 0.220",
    ] {
        assert!(text.contains(row), "'{row}' is not in {text}");
    }
    assert!(html.contains("coulomb friction 0.100 + 0.230 = 0.330\u{a0}N\u{a0}m"));
    for said in [
        "Next experiment:",
        "reverse slowly six times or more, at two speeds",
        "coulomb friction (weight 1.00), or stribeck friction (0.20)",
        "10.0|mrad",
        "beyond bounds",
        "95\u{a0}%|",
        "URDF",
        "native",
    ] {
        assert!(text.contains(said) || html.contains(said), "'{said}' is not in {text}");
    }
}

#[test]
fn what_may_be_absent_is_no_name() {
    let unsure = |joint: &mut JointReport| joint.diagnosis.findings[2].is_sure = false;
    let html = page(unsure);
    let name = "viscous friction 0.300 \u{2212} 0.100 = 0.200";
    assert!(page(|_| {}).contains(name) && !html.contains(name));
    // The files hold it, so that the table of values does, too.
    let row = "viscous friction|damping|0.300|\u{2212}|0.100|=|0.200";
    assert!(html.contains("viscous friction may be absent") && texts(&html).contains(row));
    let mut joint = joint(200);
    unsure(&mut joint);
    let said = summary_of_joints(std::slice::from_ref(&joint));
    assert!(said.contains("  perhaps viscous_friction: damping -0.1000 [-0.1200, -0.0800]"), "{said}");
    let json = serde_json::to_value(report(&[joint], Vec::new())).unwrap();
    let names = |of: &str| -> Vec<String> {
        json[of].as_array().unwrap().iter().map(|f| f["effect"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(names("findings"), ["coulomb_friction", "torque_gain"]);
    assert_eq!(names("unsure"), ["viscous_friction"]);
}

#[test]
fn the_windows_that_are_shaded_are_those_of_the_held_out_run() {
    let html = page(|_| {});
    let rects = |class: &str| {
        let own = html.split("<rect ").filter(|r| r.starts_with(&format!("class=\"{class}\"")));
        let number = |rect: &str, name: &str| -> f64 {
            let (_, rest) = rect.split_once(&format!(" {name}=\"")).unwrap();
            rest.split('"').next().unwrap().parse().unwrap()
        };
        own.map(|r| (number(r, "x"), number(r, "width"))).collect::<Vec<_>>()
    };
    // Two windows of 0 to 0.99 s and 1 to 1.99 s, in the charts of positions and of residuals.
    let windows = rects("window");
    assert_eq!(windows.len(), 4, "{windows:?}");
    assert_eq!(windows[..2], windows[2..]);
    let scale = (1180.0 - 62.0 - 10.0) / 1.99;
    for ((x, width), start) in windows.iter().zip([0.0, 1.0]) {
        assert!(
            (x - 62.0 - start * scale).abs() < 0.06 && (width - 0.99 * scale).abs() < 0.06,
            "{windows:?}"
        );
    }
    // Of two runs as long as each other the second is held out.
    let [(x, width)] = rects("held")[..] else { panic!("{html}") };
    assert!(x > 620.0 && (x + width - 1170.0).abs() < 0.1, "{x} {width}");
}

#[test]
fn names_cannot_become_markup_and_nothing_is_loaded() {
    let html = page(|_| {});
    for loaded in ["http:", "https:", "<script", "<link", "@import", "url(", "src=", "<b>2"] {
        assert!(!html.contains(loaded), "{loaded}");
    }
    assert!(html.contains("&lt;script&gt;hinge") && html.contains("run&quot;&gt;&lt;b&gt;2"));
    assert!(html.contains("a &amp; b") && html.contains("a &lt; b"));
    assert_eq!(html, page(|_| {}));
}

#[test]
fn every_element_is_closed_under_every_verdict() {
    let all = [Verdict::None, Verdict::Named, Verdict::Ambiguous, Verdict::Unknown, Verdict::Insufficient];
    for verdict in all {
        let html = page(|joint| {
            joint.diagnosis.verdict = verdict;
            if matches!(verdict, Verdict::None | Verdict::Unknown | Verdict::Insufficient) {
                joint.diagnosis.findings.clear();
                joint.diagnosis.model = JointModel::of_plant(&plant());
                joint.diagnosis.lacks = vec!["record 10 s or more".into()];
            }
        });
        for tag in ["section", "div", "table", "tr", "td", "th", "svg", "p", "h2", "h3", "span", "main", "i"]
        {
            let open = html.matches(&format!("<{tag}>")).count() + html.matches(&format!("<{tag} ")).count();
            assert_eq!(open, html.matches(&format!("</{tag}>")).count(), "{tag} under {}", verdict.name());
        }
        let svgs = html.split("<svg ").skip(1).map(|s| s.split("</svg>").next().unwrap());
        for svg in svgs {
            let text = format!("<svg {svg}</svg>");
            assert!(roxmltree::Document::parse(&text).is_ok(), "{text}");
            assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
        }
        let is_updated = matches!(verdict, Verdict::Named | Verdict::Ambiguous);
        assert_eq!(html.contains("key updated"), is_updated, "{}", verdict.name());
    }
}

#[test]
fn long_runs_make_no_long_page() {
    let short = page(|_| {}).len();
    let long = page(|j| *j = joint(200_000)).len();
    assert!(long < short + 200_000, "{short} {long}");
}
