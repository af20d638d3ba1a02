//! The worked example of `docs/add_an_effect.md`: an effect that the catalogue does not have, found and named
//! on a simulated log.

use rand_core::SeedableRng;

use super::{
    assess::assess,
    one_way_damping::OneWayDamping,
    report::JointReport,
    simulated::{pendulum, simulated, split, with},
    verdict::Verdict,
};
use crate::model::effects::catalogue;

/// Diagnoses three simulated runs, of which the last is held out.
fn diagnosed(truth: &[(&str, &[f64])]) -> JointReport {
    let mut effects = catalogue(0);
    effects.push(Box::new(OneWayDamping));
    let plant = pendulum(0.6);
    let model = with(&effects, &plant, truth);
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
    let runs = split((0..3).map(|run| simulated(&effects, &model, run, &mut rng)).collect());
    assess(&effects, &plant, "door", runs, &mut rng)
}

#[test]
fn a_new_effect_is_found_and_named() {
    let report = diagnosed(&[("one_way_damping", &[0.06])]);
    let found = &report.diagnosis;
    assert_eq!(found.verdict, Verdict::Named, "{found:?}");
    assert_eq!(found.findings.len(), 1, "{found:?}");
    assert_eq!(found.findings[0].effect, "one_way_damping");
    let damping = &found.findings[0].parameters[0];
    assert!((damping.value - 0.06).abs() < 0.003, "{damping:?}");
    let gap = report.gap.unwrap();
    assert!(gap.after < 0.05 * gap.before, "{gap:?}");
}

#[test]
fn it_is_not_seen_where_it_is_not() {
    assert_eq!(diagnosed(&[]).diagnosis.verdict, Verdict::None);
    let report = diagnosed(&[("viscous_friction", &[0.03])]);
    assert_eq!(report.diagnosis.findings[0].effect, "viscous_friction");
}

#[test]
fn the_document_shows_this_code() {
    let document = include_str!("../../../docs/add_an_effect.md");
    assert!(document.contains(include_str!("one_way_damping.rs")), "docs/add_an_effect.md differs");
}
