//! Files of simulated joints: never worse than the twin, and of a class the member that a format holds.

use rand_core::SeedableRng;

use super::{
    assess::{Runs, assess},
    format_model::{Fate, FormatModel, format_models},
    format_note::format_note,
    proof::{Gap, windowed_rmse},
    report::JointReport,
    simulated::{pendulum, simulated, split, with},
    verdict::Verdict,
};
use crate::{
    fit::problem::Problem,
    model::{
        effects::catalogue,
        expressed::expressed_model,
        format::Format,
        joint_model::{Catalogue, Term},
        plant::Plant,
    },
    record::drive::Hold,
};

struct Case {
    effects: Box<Catalogue>,
    plant: Plant,
    runs: Runs,
}

impl Case {
    /// Three runs of a pendulum, of which the last is held out; `given` are the effects that are fitted.
    fn new(load: f64, truth: &[(&str, &[f64])], given: &[&str]) -> Self {
        let effects = catalogue(0).into_boxed_slice();
        let plant = pendulum(load);
        let model = with(&effects, &plant, truth);
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
        let mut runs = split((0..3).map(|run| simulated(&effects, &model, run, &mut rng)).collect());
        let index = |name: &&str| effects.iter().position(|e| e.name() == *name).unwrap();
        runs.effects = given.iter().map(index).collect();
        Self { effects, plant, runs }
    }

    fn diagnosed(&self) -> JointReport {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(2);
        assess(&self.effects, &self.plant, "door", self.runs.clone(), &mut rng)
    }

    /// The fitted runs and the held-out ones.
    fn problems(&self) -> [Problem<'_>; 2] {
        let fitted = Problem::new(&self.effects, &self.plant, true, self.runs.fitted.clone(), Hold::Zero);
        let held_out = Problem::held_out(&fitted, self.runs.held_out.clone());
        [fitted, held_out]
    }

    fn names(&self, terms: &[Term]) -> Vec<&str> {
        terms.iter().map(|t| self.effects[t.effect].name()).collect()
    }

    fn fate(&self, held: &FormatModel, name: &str) -> Fate {
        held.effects.iter().find(|e| self.effects[e.effect.unwrap()].name() == name).unwrap().fate
    }
}

fn of(report: &JointReport, format: Format) -> &FormatModel {
    report.in_format.iter().find(|m| m.format == format).unwrap()
}

/// A pendulum with more load than its twin knows of, and a friction that grows with the load.
fn loaded() -> Case {
    let truth: [(&str, &[f64]); 2] = [("load_dependent_friction", &[0.3]), ("axis_tilt", &[0.2, 0.05])];
    Case::new(0.6, &truth, &["load_dependent_friction", "axis_tilt"])
}

#[test]
fn a_friction_that_a_format_lacks_is_replaced_by_what_predicts_better_than_the_twin() {
    let case = loaded();
    let report = case.diagnosed();
    assert_eq!(report.diagnosis.verdict, Verdict::Named, "{report:?}");
    let gap = report.gap.as_ref().unwrap();
    let [_, held_out] = case.problems();
    for format in Format::ALL {
        let held = of(&report, format);
        assert_eq!(case.fate(held, "load_dependent_friction"), Fate::Replaced, "{held:?}");
        assert!(held.rmse < 0.9 * gap.before && held.rmse > gap.after, "{held:?} {gap:?}");
        assert_eq!(held.twin_rmse, gap.before);
        // What is written is what was proven, and the format holds it.
        assert_eq!(expressed_model(format, &held.model, &case.effects).terms, held.model.terms);
        assert!((windowed_rmse(&held_out, &held.model) - held.rmse).abs() < 1e-12);
        let translated = expressed_model(format, &report.diagnosis.model, &case.effects);
        assert!(held.rmse < windowed_rmse(&held_out, &translated), "{held:?}");
    }
    // URDF has no tilt, and no gain of the effort; MJCF has both.
    assert_eq!(case.fate(of(&report, Format::Urdf), "axis_tilt"), Fate::NotExpressible);
    assert!(of(&report, Format::Mjcf).rmse < 0.7 * of(&report, Format::Urdf).rmse, "{report:?}");
    assert!(!of(&report, Format::Mjcf).is_whole());
}

#[test]
fn a_format_in_which_nothing_helps_keeps_the_twin() {
    let case = loaded();
    let report = case.diagnosed();
    let [fitted, held_out] = case.problems();
    // As if the twin left next to nothing.
    let gap = Gap { before: 1e-9, ..report.gap.clone().unwrap() };
    let model = &report.diagnosis.model;
    for held in format_models(&fitted, &held_out, &report.diagnosis, model, &gap) {
        assert!(held.keeps_twin() && held.rmse == gap.before, "{held:?}");
        assert!(held.effects.iter().all(|e| e.fate == Fate::Kept && e.by.is_empty()), "{held:?}");
        let note = format_note(&held, "twin.xml", &report, false).unwrap();
        assert_eq!(note.code.word(), "format_keeps_twin");
    }
}

#[test]
fn of_a_class_the_member_that_a_format_holds_is_written() {
    let case = Case::new(0.0, &[("encoder_scale", &[1.2])], &["encoder_scale"]);
    let report = case.diagnosed();
    assert_eq!(report.diagnosis.verdict, Verdict::Ambiguous, "{report:?}");
    let mjcf = of(&report, Format::Mjcf);
    assert_eq!(case.fate(mjcf, "encoder_scale"), Fate::Replaced, "{mjcf:?}");
    assert_eq!(case.names(&mjcf.model.terms), ["torque_gain"]);
    assert!((mjcf.model.terms[0].p[0] - 1.2).abs() < 0.01, "{mjcf:?}");
    let gap = report.gap.as_ref().unwrap();
    assert!(mjcf.rmse < 1.1 * gap.after, "{mjcf:?} {gap:?}");
    let urdf = of(&report, Format::Urdf);
    assert_eq!(case.fate(urdf, "encoder_scale"), Fate::NotExpressible, "{urdf:?}");
    assert!(urdf.keeps_twin() && urdf.rmse == gap.before, "{urdf:?}");
    // Another file holds it, or none does.
    let codes =
        [false, true].map(|is_sole| format_note(urdf, "twin.urdf", &report, is_sole).unwrap().code.word());
    assert_eq!(codes, ["format_holds_less", "format_keeps_twin"]);
}

#[test]
fn a_format_that_holds_all_gets_what_was_found() {
    let case = Case::new(0.6, &[("viscous_friction", &[0.03])], &["viscous_friction"]);
    let report = case.diagnosed();
    for held in &report.in_format {
        assert!(held.is_whole() && format_note(held, "twin.urdf", &report, false).is_none(), "{held:?}");
        assert_eq!(held.model.terms, report.diagnosis.model.terms);
        assert_eq!(Some(held.rmse), report.gap.as_ref().map(|g| g.after));
    }
}
