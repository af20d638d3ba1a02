//! Names beside something that no catalogue holds.

use rand_core::SeedableRng;

use super::{
    assess::assess,
    finding::Finding,
    report::JointReport,
    simulated::{beside, pendulum, split, with},
    verdict::{Diagnosis, Verdict},
};
use crate::model::{effects::catalogue, joint_model::JointModel};

/// Diagnoses three runs of a joint with a friction, beside an effort of four sines that is not recorded, of
/// about `size` N m; the last run is held out.
fn diagnosed(friction: f64, size: f64) -> JointReport {
    let effects = catalogue(0);
    let plant = pendulum(0.6);
    let truth = with(&effects, &plant, &[("coulomb_friction", &[friction])]);
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(3);
    let unrecorded = |run: usize| {
        move |t: f64| {
            let waves = [(2.3, 0.4), (5.9, 1.7), (11.0, 2.9), (17.0, 0.9)];
            waves.iter().map(|(w, p)| 0.7 * size * (w * t + p + 2.1 * run as f64).sin()).sum::<f64>()
        }
    };
    let runs = split((0..3).map(|run| beside(&effects, &truth, run, &mut rng, unrecorded(run))).collect());
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
    // Some hundred times the noise of the readings.
    assert!(found.noise.deflection > 0.01, "{:?}", found.noise);
}

#[test]
fn efforts_that_no_catalogue_holds_have_no_name() {
    let report = diagnosed(0.0, 0.02);
    assert_eq!(report.diagnosis.verdict, Verdict::Unknown, "{:?}", report.diagnosis);
    assert!(report.diagnosis.findings.is_empty());
}

#[test]
fn a_name_that_stays_is_as_sure_as_another_search_says() {
    let effects = catalogue(0);
    let of = |name: &str| effects.iter().position(|e| e.name() == name).unwrap();
    let inertia = of("inertia");
    let gain = of("torque_gain");
    let delay = of("delay");
    let mut found = Diagnosis::without_findings(Verdict::Named, JointModel::of_plant(&pendulum(0.6)));
    let name = |index: usize| Finding {
        index,
        effect: effects[index].name().to_owned(),
        parameters: Vec::new(),
        weight: 1.0,
        alternatives: Vec::new(),
        experiment: String::new(),
        is_sure: true,
    };
    found.findings = vec![name(inertia)];
    // A search that did not try the set, or whose other sets weigh little, says nothing against it.
    found.weigh_as(&effects, &[(vec![gain], 1.0)]);
    found.weigh_as(&effects, &[(vec![gain], 0.01), (vec![inertia], 1.0)]);
    assert!(found.verdict == Verdict::Named && found.findings[0].weight > 0.98);
    found.weigh_as(&effects, &[(vec![gain], 1.0), (vec![inertia], 4.0), (vec![delay, gain], 1.0)]);
    let first = &found.findings[0];
    assert!(found.verdict == Verdict::Ambiguous && (first.weight - 0.8).abs() < 1e-12, "{first:?}");
    assert_eq!(first.alternatives, [("torque_gain".to_owned(), 0.2)]);
    // It stays the first, whatever the other search prefers.
    found.weigh_as(&effects, &[(vec![gain], 1.0), (vec![inertia], 0.1)]);
    assert!((found.findings[0].weight - 0.5).abs() < 1e-12);
}
