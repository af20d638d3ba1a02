//! Names beside something that no catalogue holds.

use rand_core::SeedableRng;

use super::{
    assess::{Runs, assess},
    report::JointReport,
    simulated::beside,
    verdict::Verdict,
};
use crate::gap::{
    model::{
        effects::catalogue,
        joint_model::JointModel,
        plant::{Load, Plant},
    },
    record::{drive::Hold, log::JointLog},
};

/// Diagnoses three runs of a joint with a friction, beside an effort of four sines that is not recorded, of
/// about `size` N m; the last run is held out.
fn diagnosed(friction: f64, size: f64) -> JointReport {
    let effects = catalogue(0);
    let load = Load { sine: 0.6, ..Load::default() };
    let plant = Plant { inertia: 0.05, damping: 0.02, friction: 0.0, load, most_load: 0.6 };
    let of = effects.iter().position(|e| e.name() == "coulomb_friction").unwrap();
    let mut truth = JointModel::of(&plant);
    if friction > 0.0 {
        truth = truth.with(of, &[friction]);
    }
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(3);
    let unrecorded = |run: usize| {
        move |t: f64| {
            let waves = [(2.3, 0.4), (5.9, 1.7), (11.0, 2.9), (17.0, 0.9)];
            waves.iter().map(|(w, p)| 0.7 * size * (w * t + p + 2.1 * run as f64).sin()).sum::<f64>()
        }
    };
    let run = |run: usize| beside(&effects, &truth, run, &mut rng, unrecorded(run));
    let mut logs: Vec<JointLog> = (0..3).map(run).collect();
    let held_out = logs.split_off(2);
    let runs = Runs { fitted: logs, held_out, turns: true, hold: Hold::Zero, effects: Vec::new() };
    assess(&effects, &plant, "joint", runs, &mut rng)
}

#[test]
fn a_friction_is_named_beside_efforts_that_no_catalogue_holds() {
    let report = diagnosed(0.1, 0.02);
    let found = &report.diagnosis;
    assert_eq!(found.verdict, Verdict::Named, "{found:?}");
    assert_eq!(found.findings[0].effect, "coulomb_friction");
    let friction = &found.findings[0].parameters[0];
    assert!(friction.interval.0 < 0.1 && friction.interval.1 > 0.1, "{friction:?}");
    assert!(found.noise.wander > 0.005, "{:?}", found.noise);
}

#[test]
fn efforts_that_no_catalogue_holds_have_no_name() {
    let report = diagnosed(0.0, 0.02);
    assert_eq!(report.diagnosis.verdict, Verdict::Unknown, "{:?}", report.diagnosis);
    assert!(report.diagnosis.findings.is_empty());
}
