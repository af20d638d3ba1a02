//! From one joint's logs to its report: diagnosis on the fitted runs, proof on the held-out ones.

use rand_core::Rng;
use tracing::debug;

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

/// Logs of one joint, split into fitted and held-out ones.
#[derive(Clone, Debug)]
pub struct Runs {
    /// Logs used for the fit.
    pub fitted: Vec<JointLog>,
    /// Logs used for the proof only.
    pub held_out: Vec<JointLog>,
    /// Whether the joint is revolute.
    pub turns: bool,
    /// How the effort is interpolated between samples.
    pub hold: Hold,
    /// Effects to be fitted instead of searched, as catalogue indices; empty for a search.
    pub effects: Vec<usize>,
}

/// A joint's runs with the diagnosis from the fitted ones.
pub struct Examined<'c> {
    name: String,
    /// The fitted runs.
    pub problem: Problem<'c>,
    /// The held-out runs.
    pub held_out: Problem<'c>,
    /// The diagnosis.
    pub diagnosis: Diagnosis,
    /// Score of the effects found by the innovations of single samples ([`Diagnosis::score`]).
    pub score: f64,
    /// Effects given by the caller.
    given: Vec<usize>,
    tracks: Vec<Track>,
}

impl Examined<'_> {
    /// Whether the effects were given.
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

/// Diagnoses a joint from its fitted runs.
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
    let score = diagnosis.score;
    let diagnosis = by_prediction(&problem, diagnosis, &runs.effects, rng);
    Examined { name: name.to_owned(), problem, held_out, diagnosis, score, given: runs.effects, tracks }
}

/// Proves a joint's findings on the held-out runs.
#[must_use]
pub fn proven_report(examined: Examined, rng: &mut impl Rng) -> JointReport {
    let Examined { name, problem, held_out, mut diagnosis, given, tracks, .. } = examined;
    let effects = problem.catalogue;
    let mut report =
        unproven_report(name.clone(), problem.turns, diagnosis.clone(), tracks, problem.coverage.clone());
    if diagnosis.verdict == Verdict::Insufficient || held_out.logs.is_empty() {
        return report;
    }
    // The actuator stays as found.
    let twin = diagnosis.model.without_effects();
    // A push (disturbance) occurred only in its own run.
    let mut updated = diagnosis.model.clone();
    updated.terms.retain(|t| !effects[t.effect].is_of_one_run());
    let mut proof = proven_gap(&held_out, &twin, &updated);
    // A lasting effort moving the joint by more than the noise is a gap, but no effect names it.
    if diagnosis.verdict == Verdict::None
        && diagnosis.noise.has_remainder()
        && proof.0.before > REPORTED_NOISES * proof.0.noise_floor
    {
        diagnosis.verdict = Verdict::Unknown;
    }
    // Names not confirmed by held-out runs are withdrawn; the proof is then the twin's.
    if !updated.terms.is_empty() {
        let keeps = is_borne_out(&problem, &held_out, [&updated, &twin], &proof.0, diagnosis.noise);
        let Gap { before, after, noise_floor, .. } = proof.0;
        debug!(joint = name, keeps, before, after, noise_floor, "names held against unseen runs");
        if !keeps {
            diagnosis.withdraw_names();
            updated = twin.clone();
            proof = proven_gap(&held_out, &twin, &twin);
        }
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
                debug!(joint = name, before = proved.0.before, after = proved.0.after, "smaller set named");
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

/// Whether held-out runs confirm the effects of the first model against the second, the twin.
fn is_borne_out(
    problem: &Problem,
    held_out: &Problem,
    [model, twin]: [&JointModel; 2],
    gap: &Gap,
    noise: EffortNoise,
) -> bool {
    // A held-out run may not contain an effect acting only at one position or for a moment.
    let closes = is_proven(gap);
    let may_better = !is_surely_worse(gap);
    // With a lasting effort, or little to be explained, one held-out run is weak evidence.
    if closes && !noise.has_remainder() && gap.before > REPORTED_NOISES * gap.noise_floor {
        return true;
    }
    if !closes && !may_better {
        return false;
    }
    let unseen = Unseen::of_models(problem, held_out, [model, twin], noise);
    (closes && unseen.surely_agree()) || (may_better && unseen.bear_out())
}

/// The report of a diagnosis without a proof.
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
        is_imposed: false,
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

/// Repeats the diagnosis by the prediction of whole windows if much more than noise is left: with errors
/// beyond the catalogue the innovations of single samples say little about the efforts. The first findings
/// are kept if they predict surely better; their weights are then those of the predictions.
fn by_prediction(
    problem: &Problem,
    mut found: Diagnosis,
    effects: &[usize],
    rng: &mut impl Rng,
) -> Diagnosis {
    // A lasting effort is not noise, nor is one as large as this share of the recorded effort.
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
    let keeps = predicts_better(&predicting, &found.model, &other.model);
    debug!(
        keeps,
        first = found.model.terms.len(),
        second = other.model.terms.len(),
        "set held against one that predicts"
    );
    if !keeps {
        return other;
    }
    found.weigh_as(problem.catalogue, &other.weighed);
    found
}

/// Where the effects found do not explain enough: the subset predicting each fitted run from the others
/// clearly better. Effects are removed one by one, the worst first, so those helping only the runs they were
/// fitted to go. `None` if this does not help.
fn fewer_effects(problem: &Problem, nearest: &JointModel) -> Option<Vec<usize>> {
    // The two halves of a single run share its conditions.
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
    // A push of one run does not predict another run.
    let pushes = model.terms.iter().any(|t| problem.catalogue[t.effect].is_of_one_run());
    let much = rmse < CLEARLY * whole;
    debug!(
        left = model.terms.len(),
        of = nearest.terms.len(),
        rmse,
        whole,
        much,
        "effects dropped that predict worse"
    );
    (much && !pushes).then(|| model.terms.iter().map(|t| t.effect).collect())
}

/// Root of the sum over folds of the mean square residual, rad or m, of the second problem under parameters
/// from the first.
fn predicted_rmse(folds: &[[Problem; 2]], model: &JointModel, noise: EffortNoise) -> f64 {
    let mut squares = Vec::with_capacity(folds.len());
    for [fitted, other] in folds {
        // Parameters come from the other runs; a run's own samples only determine its start states.
        let known = shooting_fit(fitted, model, None, noise, Free::All, Pace::thorough(2)).model;
        squares.push(windowed_rmse(other, &known).powi(2));
    }
    squares.iter().sum::<f64>().sqrt()
}

/// A residual below this share is clearly smaller: the removed effects misled.
/// tuned: tests/python/gap/generate.py.
const CLEARLY: f64 = 0.8;

/// Effort noise at the start of such a fit, as a share of the recorded effort.
/// chosen: a start value, replaced by the fit.
const FIRST_NOISE: f64 = 0.05;

/// A finding may leave the gap open up to this multiple of the noise.
/// tuned: tests/python/gap/generate.py.
const MAX_FLOORS: f64 = 1.5;

/// Whether the held-out runs confirm a finding: it closes most of the gap, or brings it near the noise.
fn is_proven(gap: &Gap) -> bool {
    let mut windows: Vec<&WindowGap> = gap.windows.iter().collect();
    // The same windows are left out before and after: those with the updated twin's largest residuals.
    windows.sort_by(|a, b| a.after.total_cmp(&b.after));
    // A start at an unstable point (of a stop, a catch, a balance) cannot be predicted.
    windows.truncate(windows.len() - (MAX_LEFT * windows.len() as f64) as usize);
    let before: Vec<f64> = windows.iter().map(|w| w.before).collect();
    let after: Vec<f64> = windows.iter().map(|w| w.after).collect();
    // An effect acting in few windows is visible only over all of them.
    is_closed(gap.before, gap.after, gap.noise_floor) || is_closed(rms(&before), rms(&after), gap.noise_floor)
}

/// Whether little is left of a gap, or what is left is near the noise.
fn is_closed(before: f64, after: f64, floor: f64) -> bool {
    after <= before && (left_of(before, after, floor) <= MAX_LEFT || after <= MAX_FLOORS * floor)
}

/// The windows with their start states as seen by the sensor.
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
            play: start.play,
        });
    }
    windows
}
