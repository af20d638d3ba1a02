//! Doors that are pulled slowly: made efforts with noise that wanders.

use rand_core::Rng;

use super::*;
use crate::{
    judge::simulated::{pendulum, simulated, split, with},
    model::effects::catalogue,
    record::log::JointLog,
};
use numeric::random::stage_rng;

const INTERVAL_S: f64 = 0.02;
const SAMPLES: usize = 900;

fn door() -> Plant {
    Plant { inertia: 0.05, damping: 0.0, friction: 0.0, ..pendulum(0.0) }
}

/// A pull that opens the door in fits and starts, and with `returns` closes it again; `law` is the effort
/// that the door needs at a position and a velocity.
fn pull(run: usize, returns: bool, law: impl Fn(f64, f64) -> f64) -> JointLog {
    let mut rng = stage_rng(run as u64, "pull", 0);
    let mut noise = || f64::from(rng.next_u32()) / f64::from(u32::MAX) - 0.5;
    let time_s: Vec<f64> = (0..SAMPLES).map(|k| INTERVAL_S * k as f64).collect();
    let whole = time_s[SAMPLES - 1];
    let phase = run as f64;
    let mut wander = 0.0;
    let mut log = JointLog { run: format!("run_{run}"), time_s, ..JointLog::default() };
    for k in 0..SAMPLES {
        let x = std::f64::consts::TAU * log.time_s[k] / whole;
        // 1.5 rad over the run, there and back where it returns.
        let (q, v) = match returns {
            true => (0.75 * (1.0 - x.cos()), 0.75 * x.sin()),
            false => (0.24 * (x + 0.5 * (2.0 * x + phase).sin()), 0.24 * (1.0 + (2.0 * x + phase).cos())),
        };
        let v = v * std::f64::consts::TAU / whole;
        wander = 0.98 * wander + 0.06 * noise();
        log.position.push(q + 1e-5 * noise());
        log.effort.push(law(q, v) + wander + 0.02 * noise());
    }
    log
}

fn report(logs: Vec<JointLog>) -> Option<JointReport> {
    imposed_report(&catalogue(0), &door(), "door", &split(logs))
}

fn found_names(report: &JointReport) -> Vec<&str> {
    let mut names: Vec<&str> = report.diagnosis.findings.iter().map(|f| f.effect.as_str()).collect();
    names.sort_unstable();
    names
}

#[test]
fn a_closer_and_its_friction_are_named_where_the_door_goes_both_ways() {
    let law = |q: f64, v: f64| 1.2 * q + 0.4 + 0.5 * v.signum();
    let found = report((0..3).map(|run| pull(run, true, law)).collect()).unwrap();
    assert_eq!(found_names(&found), ["coulomb_friction", "spring_return"], "{:?}", found.diagnosis.findings);
    let gap = found.gap.as_ref().unwrap();
    assert!(gap.after < 0.2 * gap.before, "{gap:?}");
    for finding in &found.diagnosis.findings {
        let (at, truth) = match finding.effect.as_str() {
            "coulomb_friction" => (0, 0.5),
            _ => (0, 1.2),
        };
        let (low, high) = finding.parameters[at].interval;
        assert!(low < truth && truth < high && high - low < 0.5 * truth, "{finding:?}");
    }
    assert_eq!(found.gap_unit(), "N m");
}

#[test]
fn a_catch_is_among_the_names_of_a_door_that_was_opened_alone() {
    let bump = |x: f64| (0.5 * (1.0 - x * x)).exp();
    let law = |q: f64, _: f64| 1.4 * ((q + 0.02) / 0.12) * bump((q + 0.02) / 0.12) + 0.2;
    let found = report((0..3).map(|run| pull(run, false, law)).collect()).unwrap();
    let names = found_names(&found);
    let is_catch = |name: &str| name == "detent" || name == "local_friction";
    assert!(names.iter().any(|n| is_catch(n)), "{:?}", found.diagnosis.findings);
    let gap = found.gap.as_ref().unwrap();
    assert!(gap.after < 0.4 * gap.before, "{gap:?}");
}

#[test]
fn efforts_that_the_twin_needs_leave_no_name() {
    let twin = Plant { friction: 0.6, ..door() };
    let logs = (0..3).map(|run| pull(run, true, |_, v| 0.6 * v.signum())).collect();
    let found = imposed_report(&catalogue(0), &twin, "door", &split(logs)).unwrap();
    assert!(found.diagnosis.findings.is_empty(), "{:?}", found.diagnosis.findings);
}

#[test]
fn efforts_that_drive_a_joint_are_not_explained_by_its_motion() {
    let effects = catalogue(0);
    let twin = pendulum(0.4);
    let truth = with(&effects, &twin, &[("coulomb_friction", &[0.05])]);
    let mut rng = stage_rng(3, "driven", 0);
    let logs = (0..3).map(|run| simulated(&effects, &truth, run, &mut rng)).collect();
    assert!(imposed_report(&effects, &twin, "joint", &split(logs)).is_none());
}
