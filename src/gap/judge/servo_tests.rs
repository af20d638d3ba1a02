//! Joints that follow commanded positions, without an effort.

use rand_core::SeedableRng;

use super::simulated::{pendulum, split, with};
use crate::{
    fit::{
        actuation::{ActuationError, actuated_plant},
        rollout::{Start, roll_starts},
    },
    judge::assess::assess,
    model::{
        actuator::{Actuator, Servo},
        effects::catalogue,
        joint_model::JointModel,
        plant::Plant,
    },
    record::{
        command::{Told, ToldServo},
        drive::{Drive, Hold},
        log::{JointLog, Span},
    },
};

/// A run in which a servo follows steps and a wave; positions are those of a noisy sensor.
fn followed(truth: &JointModel, run: usize, rng: &mut impl rand_core::Rng) -> JointLog {
    let n = 1500;
    let time_s: Vec<f64> = (0..n).map(|k| 0.01 * f64::from(k)).collect();
    let step = |t: f64| 0.4 * ((1.7 * t + run as f64).sin() * 3.0).round() / 3.0;
    let commanded = time_s.iter().map(|t| step(*t) + 0.2 * (2.9 * t + 1.1 * run as f64).sin()).collect();
    let mut log = JointLog {
        run: format!("run_{run}"),
        position: vec![0.0; time_s.len()],
        effort: vec![0.0; time_s.len()],
        commanded,
        time_s,
        ..JointLog::default()
    };
    let effects = catalogue(0);
    let drive = Drive::with_steps(&log, Hold::Zero, 0.0, 20);
    let whole = Span { log: 0, start: 0, len: log.time_s.len() };
    let mut position = Vec::new();
    roll_starts(truth, &effects, &log, &drive, whole, Start::default(), |q, _| position.push(q));
    log.position =
        position.iter().map(|q| q + 1e-4 * (f64::from(rng.next_u32()) / f64::from(u32::MAX) - 0.5)).collect();
    log
}

fn servo(stiffness: f64, damping: f64, limit: f64) -> Plant {
    let servo = Some(Servo { stiffness, limit });
    Plant { actuator: Actuator { damping, servo, ..Actuator::default() }, ..pendulum(0.5) }
}

#[test]
fn a_friction_behind_a_servo_is_named_and_the_servo_found() {
    let effects = catalogue(0);
    for (limit, told) in [
        (f64::INFINITY, Told::default()),
        (
            1.2,
            Told { servos: vec![ToldServo { limit: Some(1.2), ..ToldServo::default() }], ..Told::default() },
        ),
    ] {
        let truth = with(&effects, &servo(6.0, 0.25, limit), &[("coulomb_friction", &[0.12])]);
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(3);
        let mut runs = split((0..3).map(|run| followed(&truth, run, &mut rng)).collect());
        let plant =
            actuated_plant("hinge", &pendulum(0.5), &mut runs.fitted, &mut runs.held_out, &told).unwrap();
        let report = assess(&effects, &plant, "hinge", runs, &mut rng);
        let found: Vec<&str> = report.diagnosis.findings.iter().map(|f| f.effect.as_str()).collect();
        assert_eq!(found, ["coulomb_friction"], "limit {limit}");
        let friction = report.diagnosis.findings[0].parameters[0].value;
        assert!((friction - 0.12).abs() < 0.006, "limit {limit}: {friction}");
        let [stiffness, damping, _] = &report.diagnosis.actuator[..] else { panic!("three are found") };
        assert!((stiffness.value - 6.0).abs() < 0.12, "limit {limit}: {stiffness:?}");
        // The twin's damping of 0.02 is its own.
        assert!((damping.value - 0.25).abs() < 0.02, "limit {limit}: {damping:?}");
    }
}

#[test]
fn commands_of_another_joint_are_refused() {
    let effects = catalogue(0);
    let truth = with(&effects, &servo(6.0, 0.25, f64::INFINITY), &[]);
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(4);
    let mut logs: Vec<JointLog> = (0..2).map(|run| followed(&truth, run, &mut rng)).collect();
    // The joint goes the other way than these.
    for log in &mut logs {
        log.commanded.iter_mut().for_each(|c| *c *= -5.0);
    }
    let refused = actuated_plant("hinge", &pendulum(0.5), &mut logs, &mut [], &Told::default()).unwrap_err();
    assert_eq!(refused, ActuationError::Idle("hinge".into()));
}
