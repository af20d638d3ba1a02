//! One joint from its logs to its report: diagnosis on the fitted runs, proof on the held-out ones.

use rand_core::Rng;

use crate::{
    fit::{
        noise::EffortNoise,
        problem::Problem,
        rollout::Start,
        shooting::{Free, Pace, shooting_fit},
    },
    judge::{
        cross_validation::{Unseen, is_surely_worse, predicts_better},
        format_model::{format_models, stand_ins},
        law::laws_of_diagnosis,
        proof::{Gap, WindowGap, left_of, proven_gap, windowed_rmse},
        report::{JointReport, REPORTED_NOISES, ReplayWindow, Track},
        verdict::{Diagnosis, Verdict, diagnose},
    },
    model::{
        effect::Coverage,
        joint_model::{Catalogue, JointModel},
        plant::Plant,
    },
    record::{
        drive::Hold,
        log::{JointLog, rms},
        off_axis::MAX_LEFT,
    },
};

/// Logs of one joint, split.
#[derive(Clone, Debug)]
pub struct Runs {
    /// Fitted logs.
    pub fitted: Vec<JointLog>,
    /// Logs for the proof alone.
    pub held_out: Vec<JointLog>,
    /// The joint turns.
    pub turns: bool,
    /// How the effort runs between samples.
    pub hold: Hold,
    /// Effects to fit instead of searching, indices in the catalogue.
    pub effects: Vec<usize>,
}

/// A joint's runs with the findings of the fitted ones.
pub struct Examined<'c> {
    name: String,
    /// Fitted runs.
    pub problem: Problem<'c>,
    /// Held-out runs.
    pub held_out: Problem<'c>,
    /// The diagnosis.
    pub diagnosis: Diagnosis,
    /// Given effects.
    given: Vec<usize>,
    tracks: Vec<Track>,
}

impl Examined<'_> {
    /// Whether its effects were given.
    #[must_use]
    pub fn is_given(&self) -> bool {
        !self.given.is_empty()
    }
}

/// Diagnoses a joint and proves the result.
#[cfg(test)]
pub fn assess(effects: &Catalogue, plant: &Plant, name: &str, runs: Runs, rng: &mut impl Rng) -> JointReport {
    proven_report(examined_joint(effects, plant, name, runs, rng), rng)
}

/// Diagnoses a joint by its fitted runs.
#[must_use]
pub fn examined_joint<'c>(
    effects: &'c Catalogue,
    plant: &Plant,
    name: &str,
    runs: Runs,
    rng: &mut impl Rng,
) -> Examined<'c> {
    let tracks = all_tracks(&runs);
    let recorded = Problem::new(effects, plant, runs.turns, runs.fitted, runs.hold);
    let held_out = Problem::held_out(&recorded, runs.held_out);
    let problem = recorded.at_steps();
    let diagnosis = diagnose(&problem, &runs.effects, &[], rng);
    let diagnosis = by_prediction(&problem, diagnosis, &runs.effects, rng);
    Examined { name: name.to_owned(), problem, held_out, diagnosis, given: runs.effects, tracks }
}

/// Proves the findings at a joint on held-out runs.
#[must_use]
pub fn proven_report(examined: Examined, rng: &mut impl Rng) -> JointReport {
    let Examined { name, problem, held_out, mut diagnosis, given, tracks } = examined;
    let effects = problem.catalogue;
    let mut report =
        unproven_report(name.clone(), problem.turns, diagnosis.clone(), tracks, problem.coverage.clone());
    if diagnosis.verdict == Verdict::Insufficient || held_out.logs.is_empty() {
        return report;
    }
    // With the actuator as it was found.
    let twin = diagnosis.model.without_effects();
    // A push belongs to its own run.
    let mut updated = diagnosis.model.clone();
    updated.terms.retain(|t| !effects[t.effect].is_of_one_run());
    let mut proof = proven_gap(&held_out, &twin, &updated);
    // A lasting effort with a motion above the noise is something, without an effect to name it.
    if diagnosis.verdict == Verdict::None
        && diagnosis.noise.has_remainder()
        && proof.0.before > REPORTED_NOISES * proof.0.noise_floor
    {
        diagnosis.verdict = Verdict::Unknown;
    }
    // Names without confirmation by held-out runs are taken back; the proof is then the twin's.
    if !updated.terms.is_empty()
        && !is_borne_out(&problem, &held_out, [&updated, &twin], &proof.0, diagnosis.noise)
    {
        diagnosis.withdraw_names();
        updated = twin.clone();
        proof = proven_gap(&held_out, &twin, &twin);
    }
    if let Some(nearest) = diagnosis.nearest.clone() {
        let whole = proven_gap(&held_out, &twin, &nearest.model);
        let fewer = if given.is_empty() { fewer_effects(&problem, &nearest.model) } else { None };
        // A smaller set is diagnosed and proven like any other.
        let smaller = fewer.map(|effects| {
            let mut diagnosis = diagnose(&problem, &effects, &[], rng);
            diagnosis.mark_sure_effects(problem.catalogue);
            diagnosis
        });
        let smaller = smaller.filter(|d| d.sure_findings().next().is_some());
        let proven = smaller.map(|d| (proven_gap(&held_out, &twin, &d.model), d));
        match proven.filter(|(p, d)| is_borne_out(&problem, &held_out, [&d.model, &twin], &p.0, d.noise)) {
            Some((proved, found)) => {
                (updated, proof) = (found.model.clone(), proved);
                diagnosis = Diagnosis { before: diagnosis.before, ..found };
            }
            None => (report.nearest, proof.1) = (Some(whole.0), whole.1),
        }
    }
    if !updated.terms.is_empty() {
        report.in_format = format_models(&problem, &held_out, &diagnosis, &updated, &proof.0);
    } else if diagnosis.verdict == Verdict::Unknown {
        report.in_format = stand_ins(&problem, &held_out, &diagnosis, &proof.0);
    }
    report.laws = laws_of_diagnosis(&problem, &held_out, &diagnosis);
    report.replay = replay_windows(&name, &held_out, &updated, &proof.2);
    (report.gap, report.series, report.diagnosis) = (Some(proof.0), proof.1, diagnosis);
    report
}

/// Whether held-out runs confirm the names of a model against the twin, the second model.
fn is_borne_out(
    problem: &Problem,
    held_out: &Problem,
    [model, twin]: [&JointModel; 2],
    gap: &Gap,
    noise: EffortNoise,
) -> bool {
    // A held-out run may show nothing of an effect acting at a place or for a moment.
    let closes = is_proven(gap);
    let may_better = !is_surely_worse(gap);
    // Beside a lasting effort, and where little is to be explained, one held-out run shows little.
    if closes && !noise.has_remainder() && gap.before > REPORTED_NOISES * gap.noise_floor {
        return true;
    }
    if !closes && !may_better {
        return false;
    }
    let unseen = Unseen::of_models(problem, held_out, [model, twin], noise);
    (closes && unseen.surely_agree()) || (may_better && unseen.bear_out())
}

/// The report of an unproven diagnosis.
pub(super) fn unproven_report(
    joint: String,
    turns: bool,
    diagnosis: Diagnosis,
    tracks: Vec<Track>,
    coverage: Coverage,
) -> JointReport {
    JointReport {
        joint,
        turns,
        diagnosis,
        gap: None,
        series: Vec::new(),
        laws: Vec::new(),
        tracks,
        coverage,
        in_format: Vec::new(),
        replay: Vec::new(),
        nearest: None,
        off_axis: None,
        doubt: None,
    }
}

/// Measured positions of all runs.
pub(super) fn all_tracks(runs: &Runs) -> Vec<Track> {
    let fitted = runs.fitted.iter().map(|log| track_of(log, false));
    fitted.chain(runs.held_out.iter().map(|log| track_of(log, true))).collect()
}

fn track_of(log: &JointLog, is_held_out: bool) -> Track {
    let run = log.run.clone();
    Track { run, is_held_out, time_s: log.time_s.clone(), position: log.position.clone() }
}

/// Another diagnosis, by the prediction of whole windows, where much is left beyond noise: beside a floor
/// beyond any catalogue, the innovation of each sample shows little of the joint's efforts. Findings with
/// surely better predictions stay, as sure of their names as the predictions.
fn by_prediction(
    problem: &Problem,
    mut found: Diagnosis,
    effects: &[usize],
    rng: &mut impl Rng,
) -> Diagnosis {
    // A lasting effort, or one as large as a share of the recorded effort, is no noise.
    let is_loud = found.noise.total_deviation() > MAX_LEFT * problem.coverage.effort_rms;
    if found.verdict == Verdict::Insufficient || !(found.noise.wander > 0.0 || is_loud) {
        return found;
    }
    let predicting = problem.for_prediction();
    if windowed_rmse(&predicting, &found.model) < REPORTED_NOISES * problem.noise_floor() {
        return found;
    }
    let known = found.nearest.as_ref().map_or(&found.model, |n| &n.model);
    let other = diagnose(&predicting, effects, std::slice::from_ref(known), rng);
    if !predicts_better(&predicting, &found.model, &other.model) {
        return other;
    }
    found.weigh_as(problem.catalogue, &other.weighed);
    found
}

/// Of effects with too little explanation, those with clearly better predictions of each fitted run from the
/// others without the rest: effects of single runs alone are taken away, the worst first. `None` where
/// nothing can be.
fn fewer_effects(problem: &Problem, nearest: &JointModel) -> Option<Vec<usize>> {
    // The halves of a single run share its conditions.
    if nearest.terms.len() < 2 || problem.logs.len() < 2 {
        return None;
    }
    let folds = problem.cross_validation_folds();
    let noise = EffortNoise::white_noise(FIRST_NOISE * problem.coverage.effort_rms);
    let whole = predicted_rmse(&folds, nearest, noise);
    let mut model = nearest.clone();
    let mut rmse = whole;
    while model.terms.len() > 1 {
        let mut trials: Vec<(f64, JointModel)> = Vec::with_capacity(model.terms.len());
        for i in 0..model.terms.len() {
            let mut without = model.clone();
            without.terms.remove(i);
            trials.push((predicted_rmse(&folds, &without, noise), without));
        }
        let best = trials.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
        if best.0 > rmse {
            break;
        }
        (rmse, model) = best;
    }
    // A push of one run predicts no other run.
    let pushes = model.terms.iter().any(|t| problem.catalogue[t.effect].is_of_one_run());
    let much = rmse < CLEARLY * whole;
    (much && !pushes).then(|| model.terms.iter().map(|t| t.effect).collect())
}

/// Root of the summed mean square residuals of the second problem of each fold, rad or m, under parameters
/// from the first.
fn predicted_rmse(folds: &[[Problem; 2]], model: &JointModel, noise: EffortNoise) -> f64 {
    let mut squares = Vec::with_capacity(folds.len());
    for [fitted, other] in folds {
        // Parameters come from the other runs; a run's own samples give its start states alone.
        let known = shooting_fit(fitted, model, None, noise, Free::All, Pace::thorough(2)).model;
        squares.push(windowed_rmse(other, &known).powi(2));
    }
    squares.iter().sum::<f64>().sqrt()
}

/// A clearly smaller share of a residual: the effects taken away misled.
/// tuned: tests/python/gap/generate.py.
const CLEARLY: f64 = 0.8;

/// Effort noise at the begin of such a fit, as a share of the recorded effort.
/// chosen: a start value, replaced by the fit.
const FIRST_NOISE: f64 = 0.05;

/// Multiple of the noise up to which a name may leave the gap open.
/// tuned: tests/python/gap/generate.py.
const MAX_FLOORS: f64 = 1.5;

/// Whether held-out runs bear a name out: it closes most of their gap, or brings them near their noise.
fn is_proven(gap: &Gap) -> bool {
    let mut windows: Vec<&WindowGap> = gap.windows.iter().collect();
    // The same windows are left out before and after: the updated twin's largest misses.
    windows.sort_by(|a, b| a.after.total_cmp(&b.after));
    // A start on an edge (of a stop, a catch, a balance) cannot be predicted.
    windows.truncate(windows.len() - (MAX_LEFT * windows.len() as f64) as usize);
    let before: Vec<f64> = windows.iter().map(|w| w.before).collect();
    let after: Vec<f64> = windows.iter().map(|w| w.after).collect();
    // An effect acting in few windows shows in all of them alone.
    is_closed(gap.before, gap.after, gap.noise_floor) || is_closed(rms(&before), rms(&after), gap.noise_floor)
}

/// Whether little is left of a gap, or it comes near the noise.
fn is_closed(before: f64, after: f64, floor: f64) -> bool {
    after <= before && (left_of(before, after, floor) <= MAX_LEFT || after <= MAX_FLOORS * floor)
}

/// The windows with their start states as the sensor sees them.
fn replay_windows(name: &str, held_out: &Problem, model: &JointModel, starts: &[Start]) -> Vec<ReplayWindow> {
    let sensor = model.position_sensor(held_out.catalogue);
    let mut windows = Vec::with_capacity(starts.len());
    for (span, start) in held_out.windows.iter().zip(starts) {
        let log = &held_out.logs[span.log];
        windows.push(ReplayWindow {
            joint: name.to_owned(),
            run: log.run.clone(),
            start_s: log.time_s[span.start],
            samples: span.len,
            position: sensor.scale * (start.position + start.play * sensor.half_gap) + sensor.bias,
            velocity: start.velocity * sensor.scale,
        });
    }
    windows
}
