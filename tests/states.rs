//! Objects in more than two states: every state adds what it shows.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic")]

#[path = "common/opened.rs"]
mod opened;

use std::path::PathBuf;

use config::{Config, Layers};
use geometry::AxisMotion;
use io::write_synth_bag;
use model::{Joint, JointKind};
use opened::open;
use run::{Monitor, Stages, Twin, reconstruct_twin};
use synth::{Family, Object, SynthConfig, film_take, generate};

fn config() -> Config {
    let mut layers = Layers::new(&Config::default()).unwrap();
    layers.add_preset("preview").unwrap();
    layers.resolve::<Config>().unwrap().config
}

fn cabinet(seed: u64, parts: usize) -> (Object, SynthConfig) {
    let family = Some(Family::Cabinet);
    let config = SynthConfig {
        seed,
        parts: Some(parts),
        family,
        textured: Some(true),
        views: 9,
        width: 320,
        height: 240,
        ..SynthConfig::default()
    };
    (generate(&config).unwrap(), config)
}

/// Positions of all joints in state 0 or 1 of an object.
fn positions(object: &Object, state: usize) -> Vec<f64> {
    object.parts.iter().filter_map(|p| p.joint).map(|j| j.positions[state]).collect()
}

/// The twin of an object whose joints stand at some positions, one list a state.
fn twin(name: &str, object: &Object, states: &[Vec<f64>], synth: &SynthConfig) -> Twin {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::remove_dir_all(&folder).ok();
    for (k, positions) in states.iter().enumerate() {
        let mut object = object.clone();
        let joints = object.parts.iter_mut().filter_map(|p| p.joint.as_mut());
        joints.zip(positions).for_each(|(joint, q)| joint.positions = [*q; 2]);
        write_synth_bag(&folder.join(format!("state{k}")), k, &film_take(&object, 0, k, synth)).unwrap();
    }
    let mut capture = open(std::slice::from_ref(&folder), &config().capture, 0).unwrap();
    assert_eq!(capture.states.len(), states.len());
    std::fs::remove_dir_all(&folder).unwrap();
    let monitor = Monitor::silent();
    reconstruct_twin("object", &mut capture, None, &config(), &mut Stages::new(&monitor)).unwrap()
}

/// The joint of the twin that is a part's: its axis lies nearest to the part's; angle between the axes,
/// degrees.
fn joint_of<'a>(twin: &'a Twin, object: &Object, part: usize) -> (usize, &'a Joint, f64) {
    let (axis, origin) = object.axis_in_world(part).unwrap();
    let place = |j: usize| twin.model.world_from_link(twin.model.joints[j].child, &twin.model.states[0]);
    let axis_of = |j: usize| place(j).rotation * twin.model.joints[j].axis;
    let off_m = |j: usize| {
        (place(j).translation.vector - origin.coords).cross(&axis).norm() + axis_of(j).cross(&axis).norm()
    };
    let best = (0..twin.model.joints.len()).min_by(|a, b| off_m(*a).total_cmp(&off_m(*b))).unwrap();
    (best, &twin.model.joints[best], axis_of(best).cross(&axis).norm().asin().to_degrees())
}

/// Root of the sum of the variances of the axis direction, degrees.
fn axis_std_deg(joint: &Joint) -> f64 {
    (0..3).map(|i| joint.evidence.covariance[(i, i)]).sum::<f64>().sqrt().to_degrees()
}

#[test]
fn parts_that_move_in_different_states_are_both_found() {
    let (object, synth) = cabinet(3200, 3);
    let (zero, one) = (positions(&object, 0), positions(&object, 1));
    let twin = twin(
        "states-in-turn",
        &object,
        &[zero.clone(), vec![one[0], zero[1]], vec![zero[0], one[1]]],
        &synth,
    );
    assert_eq!(twin.model.joints.len(), 2, "{:?}", twin.part_count);
    assert_eq!(twin.model.states.len(), 3);
    for part in [1, 2] {
        let (j, joint, degrees) = joint_of(&twin, &object, part);
        let motion = one[part - 1] - zero[part - 1];
        eprintln!(
            "part {part}: {:?}, axis {degrees:.3} deg off, positions {:?}",
            joint.kind,
            twin.model.states.iter().map(|s| s[j]).collect::<Vec<_>>()
        );
        let slides = object.parts[part].joint.unwrap().kind == AxisMotion::Prismatic;
        assert_eq!(joint.kind, if slides { JointKind::Prismatic } else { JointKind::Revolute });
        // Measured: 0.05 and 0.17 deg.
        assert!(degrees < 0.32, "{degrees}");
        // It moves in one state, measured 0.0007 and 0.0018 rad off, and rests in the other, 0.0011 and
        // 0.0012 rad off.
        let found = |state: usize| twin.model.states[state][j].abs();
        assert!(
            (found(part) - motion.abs()).abs() < 0.0031 && found(3 - part) < 0.0022,
            "{:?}",
            twin.model.states
        );
    }
}

#[test]
fn a_third_position_of_a_door_narrows_its_axis() {
    let (object, synth) = cabinet(3200, 2);
    let states = [0.6, 1.1, 1.6].map(|q| vec![q]);
    let [two, three] = [2, 3].map(|k| twin(&format!("states-door-{k}"), &object, &states[..k], &synth));
    let [(_, of_two, off_two), (_, of_three, off_three)] =
        [joint_of(&two, &object, 1), joint_of(&three, &object, 1)];
    let [std_two, std_three] = [axis_std_deg(of_two), axis_std_deg(of_three)];
    eprintln!(
        "two states: {off_two:.3} deg off, {std_two:.3} by the covariance; three: {off_three:.3}, \
         {std_three:.3}"
    );
    assert_eq!(of_two.kind, of_three.kind);
    assert!(std_three < std_two, "{std_three} {std_two}");
    assert!(off_three < 4.0 * std_three.max(0.05) && of_three.evidence.position_std.len() == 2);
    let limit = three.model.joints[0].limit;
    assert!(limit.lower <= 0.0 && limit.upper > limit.lower);
}
