//! Verdicts about hand-made evidence.

use nalgebra::DMatrix;
use rand_core::SeedableRng;

use super::*;
use crate::{
    judge::{
        locate::Bin,
        simulated::{pendulum, simulated, with},
    },
    model::{
        actuator::{Actuator, Servo},
        effects::catalogue,
        plant::Plant,
    },
    record::drive::Hold,
};

/// One run of the twin itself.
fn problem<'c>(effects: &'c Catalogue, plant: &Plant) -> Problem<'c> {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
    let log = simulated(effects, &JointModel::of_plant(plant), 0, &mut rng);
    Problem::new(effects, plant, true, vec![log], Hold::Zero)
}

/// A model as if it had been fitted: parameters with deviations of `deviation`, in many windows.
fn fitted(model: JointModel, score: f64, noise: EffortNoise, deviation: f64) -> Candidate {
    let free = model.free_count();
    let fit = Fit {
        model,
        starts: Vec::new(),
        noise,
        log_likelihood: 0.0,
        covariance: DMatrix::from_diagonal_element(free, free, deviation * deviation),
        witnesses: vec![1e6; free],
        costs: Vec::new(),
    };
    Candidate { fit, score }
}

fn spread(model: &JointModel, deviation: f64) -> Spread {
    let covariance =
        DMatrix::from_diagonal_element(model.free_count(), model.free_count(), deviation * deviation);
    Spread { covariance, witnesses: vec![1e6; model.free_count()] }
}

fn finding(effects: &Catalogue, effect: &str, is_sure: bool) -> Finding {
    Finding {
        index: index(effects, effect),
        effect: effect.to_owned(),
        parameters: Vec::new(),
        weight: 0.7,
        alternatives: vec![("delay".to_owned(), 0.3)],
        experiment: String::new(),
        is_sure,
    }
}

fn index(effects: &Catalogue, name: &str) -> usize {
    effects.iter().position(|e| e.name() == name).unwrap()
}

const LASTING: EffortNoise = EffortNoise { white: 0.01, wander: 0.1, memory_s: 0.1, deflection: 0.0 };

#[test]
fn verdicts_have_the_names_of_the_report() {
    let names = [
        (Verdict::None, "none"),
        (Verdict::Named, "named"),
        (Verdict::Ambiguous, "ambiguous"),
        (Verdict::Unknown, "unknown"),
        (Verdict::Insufficient, "insufficient"),
    ];
    let document = include_str!("../../../docs/diagnosis.md");
    for (verdict, name) in names {
        assert_eq!(verdict.name(), name);
        assert!(document.contains(&format!("`{name}`")), "{name}");
    }
}

#[test]
fn names_that_are_taken_back_come_nearest() {
    let effects = catalogue(0);
    let model = with(&effects, &pendulum(0.6), &[("coulomb_friction", &[0.1])]);
    let mut found = Diagnosis::without_findings(Verdict::Named, model.clone());
    found.findings = vec![finding(&effects, "coulomb_friction", true)];
    assert_eq!(found.effects_or_nearest(), &model);
    found.withdraw_names();
    assert_eq!(found.verdict, Verdict::Unknown);
    assert!(found.findings.is_empty() && found.model.terms.is_empty());
    // What comes nearest is what was found; the model is the twin again.
    assert_eq!(found.effects_or_nearest(), &model);
    let nearest = found.nearest.unwrap();
    assert_eq!(nearest.findings, [finding(&effects, "coulomb_friction", true)]);
    assert_eq!(nearest.model, model);
}

#[test]
fn a_name_is_asked_for_where_something_remains_and_there_alone() {
    let effects = catalogue(0);
    let model = with(&effects, &pendulum(0.6), &[("inertia", &[0.02]), ("coulomb_friction", &[0.1])]);
    let asked = |noise: EffortNoise, spread: Option<Spread>| {
        let mut found = Diagnosis::without_findings(Verdict::Named, model.clone());
        found.findings = ["inertia", "coulomb_friction"].map(|e| finding(&effects, e, true)).to_vec();
        (found.noise, found.spread) = (noise, spread);
        found.mark_sure_effects(&effects);
        let of = |f: &Finding| f.effect.clone();
        (
            found.sure_findings().map(of).collect::<Vec<_>>(),
            found.unsure_findings().map(of).collect::<Vec<_>>(),
        )
    };
    // A deviation of 0.02 hides the inertia, and not the friction.
    let both = ["inertia", "coulomb_friction"].map(str::to_owned).to_vec();
    let known = || Some(spread(&model, 0.02));
    assert_eq!(asked(EffortNoise::white_noise(0.1), known()), (both.clone(), Vec::new()));
    assert_eq!(asked(LASTING, None), (both, Vec::new()));
    let [inertia, friction] = ["inertia", "coulomb_friction"].map(|e| vec![e.to_owned()]);
    assert_eq!(asked(LASTING, known()), (friction, inertia));
}

#[test]
fn too_little_motion_is_the_only_insufficient_one() {
    let all = [Verdict::None, Verdict::Named, Verdict::Ambiguous, Verdict::Unknown, Verdict::Insufficient];
    for verdict in all {
        let found = Diagnosis::without_findings(verdict, JointModel::of_plant(&pendulum(0.6)));
        assert_eq!(found.is_sufficient(), verdict != Verdict::Insufficient);
        assert!(found.verdict == verdict && found.findings.is_empty() && found.nearest.is_none());
    }
}

#[test]
fn a_motion_lacks_time_or_range() {
    let of = |durations_s: &[f64], windows: usize, travel: f64, position_noise: f64| {
        let coverage =
            Coverage { durations_s: durations_s.to_vec(), travel, position_noise, ..Coverage::default() };
        missing_motion(&coverage, windows)
    };
    // docs/record_motion.md: 30 times the noise, and 4 s of motion.
    assert!(of(&[2.0, 2.0], 4, 0.5, 0.01).is_empty());
    for short in [of(&[2.0, 1.9], 4, 0.5, 0.01), of(&[4.0], 3, 0.5, 0.01), of(&[], 0, 0.5, 0.01)] {
        assert_eq!(short.len(), 1, "{short:?}");
        assert!(short[0].contains("s of motion are left to fit"), "{short:?}");
    }
    assert!(of(&[2.0, 1.9], 4, 0.5, 0.01)[0].starts_with("3.9 s"));
    // 32 times the noise is enough, 30 times or less is not, nor is what is no number, nor rounding.
    assert!(of(&[4.0], 4, 8.0, 0.25).is_empty());
    assert!(of(&[4.0], 4, 1e-9, 0.0).is_empty());
    let still = [(7.5, 0.25), (0.1, 0.25), (f64::NAN, 0.25), (0.5e-9, 0.0)];
    for (travel, noise) in still {
        let lacks = of(&[4.0], 4, travel, noise);
        assert_eq!(lacks.len(), 1, "{travel}");
        assert!(lacks[0].contains("hardly more than its noise"), "{lacks:?}");
    }
    assert_eq!(of(&[1.0], 1, 0.0, 0.25).len(), 2);
}

#[test]
fn too_little_motion_is_said_before_anything_is_fitted() {
    let effects = catalogue(0);
    let mut short = problem(&effects, &pendulum(0.6));
    short.coverage.travel = 0.0;
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
    let found = diagnose(&short, &[], &[], &mut rng);
    assert_eq!((found.verdict, found.lacks.len()), (Verdict::Insufficient, 1));
    assert_eq!(found.model, JointModel::of_plant(&short.plant));
}

#[test]
fn what_is_to_be_explained_is_what_the_model_gains_over_the_twin() {
    let fit = |costs: &[f64], log_likelihood: f64| {
        let none = fitted(JointModel::of_plant(&pendulum(0.6)), 0.0, LASTING, 0.1).fit;
        Fit { costs: costs.to_vec(), log_likelihood, ..none }
    };
    // Smaller residuals: 30 + 20 of the twin, 4 + 6 of the model.
    assert_eq!(gain_to_explain(&fit(&[30.0, 20.0], 0.0), &fit(&[], 5.0), &fit(&[4.0, 6.0], 7.0)), 40.0);
    // A joint that sticks: the residuals are the same, the noise is another.
    assert_eq!(gain_to_explain(&fit(&[5.0, 5.0], 0.0), &fit(&[], -20.0), &fit(&[4.0, 5.0], 7.0)), 54.0);
    assert_eq!(share_left(10.0, 40.0), 0.25);
    assert_eq!(share_left(50.0, 40.0), 1.0);
    assert_eq!(share_left(0.0, -3.0), 0.0);
    assert_eq!(share_left(1e-12, 0.0), 1e-3);
}

#[test]
fn a_table_stands_by_its_price_and_by_its_share_of_false_alarms() {
    let table = |gain: f64, count: usize, q: f64| Dependence {
        variable: Variable::Position,
        bins: vec![Bin { edges: (0.0, 1.0), effort: 0.0, sigmas: 0.0 }; count],
        gain,
        p: q,
        q,
        region: (0.0, 1.0),
    };
    // Each bin costs the logarithm of the independent samples, here 1; the least must be left.
    let [independent, least] = [std::f64::consts::E, least_gain(Variable::ALL.len())];
    let unexplained = |tables: &[Dependence]| unexplained_gain(tables, independent);
    assert_eq!(unexplained(&[]), 0.0);
    assert_eq!(unexplained(&[table(least + 3.9, 4, 0.0)]), 0.0);
    assert!((unexplained(&[table(least + 4.1, 4, 0.0)]) - (least + 0.1)).abs() < 1e-9);
    assert!((unexplained(&[table(50.0, 4, LEVEL)]) - 46.0).abs() < 1e-9);
    assert_eq!(unexplained(&[table(50.0, 4, 1.01 * LEVEL)]), 0.0);
    // The largest, after its price.
    let several = [table(50.0, 4, 0.0), table(60.0, 20, 0.0), table(90.0, 4, 0.5)];
    assert!((unexplained(&several) - 46.0).abs() < 1e-9);
}

#[test]
fn effects_that_leave_too_much_have_no_name() {
    let effects = catalogue(0);
    let mut problem = problem(&effects, &pendulum(0.6));
    problem.coverage.effort_rms = 1.0;
    let of_noise = |terms: &[(&str, &[f64])], size: f64| {
        fitted(with(&effects, &pendulum(0.6), terms), 0.0, EffortNoise::white_noise(size), 0.1)
    };
    let base = of_noise(&[], 0.1);
    let mut diagnosis = Diagnosis::without_findings(Verdict::Named, base.fit.model.clone());
    diagnosis.findings = vec![finding(&effects, "coulomb_friction", true)];
    let friction: &[(&str, &[f64])] = &[("coulomb_friction", &[0.1])];
    let shapes: &[(&str, &[f64])] = &[("spring_return", &[0.1, 0.0]), ("cogging", &[0.1, 0.0, 4.0])];
    let little = |diagnosis: &Diagnosis, terms: &[(&str, &[f64])], noise: f64| {
        explains_too_little(&problem, diagnosis, &base, &of_noise(terms, noise))
    };
    assert!(!little(&diagnosis, friction, 0.01));
    // Much noise is left: a friction has no shape over the position that mends the rest, two shapes have.
    assert!(!little(&diagnosis, friction, 0.09));
    assert!(little(&diagnosis, shapes, 0.09) && !little(&diagnosis, shapes, 0.01));
    // Nothing is sure; a share is left; an effect is of the size of the discretization.
    let with_share = |left: f64| Diagnosis { left, ..diagnosis.clone() };
    assert!(little(&with_share(1.01 * MAX_LEFT), friction, 0.01));
    assert!(!little(&with_share(MAX_LEFT), friction, 0.01));
    let unsure =
        Diagnosis { findings: vec![finding(&effects, "coulomb_friction", false)], ..diagnosis.clone() };
    assert!(little(&unsure, friction, 0.01));
    assert!(little(&diagnosis, &[("coulomb_friction", &[0.1]), ("torque_gain", &[1.001])], 0.01));
}

#[test]
fn an_actuator_is_reported_with_its_units_and_intervals() {
    let servo = Some(Servo { stiffness: 5.0, limit: f64::INFINITY });
    let of = |actuator: Actuator, turns: bool| {
        let mut model = with(&catalogue(0), &pendulum(0.6), &[("coulomb_friction", &[0.1])]);
        model.plant.actuator = actuator;
        model.lag_s = 0.001;
        actuator_estimates(&model, &spread(&model, 0.01), turns)
    };
    let half = |e: &ParameterEstimate| (e.value - e.interval.0, e.interval.1 - e.value);
    let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
    let found = Actuator { gain: 1.2, damping: 0.3, is_found: [true; 2], ..Actuator::default() };
    // A servo's stiffness is its gain times the nominal one, and so is its deviation.
    let late = Actuator { servo, delay_s: 0.02, is_late: true, ..found };
    let [stiffness, damping, delay] = &of(late, true)[..] else { panic!("three are found") };
    assert_eq!([&stiffness.name, &damping.name, &delay.name], ["stiffness", "damping", "delay"]);
    assert_eq!([&stiffness.unit, &damping.unit, &delay.unit], ["N m/rad", "N m s/rad", "s"]);
    assert!(near(stiffness.value, 6.0) && near(damping.value, 0.3) && near(delay.value, 0.021));
    for (estimate, deviation) in [(stiffness, 0.05), (damping, 0.01), (delay, 0.01)] {
        let (below, above) = half(estimate);
        assert!(
            near(below, above) && (below / (HALF_WIDTH_95 * deviation) - 1.0).abs() < 1e-3,
            "{estimate:?}"
        );
    }
    assert_eq!(of(late, false)[0].unit, "N/m");
    // An effort of no known unit.
    let effort = Actuator { unit: 0.5, is_found: [true, false], ..found };
    let [gain] = &of(effort, true)[..] else { panic!("one is found") };
    assert!(gain.name == "gain" && gain.unit == "N m per unit" && near(gain.value, 0.6), "{gain:?}");
    assert!((half(gain).0 / (HALF_WIDTH_95 * 0.005) - 1.0).abs() < 1e-3, "{gain:?}");
    assert_eq!(of(effort, false)[0].unit, "N per unit");
    assert!(of(Actuator { is_found: [false; 2], ..found }, true).is_empty());
}

#[test]
fn what_effects_leave_is_noise_by_its_share_of_the_twins() {
    let effects = catalogue(0);
    let mut problem = problem(&effects, &pendulum(0.6));
    problem.coverage.effort_rms = 1.0;
    let of = |left: f64, before: f64| {
        let [base, chosen] = [before, left].map(|size| {
            fitted(JointModel::of_plant(&pendulum(0.6)), 0.0, EffortNoise::white_noise(size), 0.1)
        });
        is_noisy(&problem, &base, &chosen)
    };
    // Of its variance 12 %: of its size the root of that, 0.346.
    assert!(of(0.036, 0.1) && !of(0.034, 0.1));
    // Of what is above 12 % of the effort, 12 % of its size.
    assert!(of(0.13, 1.0) && !of(0.11, 1.0) && !of(0.13, 1.1) && of(0.2, 1.0));
}

#[test]
fn shapes_that_mend_what_remains_are_no_names() {
    let effects = catalogue(0);
    let problem = problem(&effects, &pendulum(0.6));
    let (low, high) = problem.coverage.position;
    let middle = 0.5 * (low + high);
    let of = |terms: &[(&str, &[f64])], deviation: f64| {
        let model = with(&effects, &pendulum(0.6), terms);
        is_shaped(&problem, &fitted(model, 0.0, LASTING, deviation))
    };
    let bound = |k: usize| effects[index(&effects, "detent")].parameter_bounds(k, &problem.coverage);
    let (narrow, wide) = bound(2);
    let width = 0.5 * (narrow + wide);
    let deviation = 0.01 * (wide - narrow);
    let detent = [0.1, middle, width];
    assert!(of(&[("coulomb_friction", &[0.1]), ("detent", &detent)], deviation));
    // Several shapes over the position, or a push in one run.
    assert!(!of(&[("spring_return", &[0.1, 0.0]), ("detent", &detent)], deviation));
    assert!(!of(&[("coulomb_friction", &[0.1]), ("disturbance", &[0.1, 2.0, 0.1])], deviation));
    // A width whose interval holds an end of its range; a strength may lie where it will.
    let near = |at: f64| of(&[("coulomb_friction", &[0.1]), ("detent", &[0.1, middle, at])], deviation);
    assert!(!near(narrow + 1.9 * deviation) && near(narrow + 2.1 * deviation));
    assert!(!near(wide - 1.9 * deviation) && near(wide - 2.1 * deviation));
    assert!(of(&[("detent", &[-1e9, middle, width])], deviation));
    // The columns are those of the term: the deviation of another parameter does not matter.
    let model = with(&effects, &pendulum(0.6), &[("coulomb_friction", &[0.1]), ("detent", &detent)]);
    let mut unsure = fitted(model, 0.0, LASTING, deviation);
    unsure.fit.covariance[(1, 1)] = 1e6;
    assert!(is_shaped(&problem, &unsure));
    unsure.fit.covariance[(4, 4)] = 1e6;
    assert!(!is_shaped(&problem, &unsure));
}

#[test]
fn effects_of_the_size_of_the_discretization_are_not_credible() {
    let effects = catalogue(0);
    let mut problem = problem(&effects, &pendulum(0.6));
    (problem.coverage.interval_s, problem.plant.inertia) = (0.01, 0.05);
    let of =
        |effect: &str, p: f64| is_credible(&problem, &Term { effect: index(&effects, effect), p: vec![p] });
    // A quarter of an interval; 0.4 % of a factor and of the inertia.
    for sign in [1.0, -1.0] {
        assert!(of("delay", 0.0026 * sign) && !of("delay", 0.0024 * sign));
        assert!(of("torque_gain", 1.0 + 0.0041 * sign) && !of("torque_gain", 1.0 + 0.0039 * sign));
        assert!(of("encoder_scale", 1.0 + 0.0041 * sign) && !of("encoder_scale", 1.0 + 0.0039 * sign));
        assert!(of("inertia", 2.1e-4 * sign) && !of("inertia", 1.9e-4 * sign));
    }
    assert!(of("coulomb_friction", 1e-9));
    // A set loses what is not credible, unless nothing else is in it.
    let left = |terms: &[(&str, &[f64])]| {
        let mut candidate = fitted(with(&effects, &problem.plant, terms), 1.0, LASTING, 0.1);
        candidate.fit.starts = problem.smoothed_starts(&candidate.fit.model);
        credible(&problem, candidate)
    };
    let kept = left(&[("torque_gain", &[1.001])]);
    assert!(kept.effects() == [index(&effects, "torque_gain")] && kept.score == 1.0);
    let whole = left(&[("coulomb_friction", &[0.1]), ("torque_gain", &[1.1])]);
    assert!(whole.fit.model.terms.len() == 2 && whole.score == 1.0);
    let mended = left(&[("coulomb_friction", &[0.1]), ("torque_gain", &[1.001])]);
    assert_eq!(mended.effects(), [index(&effects, "coulomb_friction")]);
    assert!(mended.score != 1.0, "fitted again");
}

/// Rivals of the first of some sets of effects, by name.
fn rivals_of(problem: &Problem, sets: &[(&[(&str, &[f64])], f64)]) -> Vec<(Vec<String>, f64)> {
    let effects = problem.catalogue;
    let all: Vec<Candidate> = sets
        .iter()
        .map(|(terms, score)| fitted(with(effects, &problem.plant, terms), *score, LASTING, 0.1))
        .collect();
    let mut by_size =
        vec![vec![fitted(JointModel::of_plant(&problem.plant), 0.0, LASTING, 0.1)], Vec::new(), Vec::new()];
    for candidate in &all {
        by_size[candidate.fit.model.terms.len()].push(candidate.clone());
    }
    let found = Search { by_size, disturbance: None, least_gain: 10.0 };
    let named = |(set, weight): (Vec<usize>, f64)| {
        (set.iter().map(|e| effects[*e].name().to_owned()).collect::<Vec<_>>(), weight)
    };
    rivals(problem, &found, &all[0]).into_iter().map(named).collect()
}

#[test]
fn sets_of_as_many_effects_are_rivals_by_their_scores() {
    let effects = catalogue(0);
    let problem = problem(&effects, &pendulum(0.6));
    let found = rivals_of(
        &problem,
        &[
            (&[("coulomb_friction", &[0.1])], 100.0),
            (&[("viscous_friction", &[0.1])], 98.0),
            // Contains it; the same effect from another start; another size.
            (&[("asymmetric_friction", &[0.1, 0.1])], 99.0),
            (&[("coulomb_friction", &[0.2])], 99.0),
            (&[("viscous_friction", &[0.1]), ("inertia", &[0.1])], 99.0),
        ],
    );
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(found[0].0, ["viscous_friction"]);
    // Scores are twice a log likelihood.
    assert!((found[0].1 - (-1.0f64).exp()).abs() < 1e-12, "{found:?}");
}

#[test]
fn a_partner_that_no_recording_separates_is_a_rival_of_the_same_weight() {
    let effects = catalogue(0);
    let flat = problem(&effects, &pendulum(0.0));
    let gained: &[(&str, &[f64])] = &[("torque_gain", &[1.2]), ("coulomb_friction", &[0.1])];
    let scaled: &[(&str, &[f64])] = &[("encoder_scale", &[0.8]), ("coulomb_friction", &[0.1])];
    let other: &[(&str, &[f64])] = &[("viscous_friction", &[0.1]), ("coulomb_friction", &[0.1])];
    let found = rivals_of(&flat, &[(gained, 100.0), (scaled, 96.0), (other, 98.0)]);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found[0].0.contains(&"viscous_friction".to_owned()), "{found:?}");
    // The fit of the partner is not asked: it is the same.
    let mut twin = found[1].0.clone();
    twin.sort();
    assert_eq!((twin, found[1].1), (vec!["coulomb_friction".to_owned(), "encoder_scale".to_owned()], 1.0));
    // Under a load that depends on the position they differ.
    let loaded = problem(&effects, &pendulum(0.6));
    let found = rivals_of(&loaded, &[(gained, 100.0), (scaled, 96.0), (other, 98.0)]);
    assert!(found.iter().all(|(_, weight)| *weight < 0.99) && found.len() == 2, "{found:?}");
}

#[test]
fn what_assumes_more_is_no_rival_by_its_predictions() {
    let effects = catalogue(0);
    let mut predicted = problem(&effects, &pendulum(0.6));
    predicted.weighing = Weighing::Predictions { independent: 0.1 };
    let own: &[(&str, &[f64])] = &[("coulomb_friction", &[0.05])];
    let more: &[(&str, &[f64])] = &[("hardening_spring", &[0.1, 0.1, 0.0])];
    assert_eq!(rivals_of(&predicted, &[(own, 100.0), (more, 100.0)]), []);
    predicted.weighing = Weighing::Innovations;
    assert_eq!(rivals_of(&predicted, &[(own, 100.0), (more, 100.0)]).len(), 1);
}

/// A diagnosis that named effects, after they were fitted again to a model.
fn again(mut before: Diagnosis, model: JointModel, deviation: f64, is_given: bool) -> Diagnosis {
    let effects = catalogue(0);
    let problem = problem(&effects, &pendulum(0.6));
    let spread = spread(&model, deviation);
    before.fit_again(&problem, model, spread, is_given);
    before
}

#[test]
fn effects_that_are_fitted_again_keep_their_weights() {
    let effects = catalogue(0);
    let plant = pendulum(0.6);
    let own = with(&effects, &plant, &[("coulomb_friction", &[0.1]), ("inertia", &[0.01])]);
    let named = |noise: EffortNoise| {
        let mut found = Diagnosis::without_findings(Verdict::Named, own.clone());
        found.findings = ["coulomb_friction", "inertia"].map(|e| finding(&effects, e, true)).to_vec();
        found.noise = noise;
        found
    };
    let other = with(&effects, &plant, &[("coulomb_friction", &[0.2])]);
    let found = again(named(EffortNoise::white_noise(0.1)), other.clone(), 0.01, false);
    assert!(found.verdict == Verdict::Named && found.model == other && found.nearest.is_none());
    let [friction] = &found.findings[..] else { panic!("{:?}", found.findings) };
    assert_eq!((friction.weight, &friction.alternatives), (0.7, &vec![("delay".to_owned(), 0.3)]));
    assert_eq!(friction.parameters[0].value, 0.2);
    assert!(found.spread.is_some_and(|s| (s.covariance[(1, 1)] - 1e-4).abs() < 1e-12));
    // What was not known before has the weight of all.
    let new = with(&effects, &plant, &[("viscous_friction", &[0.2])]);
    assert_eq!(again(named(EffortNoise::white_noise(0.1)), new, 0.01, false).findings[0].weight, 1.0);
    // Nothing is left: nothing is wrong, or nothing that has a name.
    let nothing = JointModel::of_plant(&plant);
    for (noise, verdict) in [(EffortNoise::white_noise(0.1), Verdict::None), (LASTING, Verdict::Unknown)] {
        let found = again(named(noise), nothing.clone(), 0.01, false);
        assert!(found.verdict == verdict && found.findings.is_empty() && found.nearest.is_none());
        assert_eq!(found.model, nothing);
    }
    // None is sure beside what remains, so that all are taken back; but for what was given, as long as the
    // runs determine it.
    let found = again(named(LASTING), other.clone(), 1.0, false);
    assert_eq!((found.verdict, found.findings.len()), (Verdict::Unknown, 0));
    assert_eq!(found.nearest.unwrap().model, other);
    let given = again(named(LASTING), other.clone(), 0.5, true);
    assert!(given.verdict == Verdict::Named && given.findings.len() == 1 && given.findings[0].is_sure);
    let open = again(named(LASTING), other.clone(), 5.0, true);
    assert_eq!(open.verdict, Verdict::Unknown);
    assert_eq!(open.nearest.unwrap().findings[0].parameters[0].open, Some(crate::judge::finding::Open::Wide));
}

#[test]
fn what_comes_nearest_is_fitted_again_in_its_place() {
    let effects = catalogue(0);
    let plant = pendulum(0.6);
    let own = with(&effects, &plant, &[("coulomb_friction", &[0.1])]);
    let unknown = || {
        let mut found = Diagnosis::without_findings(Verdict::Named, own.clone());
        found.findings = vec![finding(&effects, "coulomb_friction", true)];
        found.noise = LASTING;
        found.withdraw_names();
        found
    };
    let other = with(&effects, &plant, &[("coulomb_friction", &[0.2])]);
    let found = again(unknown(), other.clone(), 0.01, false);
    let nearest = found.nearest.as_ref().unwrap();
    assert_eq!((found.verdict, &nearest.model), (Verdict::Unknown, &other));
    assert!(nearest.findings[0].weight == 0.7 && nearest.findings[0].parameters[0].value == 0.2);
    assert!(found.findings.is_empty() && found.model.terms.is_empty());
    let gone = again(unknown(), JointModel::of_plant(&plant), 0.01, false);
    assert!(gone.nearest.is_none() && gone.verdict == Verdict::Unknown && gone.findings.is_empty());
    assert_eq!(gone.model, JointModel::of_plant(&plant));
}
