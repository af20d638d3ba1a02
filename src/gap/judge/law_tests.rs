//! Laws of simulated joints whose effects are known.

use rand_core::SeedableRng;

use super::{
    assess::assess,
    law::{Law, Way},
    locate::Variable,
    report::JointReport,
    simulated::{pendulum, simulated, split, with},
};
use crate::model::effects::catalogue;

fn diagnosed(truth: &[(&str, &[f64])]) -> JointReport {
    let effects = catalogue(0);
    let plant = pendulum(0.6);
    let truth = with(&effects, &plant, truth);
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(5);
    let runs = split((0..3).map(|run| simulated(&effects, &truth, run, &mut rng)).collect());
    assess(&effects, &plant, "joint", runs, &mut rng)
}

/// Points of fitted and of held-out runs stand where `truth` says, but for their own scatter.
fn stand_on(law: &Law, truth: impl Fn(f64) -> f64, within: f64) {
    for is_held_out in [false, true] {
        let points: Vec<_> = law.points.iter().filter(|p| p.is_held_out == is_held_out).collect();
        assert!(points.len() >= 6, "{} points", points.len());
        for p in points {
            assert!((p.effort - truth(p.x)).abs() < within + 2.0 * p.half, "{p:?}");
        }
    }
}

#[test]
fn friction_steps_at_rest_and_the_twin_lacks_as_much() {
    let report = diagnosed(&[("coulomb_friction", &[0.1])]);
    let [law] = &report.laws[..] else { panic!("{:?}", report.laws) };
    assert_eq!(
        (law.variable, law.effects.as_slice()),
        (Variable::Velocity, &["coulomb_friction".into()][..])
    );
    assert_eq!(law.curves.len(), 2, "one a way");
    for curve in &law.curves {
        assert_eq!(curve.way, Way::Both);
        let side = -curve.x[1].signum();
        for (effort, half) in curve.effort.iter().zip(&curve.half) {
            assert!(
                (effort - 0.1 * side).abs() < 1.5 * half && *half > 0.0 && *half < 0.02,
                "{effort} {half}"
            );
        }
    }
    stand_on(law, |v| -0.1 * v.signum(), 0.02);
}

#[test]
fn a_spring_is_drawn_over_the_position_with_friction_taken_off() {
    let report = diagnosed(&[("coulomb_friction", &[0.1]), ("spring_return", &[0.4, 0.1])]);
    let law = report.laws.iter().find(|l| l.variable == Variable::Position).unwrap();
    assert!(law.effects.contains(&"spring_return".to_owned()), "{:?}", law.effects);
    for (x, effort) in law.curves[0].x.iter().zip(&law.curves[0].effort) {
        assert!((effort - (0.1 - 0.4 * x)).abs() < 0.02, "{x} {effort}");
    }
    stand_on(law, |q| 0.1 - 0.4 * q, 0.03);
}

#[test]
fn an_inertia_is_drawn_over_the_acceleration_of_the_model() {
    let report = diagnosed(&[("inertia", &[0.02])]);
    let law = report.laws.iter().find(|l| l.variable == Variable::Acceleration).unwrap();
    stand_on(law, |a| -0.02 * a, 0.02);
}

#[test]
fn without_a_name_the_twin_lacks_nothing() {
    let report = diagnosed(&[]);
    assert!(!report.laws.is_empty());
    for law in &report.laws {
        assert!(law.curves.is_empty() && law.effects.is_empty());
        for p in &law.points {
            assert!(p.effort.abs() < 0.02 + 2.0 * p.half, "{:?} {p:?}", law.variable);
        }
    }
}
