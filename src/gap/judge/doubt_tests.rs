//! Simulated joints whose twin or efforts are in another convention, and such with effects alone.

use nalgebra::{Matrix3, Point3, Unit, Vector3};
use rand_core::SeedableRng;

use super::{
    doubt::{Doubt, JointScene, LOG_ODDS, Looks, Scene, doubts_of_scene},
    simulated::{beside, simulated, with},
    unsigned::magnitude_odds,
};
use crate::{
    fit::stretch::{Moved, RunMotion},
    judge::convention::CONVENTIONS,
    model::{effects::catalogue, plant::Plant},
    record::{drive::Hold, jitter::reading_noise, log::JointLog, motion::SmoothMotion},
    twin_tree::{Motion, TwinJoint, TwinLink, TwinTree},
};
use common::note::NoteCode;
use geometry::Pose;

/// Pendulums side by side, each of 0.05 kg m^2 under a load of 0.5 N m at most.
fn pendulums(count: usize) -> TwinTree {
    let link = |i: usize| TwinLink {
        name: format!("link_{i}"),
        mass_kg: if i == 0 { 0.0 } else { 0.5 / 9.81 / 0.3 },
        center_of_mass: Point3::new(0.0, 0.0, -0.3),
        inertia: Matrix3::identity() * (0.05 - 0.5 / 9.81 * 0.3),
        inertia_excess: 0.0,
    };
    let joint = |i: usize| TwinJoint {
        name: format!("joint_{i}"),
        motion: Motion::Turn,
        parent: 0,
        child: i + 1,
        parent_from_joint: Pose::identity(),
        axis: Unit::new_normalize(Vector3::y()),
        damping: 0.02,
        friction: 0.0,
        limit: None,
        mimic: None,
        is_free: false,
    };
    TwinTree {
        name: "pendulums".into(),
        links: (0..=count).map(link).collect(),
        joints: (0..count).map(joint).collect(),
        root: 0,
        gravity: Vector3::new(0.0, 0.0, -9.81),
    }
}

fn moved(log: JointLog) -> Option<Moved> {
    let noise = reading_noise(std::slice::from_ref(&log));
    let motion = SmoothMotion::of_positions(&log.time_s, &log.position, &noise, &[]);
    Some(Moved { log: Some(log), motion })
}

/// Runs of joints with effects.
fn logs(truth: &[(&str, &[f64])], runs: std::ops::Range<usize>) -> Vec<JointLog> {
    let effects = catalogue(0);
    let model = with(&effects, &Plant::of_joint(&pendulums(1), 0).unwrap(), truth);
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(5);
    runs.map(|run| simulated(&effects, &model, run, &mut rng)).collect()
}

fn found(tree: &TwinTree, runs: Vec<RunMotion>) -> Vec<Doubt> {
    let joints: Vec<usize> = (0..tree.joints.len()).collect();
    let scene = Scene { tree, runs: &runs, joints: &joints, hold: Some(Hold::Zero) };
    doubts_of_scene(&scene).into_values().collect()
}

fn of_one(tree: &TwinTree, logs: Vec<JointLog>) -> Vec<Doubt> {
    found(tree, logs.into_iter().map(|log| vec![moved(log)]).collect())
}

/// The twin as it would be written in a convention.
fn written(tree: &TwinTree, lengths: f64, masses: f64) -> TwinTree {
    let looks = CONVENTIONS.iter().find(|c| (c.lengths, c.masses, c.tensors) == (lengths, masses, 1.0));
    // The inverse of what brings it to SI units.
    let c = looks.unwrap();
    let inverse =
        crate::judge::convention::Convention { lengths: 1.0 / c.lengths, masses: 1.0 / c.masses, ..*c };
    inverse.converted_twin(tree)
}

const BRAKED: &[(&str, &[f64])] = &[("coulomb_friction", &[0.08]), ("viscous_friction", &[0.05])];

#[test]
fn a_twin_in_millimeters_or_grams_is_said() {
    for (lengths, masses, words, ratio) in [
        (1e-3, 1.0, "lengths look like millimeters", 1e6),
        (1.0, 1e-3, "masses look like grams", 1e3),
        (1e-3, 1e-3, "millimeters and its masses like grams", 1e9),
    ] {
        let twin = written(&pendulums(1), lengths, masses);
        let doubts = of_one(&twin, logs(BRAKED, 0..2));
        let [doubt] = &doubts[..] else { panic!("{words}: {doubts:?}") };
        println!("{}", doubt.note());
        assert_eq!(doubt.note_code(), NoteCode::UnitsDoubtful);
        assert_eq!(doubt.looks.len(), 1, "{doubt:?}");
        assert!(doubt.in_words().contains(words), "{}", doubt.in_words());
        assert!((0.5..2.0).contains(&(doubt.inertia_ratio / ratio)), "{doubt:?}");
    }
}

#[test]
fn efforts_of_the_opposite_sign_are_said() {
    let mut runs = logs(BRAKED, 0..2);
    runs.iter_mut().for_each(|l| l.effort.iter_mut().for_each(|u| *u = -*u));
    let doubts = of_one(&pendulums(1), runs);
    let [doubt] = &doubts[..] else { panic!("{doubts:?}") };
    println!("{}", doubt.note());
    assert_eq!(doubt.note_code(), NoteCode::EffortSignTurned);
}

#[test]
fn efforts_of_another_joint_are_said_of_both() {
    let twin = pendulums(2);
    let runs = |is_swapped: bool| -> Vec<RunMotion> {
        let mut left = logs(BRAKED, 0..2);
        let mut right = logs(BRAKED, 5..7);
        if is_swapped {
            left.iter_mut().zip(&mut right).for_each(|(a, b)| std::mem::swap(&mut a.effort, &mut b.effort));
        }
        left.into_iter().zip(right).map(|(a, b)| vec![moved(a), moved(b)]).collect()
    };
    assert_eq!(found(&twin, runs(false)), []);
    let doubts = found(&twin, runs(true));
    doubts.iter().for_each(|d| println!("{}", d.note()));
    let looks: Vec<Vec<Looks>> = doubts.into_iter().map(|d| d.looks).collect();
    let of = |name: &str| vec![Looks::EffortsOf(name.into())];
    assert_eq!(looks, [of("joint_1"), of("joint_0")]);
}

#[test]
fn no_effect_of_the_catalogue_is_taken_for_another_convention() {
    let effects: &[(&str, &[f64])] = &[
        ("coulomb_friction", &[0.15]),
        ("viscous_friction", &[0.2]),
        ("constant_bias", &[0.15]),
        ("inertia", &[0.1]),
        ("torque_gain", &[1.4]),
        ("torque_gain", &[0.5]),
        ("encoder_scale", &[1.3]),
        ("encoder_bias", &[0.2]),
        ("delay", &[0.05]),
        ("quadratic_drag", &[0.05]),
        ("load_dependent_friction", &[0.3]),
        ("spring_return", &[0.3, 0.1]),
        ("axis_tilt", &[0.2, 0.2]),
        ("asymmetric_friction", &[0.1, 0.2]),
        ("stribeck_friction", &[0.08, 0.1, 0.2]),
        ("hardening_spring", &[0.2, 0.2, 0.0]),
        ("local_friction", &[0.3, 0.0, 0.2]),
        ("detent", &[0.2, 0.0, 0.2]),
        ("backlash", &[0.05]),
        ("cogging", &[0.1, 0.1, 6.0]),
        ("disturbance", &[0.3, 2.0, 0.3]),
        ("end_stop", &[50.0, 0.2, 0.8, 0.0]),
    ];
    for (name, p) in effects {
        let doubts = of_one(&pendulums(1), logs(&[(name, p)], 0..2));
        assert_eq!(doubts, [], "{name}");
    }
}

#[test]
fn magnitudes_are_told_from_efforts_of_one_sense() {
    let twin = pendulums(1);
    let odds = |logs: Vec<JointLog>| {
        let runs: Vec<RunMotion> = logs.into_iter().map(|log| vec![moved(log)]).collect();
        let scene = Scene { tree: &twin, runs: &runs, joints: &[0], hold: Some(Hold::Zero) };
        magnitude_odds(&JointScene::of_joint(&scene, 0))
    };
    let mut magnitudes = logs(BRAKED, 0..2);
    // Counts of a servo's load, which know no sign.
    magnitudes.iter_mut().for_each(|l| l.effort.iter_mut().for_each(|u| *u = (500.0 * u.abs()).round()));
    let said = odds(magnitudes).unwrap();
    assert!(said > 20.0, "{said}");
    // A joint that a motor only ever pushes one way, against a spring.
    let effects = catalogue(0);
    let plant = Plant::of_joint(&twin, 0).unwrap();
    let truth = with(&effects, &plant, &[("spring_return", &[1.0, -1.0])]);
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(6);
    let pushed = (0..2).map(|run| beside(&effects, &truth, run, &mut rng, |_| 1.0));
    let one_sense = pushed.map(|mut log| {
        log.effort.iter_mut().for_each(|u| *u += 1.0);
        log
    });
    let said = odds(one_sense.collect());
    assert!(said.is_none_or(|odds| odds < LOG_ODDS), "{said:?}");
}
