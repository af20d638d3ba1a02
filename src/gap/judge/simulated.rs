//! Runs of a simulated joint, for tests.

use rand_core::Rng;

use super::assess::Runs;
use crate::{
    fit::{
        acting::Row,
        rollout::{Start, roll_starts},
    },
    model::{
        actuator::Actuator,
        joint_model::{Catalogue, JointModel},
        plant::{Load, Plant},
    },
    record::{
        drive::{Drive, Hold},
        log::{JointLog, Span},
    },
};

/// Number of samples of a run.
const SAMPLES: usize = 800;
/// Sample interval, seconds.
const INTERVAL_S: f64 = 0.01;

/// The twin's joint: a pendulum with a load of `load` N m.
pub fn pendulum(load: f64) -> Plant {
    let most_load = load;
    let load = Load { sine: load, ..Load::default() };
    Plant { inertia: 0.05, damping: 0.02, friction: 0.0, load, most_load, actuator: Actuator::default() }
}

/// A pendulum with effects.
pub fn with(effects: &Catalogue, plant: &Plant, truth: &[(&str, &[f64])]) -> JointModel {
    let index = |name: &str| effects.iter().position(|e| e.name() == name).unwrap();
    truth.iter().fold(JointModel::of_plant(plant), |m, (name, p)| m.with_effect(index(name), p))
}

/// Holds out the last run.
pub fn split(mut logs: Vec<JointLog>) -> Runs {
    let held_out = logs.split_off(logs.len() - 1);
    Runs { fitted: logs, held_out, turns: true, hold: Hold::Zero, effects: Vec::new() }
}

/// A simulated run of the model, with white noise on the positions.
pub fn simulated(effects: &Catalogue, truth: &JointModel, run: usize, rng: &mut impl Rng) -> JointLog {
    beside(effects, truth, run, rng, |_| 0.0)
}

/// A run with an additional, unrecorded effort.
pub fn beside(
    effects: &Catalogue,
    truth: &JointModel,
    run: usize,
    rng: &mut impl Rng,
    unrecorded: impl Fn(f64) -> f64,
) -> JointLog {
    let time_s: Vec<f64> = (0..SAMPLES).map(|k| INTERVAL_S * k as f64).collect();
    let phase = 1.3 * run as f64;
    let effort = time_s.iter().map(|t| 0.5 * (3.1 * t + phase).sin() + 0.3 * (7.7 * t).cos()).collect();
    let mut log = JointLog {
        run: format!("run_{run}"),
        position: vec![0.0; SAMPLES],
        effort,
        time_s,
        ..JointLog::default()
    };
    let acting = log.effort.iter().zip(&log.time_s).map(|(u, t)| u + unrecorded(*t)).collect();
    let drive = Drive::with_steps(&JointLog { effort: acting, ..log.clone() }, Hold::Zero, 0.0, 20);
    let whole = Span { log: 0, start: 0, len: SAMPLES };
    let mut position = Vec::new();
    let keep = |q: f64, _: &Row| position.push(q);
    roll_starts(truth, effects, &log, &drive, whole, Start::default(), keep);
    let mut noise = || 1e-4 * (f64::from(rng.next_u32()) / f64::from(u32::MAX) - 0.5);
    log.position = position.iter().map(|q| q + noise()).collect();
    log
}
