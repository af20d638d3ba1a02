//! The Python package `artitwin.effects` against the program's own laws and roll-out: the same torques for
//! every effect, and the same motion in MuJoCo, PyBullet and Drake.
//!
//! Needs Python (see `common/venv.rs`).

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

#[path = "common/harness.rs"]
mod harness;
#[path = "common/venv.rs"]
mod venv;

use std::{
    path::{Path, PathBuf},
    process::{Command, ExitCode},
    sync::OnceLock,
};

use export::diagnosed::effects::{EffectLaw, EffectsFile, JointLaw, LAYOUT, LawKind};
use gap::{
    fit::rollout::{Start, roll_starts},
    model::{
        effects::catalogue,
        joint_model::{CREEP, Catalogue, JointModel, Term},
        plant::Plant,
    },
    record::{
        drive::{Drive, Hold},
        log::{JointLog, Span},
    },
};
use harness::{Missing, tests};
use serde_json::{Value, json};

fn main() -> ExitCode {
    harness::main(tests![
        every_effect_has_the_same_torque,
        every_effect_moves_the_joint_alike_in_simulators,
        the_door_of_the_page_clicks_shut,
    ])
}

/// Parameters of every effect of `catalogue(1)`, at which it matters to the lid.
const PARAMETERS: [(&str, &[f64]); 23] = [
    ("coulomb_friction", &[0.3]),
    ("viscous_friction", &[0.2]),
    ("constant_bias", &[0.4]),
    ("inertia", &[0.06]),
    ("torque_gain", &[1.3]),
    ("encoder_scale", &[1.1]),
    ("encoder_bias", &[0.08]),
    ("delay", &[0.02]),
    ("quadratic_drag", &[0.15]),
    ("load_dependent_friction", &[0.25]),
    ("spring_return", &[1.5, 0.4]),
    ("axis_tilt", &[0.5, -0.4]),
    ("asymmetric_friction", &[0.2, 0.5]),
    ("stribeck_friction", &[0.2, 0.3, 0.4]),
    ("hardening_spring", &[1.0, 2.0, 0.3]),
    ("local_friction", &[0.8, 0.1, 0.15]),
    ("detent", &[0.6, 0.1, 0.15]),
    ("backlash", &[0.05]),
    ("cogging", &[0.3, 0.2, 12.0]),
    ("disturbance", &[1.0, 0.7, 0.1]),
    ("end_stop", &[60.0, 0.5, 0.2, 0.3]),
    ("end_stop", &[60.0, 0.5, -0.1, 0.3]),
    ("coupling", &[1.0, 1.5, 0.2]),
];
/// Position of the drawer, m: the other joint of the coupling, which stands.
const DRAWER: f64 = 0.3;
/// Interval of the samples of a roll-out, seconds, and their number.
const SAMPLE_S: f64 = 0.005;
const SAMPLES: usize = 401;
/// A step so short that what changes within it does not count, seconds; a power of two, so that sums of steps
/// are exact.
const SHORT_S: f64 = 1.0 / 536_870_912.0;

/// A lid with gravity and a drawer beside it. Simulators take the base's mass for granted.
const URDF: &str = "<robot name=\"twin\"><link name=\"base\"><inertial><mass value=\"1\"/>\
    <inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial></link>\
    <link name=\"lid\"><inertial><origin xyz=\"0.05 0 0\"/><mass value=\"2\"/>\
    <inertia ixx=\"0.1\" ixy=\"0\" ixz=\"0\" iyy=\"0.1\" iyz=\"0\" izz=\"0.1\"/></inertial></link>\
    <joint name=\"lid_joint\" type=\"continuous\"><parent link=\"base\"/><child link=\"lid\"/>\
    <axis xyz=\"0 -1 0\"/><dynamics damping=\"0.3\" friction=\"0\"/></joint>\
    <link name=\"drawer\"><inertial><mass value=\"1\"/>\
    <inertia ixx=\"0.1\" ixy=\"0\" ixz=\"0\" iyy=\"0.1\" iyz=\"0\" izz=\"0.1\"/></inertial></link>\
    <joint name=\"drawer_joint\" type=\"prismatic\"><parent link=\"base\"/><child link=\"drawer\"/>\
    <origin xyz=\"0 3 0\"/><axis xyz=\"1 0 0\"/><limit lower=\"-9\" upper=\"9\" effort=\"100\" \
    velocity=\"20\"/></joint></robot>";

/// One effect at the lid.
struct Case<'a> {
    catalogue: &'a Catalogue,
    effect: usize,
    model: JointModel,
}

impl Case<'_> {
    /// The end of a motion under efforts that are commanded at samples; `each` receives the readings.
    fn end_of_motion(
        &self,
        time_s: Vec<f64>,
        commands: &[f64],
        first: usize,
        start: Start,
        each: impl FnMut(f64),
    ) -> Start {
        let count = time_s.len();
        let log = JointLog {
            position: vec![0.0; count],
            effort: commands.to_vec(),
            others: vec![vec![DRAWER; count]],
            time_s,
            ..JointLog::default()
        };
        let drive = Drive::with_steps(&log, Hold::Zero, self.model.delay_s(self.catalogue), 1);
        let span = Span { log: 0, start: first, len: count - first };
        let mut each = each;
        roll_starts(&self.model, self.catalogue, &log, &drive, span, start, |reading, _| each(reading))
    }

    /// Torques over a grid of states; each follows from the change of velocity in one short step.
    fn torques(&self) -> Vec<Value> {
        let mut rows = Vec::new();
        for place in -12..13 {
            for velocity in [-1.1, -0.05, -3e-9, 0.0, 3e-9, 0.05, 1.1] {
                for command in [-1.5, 0.1, 0.8] {
                    let position = 0.08 * f64::from(place) + 0.013;
                    rows.push(self.torque_row(position, velocity, command));
                }
            }
        }
        rows
    }

    fn torque_row(&self, position: f64, velocity: f64, command: f64) -> Value {
        let delay_s = if self.catalogue[self.effect].name() == "delay" { 3.0 * SHORT_S } else { 0.0 };
        let mut short = Self { model: self.model.clone(), ..*self };
        if delay_s > 0.0 {
            short.model.terms[0].p[0] = delay_s;
        }
        let first_s = 0.6875;
        let time_s: Vec<f64> = (0..6).map(|k| first_s + SHORT_S * f64::from(k)).collect();
        let commands: Vec<f64> = (0..6).map(|k| command * (1.0 + 0.1 * f64::from(k))).collect();
        let start = Start { position, velocity, play: 0.0 };
        let end = short.end_of_motion(time_s, &commands, 4, start, |_| {});
        let torque = self.model.plant.inertia * (end.velocity - velocity) / SHORT_S;
        json!({
            "position": position + 0.5 * SHORT_S * velocity, "velocity": velocity, "commands": commands[..5],
            "first_s": first_s, "step_s": SHORT_S, "delay_s": delay_s, "torque": torque,
        })
    }

    /// Readings of a motion of two seconds.
    fn readings(&self, start: Start, commands: &[f64]) -> Vec<f64> {
        let time_s = (0..SAMPLES).map(|k| SAMPLE_S * k as f64).collect();
        let mut readings = Vec::with_capacity(SAMPLES);
        self.end_of_motion(time_s, commands, 0, start, |reading| readings.push(reading));
        readings
    }

    fn law(&self) -> JointLaw {
        let law = |term: &Term| {
            let other = self.catalogue[term.effect].other_joint().map(|_| ("drawer_joint", false));
            EffectLaw::of_term(self.catalogue, term, true, other)
        };
        let own = [(1, self.model.plant.damping), (0, self.model.plant.friction)];
        JointLaw {
            joint: "lid_joint".to_owned(),
            kind: LawKind::Revolute,
            settle_time_s: self.model.settle_s,
            creep_share: CREEP,
            twin: own.map(|(effect, value)| law(&Term { effect, p: vec![value] })).to_vec(),
            effects: self.model.terms.iter().map(law).collect(),
            files: Vec::new(),
        }
    }
}

/// A command that moves the lid to and fro.
fn commands() -> Vec<f64> {
    let mut commands = Vec::with_capacity(SAMPLES);
    for k in 0..SAMPLES {
        let t = SAMPLE_S * k as f64;
        commands.push(0.9 + 1.4 * (5.0 * t).cos() - 0.5 * (2.0 * t).sin());
    }
    commands
}

/// Folder with a `twin.urdf` and, for each effect, a folder with `effects.json` and `case.json`.
fn cases() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("effects");
        std::fs::remove_dir_all(&folder).ok();
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("twin.urdf"), URDF).unwrap();
        let (tree, _) = io::read_twin(&folder.join("twin.urdf"), [0.0, 0.0, -9.81]).unwrap();
        let joint = tree.joints.iter().position(|j| j.name == "lid_joint").unwrap();
        let plant = Plant::of_joint(&tree, joint).unwrap();
        let catalogue = catalogue(1);
        assert_eq!(catalogue.len(), PARAMETERS.len());
        for (effect, (name, p)) in PARAMETERS.iter().enumerate() {
            assert_eq!(catalogue[effect].name(), *name);
            let mut model = JointModel::of_plant(&plant).with_effect(effect, p);
            // Friction that settles is that of every second effect, friction at once that of the others.
            model.settle_s = if effect % 2 == 0 { 0.0 } else { 0.005 };
            let case = Case { catalogue: &catalogue, effect, model };
            write_case(&folder.join(format!("{effect:02}_{name}")), &case);
        }
        folder
    })
}

fn write_case(folder: &Path, case: &Case) {
    std::fs::create_dir(folder).unwrap();
    let file = EffectsFile { format: LAYOUT.to_owned(), joints: vec![case.law()] };
    std::fs::write(folder.join("effects.json"), serde_json::to_string_pretty(&file).unwrap()).unwrap();
    let plant = &case.model.plant;
    let start = Start { position: 0.1, velocity: 0.0, play: 0.0 };
    let commands = commands();
    let twin = Case { model: case.model.without_effects(), ..*case };
    let content = json!({
        "inertia": plant.inertia, "damping": plant.damping,
        "load": [plant.load.constant, plant.load.sine, plant.load.cosine],
        "drawer": DRAWER, "torques": case.torques(), "sample_s": SAMPLE_S, "commands": commands,
        "reading": case.readings(start, &commands), "twin_reading": twin.readings(start, &commands),
        "true_position": start.position,
    });
    std::fs::write(folder.join("case.json"), content.to_string()).unwrap();
}

/// Runs a script of `tests/python/effects`.
fn check(script: &str, arguments: &[&Path]) -> Result<(), Missing> {
    let python = venv::python()?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut command = Command::new(python);
    command.arg(root.join("tests/python/effects").join(script)).args(arguments);
    let output = command.env("PYTHONPATH", root.join("python")).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
    Ok(())
}

fn every_effect_has_the_same_torque() -> Result<(), Missing> {
    check("torques.py", &[cases()])
}

fn every_effect_moves_the_joint_alike_in_simulators() -> Result<(), Missing> {
    check("simulators.py", &[cases()])
}

/// The commands and the code of docs/effects.md, with a viewer that shows nothing.
fn the_door_of_the_page_clicks_shut() -> Result<(), Missing> {
    let work = Path::new(env!("CARGO_TARGET_TMPDIR")).join("effects_page");
    std::fs::remove_dir_all(&work).ok();
    std::fs::create_dir_all(&work).unwrap();
    check("page.py", &[Path::new(env!("CARGO_BIN_EXE_artitwin")), &work])
}
