//! A case: a made object, its twin and recordings with something hidden, and what the program says of them.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use io::{
    Place,
    ros2msg::{Header, JointState, Time},
    write_synth_bag, write_true_twin,
};
use serde_json::Value;
use synth::{Family, Object, SynthConfig, film_take, further_states, generate};

use crate::{
    common::{BagWriter, START, write_metadata},
    hidden::{Hidden, PART, RECORDINGS, hide_in_recording, hide_in_states, hide_in_twin, recorded_position},
};
use geometry::AxisMotion;

/// Seeds that are tried for an object that a case can use.
const TRIES: u64 = 50;
/// Joint states of a recording.
const JOINT_STATES: i64 = 5;
/// Time between them, nanoseconds.
const JOINT_PERIOD: i64 = 100_000_000;

/// A folder that goes away with the value.
pub struct Folder(pub PathBuf);

impl Folder {
    /// An empty one.
    pub fn new(name: &str) -> Self {
        let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()));
        fs::remove_dir_all(&path).ok();
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.0).ok();
    }
}

/// What the program said, and of what.
pub struct Diagnosed {
    /// The summary on the terminal.
    pub summary: String,
    /// `report.json`.
    pub report: Value,
    /// The object.
    pub object: Object,
    /// The object as it was meant to be filmed, in state 1 of each.
    pub states: Vec<Object>,
    /// The seed that it came from.
    pub seed: u64,
}

/// Makes a case and diagnoses it.
pub fn diagnose(hidden: Hidden, seed: u64) -> Diagnosed {
    let folder = Folder::new(&format!("gap-frames-{hidden:?}-{seed}"));
    let config = SynthConfig {
        seed,
        parts: Some(2),
        family: hidden.needs_screw().then_some(Family::CappedBox),
        width: 320,
        height: 240,
        views: 12,
        ..SynthConfig::default()
    };
    let (object, config) = usable(&config, hidden);
    write_true_twin(&Place::at(folder.0.join("twin")), &object).unwrap();
    let urdf = folder.0.join("twin/truth/twin.urdf");
    hide_in_twin(hidden, &object, &urdf);
    let (summary, report) = film_and_diagnose(&folder.0, &urdf, hidden, &object, &config);
    let states = further_states(&object, RECORDINGS, &config).unwrap();
    Diagnosed { summary, report, object, states, seed: config.seed }
}

/// The object of a seed, or of the next whose joint suits what is hidden.
pub fn usable(config: &SynthConfig, hidden: Hidden) -> (Object, SynthConfig) {
    for k in 0..TRIES {
        let config = SynthConfig { seed: config.seed + 1000 * k, ..config.clone() };
        let Ok(object) = generate(&config) else { continue };
        let kind = object.parts[PART].joint.unwrap().kind;
        let is_screw = matches!(kind, AxisMotion::Screw { .. });
        let turns = kind != AxisMotion::Prismatic;
        if is_screw == hidden.needs_screw() && (turns || !hidden.needs_turn()) {
            return (object, config);
        }
    }
    panic!("{hidden:?}: no seed from {} on has an object with such a joint", config.seed);
}

/// Films further states of an object and diagnoses a twin by them: summary and report.
pub fn film_and_diagnose(
    folder: &Path,
    urdf: &Path,
    hidden: Hidden,
    object: &Object,
    config: &SynthConfig,
) -> (String, Value) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_artitwin"));
    // Cases go side by side.
    command.env("RAYON_NUM_THREADS", "1");
    command.arg("diagnose").arg(urdf).arg("--out").arg(folder.join("out"));
    let mut states = further_states(object, RECORDINGS, config).unwrap();
    let positions: Vec<f64> = states.iter().map(|state| recorded_position(hidden, state)).collect();
    hide_in_states(hidden, &mut states, config.seed);
    for (k, state) in states.iter().enumerate() {
        let take = k + 2;
        let mut recording = film_take(state, 1, take, config);
        hide_in_recording(hidden, &mut recording);
        let bag = folder.join(format!("state{take}"));
        fs::remove_dir_all(&bag).ok();
        write_synth_bag(&bag, take, &recording).unwrap();
        if hidden.has_positions() {
            add_positions(&bag, &format!("{}_joint", state.parts[PART].name), positions[k]);
        }
        command.arg("--frames").arg(bag);
    }
    let output = command.output().unwrap();
    assert!(output.status.success(), "{hidden:?}: {}", String::from_utf8_lossy(&output.stderr));
    let page = fs::read_to_string(folder.join("out/report.html")).unwrap();
    assert!(page.matches("<img").count() >= 4, "{hidden:?}: the page shows no pictures");
    let report = serde_json::from_str(&fs::read_to_string(folder.join("out/report.json")).unwrap()).unwrap();
    (String::from_utf8_lossy(&output.stdout).into_owned(), report)
}

/// Adds joint states to a bag, as a second file of it.
fn add_positions(bag: &Path, joint: &str, position: f64) {
    let is_mcap = |name: &String| name.ends_with(".mcap");
    let names = fs::read_dir(bag).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let images = names.filter(is_mcap).collect::<Vec<_>>();
    let mut writer = BagWriter::create(&bag.join("joints.mcap"), None, 100_000);
    for k in 0..JOINT_STATES {
        let nanos = START + k * JOINT_PERIOD;
        let state = JointState {
            header: Header { stamp: Time::from_nanos(nanos), frame_id: String::new() },
            name: vec![joint.to_owned()],
            position: vec![position],
            ..JointState::default()
        };
        writer.message("/joint_states", "sensor_msgs/msg/JointState", nanos, &state);
    }
    writer.finish();
    write_metadata(bag, &[images[0].as_str(), "joints.mcap"], "");
}
