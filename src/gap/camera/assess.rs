//! The diagnosis of a twin by frames: fit, selection, type of joint, missing geometry, verdict, proof.

use super::{
    effects::CATALOGUE,
    fit::{Chosen, State, Work},
    frames::FrameRun,
    kinds::{KindChange, other_kinds},
    missing::{Missing, missing_geometry},
    placement::{CoarseRun, find_positions},
    proof::{FrameGap, PartResidual, by_part, frame_gap},
    select::{Selected, select},
    trial::Fitted,
    twin::{Hypothesis, SeenTwin},
};
use crate::gap::verdict::{Finding, ParameterEstimate, Verdict};

/// Least weight of a set among its rivals for a name of its own.
const SURE: f64 = 0.9;
/// Rivals below this weight are not told.
const TOLD: f64 = 0.02;
/// Most rivals that are told.
const MOST_RIVALS: usize = 4;
/// Share of the area seen that may conflict under a verdict of agreement.
const CONFLICT_SHARE: f64 = 0.08;
/// Residual of cells, in multiples of the accuracy, that nothing explains and that is not passed over.
const UNEXPLAINED: f64 = 2.0;

/// What an effect must move, and explain, in accuracies of the twin.
const MOVES: f64 = 2.0;
const EXPLAINS: f64 = 1.0 / 3.0;
/// Fewest cells for a verdict.
const MIN_CELLS: usize = 60;

/// What a diagnosis by frames may take for granted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameOptions {
    /// Errors of the twin's surface and joints below this have no name, metres.
    pub accuracy_m: f64,
    /// A frame of every so many is left to the proof.
    pub held_out_every: usize,
}

impl Default for FrameOptions {
    fn default() -> Self {
        Self { accuracy_m: 0.0015, held_out_every: 3 }
    }
}

/// A finding with what a report shows beside it.
#[derive(Clone, Debug)]
pub struct CameraFinding {
    /// Joint that it belongs to; `None` for the camera, and for geometry of the root.
    pub joint: Option<usize>,
    /// The finding.
    pub finding: Finding,
    /// What becomes of it in the URDF.
    pub in_urdf: &'static str,
}

/// The diagnosis.
pub struct FrameDiagnosis {
    /// Verdict.
    pub verdict: Verdict,
    /// Findings.
    pub findings: Vec<CameraFinding>,
    /// Geometry that the twin lacks.
    pub missing: Vec<Missing>,
    /// The twin, its joints of the types that explain the frames.
    pub twin: SeenTwin,
    /// Twin as it was given, fitted.
    pub before: Hypothesis,
    /// Twin with the effects found.
    pub after: Hypothesis,
    /// Gap on held-out frames.
    pub gap: FrameGap,
    /// Joint that was given another type.
    pub kind: Option<KindChange>,
    /// Where the twin and the frames disagree.
    pub places: Vec<Place>,
    /// What is not said elsewhere.
    pub notes: Vec<String>,
}

/// A part whose residual stands out.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// Name of the part.
    pub part: String,
    /// Root mean square residual of its cells without effects, metres.
    pub before_m: f64,
    /// With them.
    pub after_m: f64,
    /// Share of its area that conflicts, without effects.
    pub conflict: f64,
    /// Box of the conflicting points in the part's frame.
    pub bounds: Option<[[f64; 3]; 2]>,
}

/// Diagnoses a twin by frames.
///
/// # Errors
/// A sentence where the frames say nothing about the twin.
pub fn assess(twin: &SeenTwin, runs: &[FrameRun], options: &FrameOptions) -> Result<FrameDiagnosis, String> {
    let work = Work::new(twin, runs, options.held_out_every);
    let mut start = Hypothesis::of(twin, runs.len());
    for (r, run) in runs.iter().enumerate() {
        for (j, joint) in twin.joints.iter().enumerate() {
            start.positions[r][j] = run.positions.get(&joint.name).copied().unwrap_or_default();
        }
        find_positions(twin, &CoarseRun::of(run), &mut start, r);
    }
    let nothing = || {
        "no pixel of the frames lies on the posed twin: check that the recordings show the object, that their camera poses are in the \
         frame of the twin's root link, and that the twin is in metres"
            .to_owned()
    };
    let first = select(&work, State { hypothesis: start, applied: Vec::new() }).ok_or_else(nothing)?;
    let null = first.null.hypothesis.clone();
    let before = by_part(&work, &null);
    match other_kinds(&work, &first) {
        Some((change, other, state)) => {
            let work = Work::new(&other, runs, options.held_out_every);
            let selected = select(&work, state).ok_or_else(nothing)?;
            Ok(conclude(&work, selected, Some(change), (twin, null, &before), options))
        }
        None => Ok(conclude(&work, first, None, (twin, null, &before), options)),
    }
}

/// `before`: the twin as it was given, fitted, and the residuals of its parts.
fn conclude(
    work: &Work,
    selected: Selected,
    kind: Option<KindChange>,
    (original, null, before): (&SeenTwin, Hypothesis, &[PartResidual]),
    options: &FrameOptions,
) -> FrameDiagnosis {
    let mut notes = Vec::new();
    let mut after = selected.state.clone();
    let mut chosen = selected.chosen.clone();
    let size = effect_size(work, &selected, &chosen);
    if !chosen.set.is_empty() && (size.moves_m < MOVES * options.accuracy_m || size.explains_m < EXPLAINS * options.accuracy_m) {
        let names: Vec<&str> = chosen.set.iter().map(|&t| work.trials[t].name).collect();
        notes.push(format!(
            "{} would move what is seen by {:.1} mm and explain {:.1} mm that placing the twin does not; too little for an accuracy of {:.1} mm",
            names.join(" + "),
            1e3 * size.moves_m,
            1e3 * size.explains_m,
            1e3 * options.accuracy_m
        ));
        chosen.set.clear();
        after = selected.null.clone();
    }
    let mut findings = told_findings(work, &selected, &chosen);
    if let Some(change) = &kind {
        findings.insert(0, change.finding(work.twin));
    }
    let missing = missing_geometry(work, &after.hypothesis, options);
    findings.extend(missing.iter().map(|m| m.finding(work.twin)));
    let gap = frame_gap(work, (original, &null), &after.hypothesis, &missing);
    let parts = by_part(work, &after.hypothesis);
    let places = places(work, before, &parts, options);
    let ambiguous = findings.iter().any(|f| !f.finding.alternatives.is_empty());
    let off = |p: &PartResidual| p.rms_m > p.floor_m + UNEXPLAINED * options.accuracy_m;
    let unexplained = parts.iter().any(off) || gap.conflict_after > CONFLICT_SHARE;
    if selected.linear.cells.len() < MIN_CELLS {
        notes.push(format!(
            "only {} patches of the object are seen: film 10 views or more from all sides at each position, the object filling the image",
            selected.linear.cells.len()
        ));
        findings.clear();
    }
    let verdict = match (findings.is_empty(), ambiguous, unexplained) {
        _ if selected.linear.cells.len() < MIN_CELLS => Verdict::Insufficient,
        (false, true, _) => Verdict::Ambiguous,
        (false, false, _) => Verdict::Named,
        (true, _, true) => Verdict::Unknown,
        (true, _, false) => Verdict::None,
    };
    FrameDiagnosis { verdict, findings, missing, twin: work.twin.clone(), before: null, after: after.hypothesis, gap, kind, places, notes }
}

/// How much a set of effects does on the cells that it concerns, root mean squares, metres.
#[derive(Clone, Copy, Debug, Default)]
struct EffectSize {
    /// Motion of the surface by it.
    moves_m: f64,
    /// Residual that is left without it, beyond what is left with it.
    explains_m: f64,
}

fn effect_size(work: &Work, selected: &Selected, chosen: &Chosen) -> EffectSize {
    let (linear, reduced) = (&selected.linear, &selected.reduced);
    let Some(null) = work.judge(linear, reduced, &[]) else { return EffectSize::default() };
    let subset = work.subset(linear, &chosen.set);
    let own: Vec<usize> = chosen.set.iter().flat_map(|&t| linear.of_trial[t].iter().copied()).collect();
    let without = linear.system.left(&work.subset(linear, &[]), &null.solution.values);
    let with = linear.system.left(&subset, &chosen.solution.values);
    let concerned: Vec<usize> = (0..with.len()).filter(|&i| own.iter().any(|&c| linear.system.matrix[(i, c)] != 0.0)).collect();
    // Without the largest, so that a few conflicting cells do not count.
    let middle = |r: &[f64]| {
        let mut squares: Vec<f64> = concerned.iter().map(|&i| r[i] * r[i]).collect();
        squares.sort_unstable_by(f64::total_cmp);
        let kept = squares.len() - squares.len() / 20;
        squares[..kept].iter().sum::<f64>() / kept.max(1) as f64
    };
    let nuisance = work.nuisance.len();
    let values = chosen.solution.values.rows(nuisance, own.len());
    let moved: Vec<f64> =
        (0..with.len()).map(|i| own.iter().zip(values.iter()).map(|(&c, x)| linear.system.matrix[(i, c)] * x).sum()).collect();
    EffectSize { moves_m: middle(&moved).sqrt(), explains_m: (middle(&without) - middle(&with)).max(0.0).sqrt() }
}

fn told_findings(work: &Work, selected: &Selected, chosen: &Chosen) -> Vec<CameraFinding> {
    let mut from = work.nuisance.len();
    let mut findings: Vec<(f64, CameraFinding)> = Vec::new();
    for &t in &chosen.set {
        let trial = &work.trials[t];
        let n = trial.columns.len();
        let values = chosen.solution.values.rows(from, n).into_owned();
        let covariance = chosen.solution.covariance.view((from, from), (n, n)).into_owned();
        from += n;
        let fitted = Fitted { twin: work.twin, hypothesis: &selected.state.hypothesis, trial, values: &values, covariance: &covariance };
        let spec = &CATALOGUE[trial.effect];
        let (weight, alternatives) = weigh(work, selected, chosen, t);
        let finding = Finding {
            index: trial.effect,
            effect: spec.name.to_owned(),
            parameters: (spec.tell)(&fitted),
            weight,
            alternatives,
            experiment: spec.experiment.to_owned(),
        };
        let others: Vec<usize> = chosen.set.iter().copied().filter(|s| *s != t).collect();
        let without = work.evidence(&selected.linear, &selected.reduced, &others);
        findings.push((without, CameraFinding { joint: trial.joint, finding, in_urdf: spec.in_urdf }));
    }
    // What is missed most comes first.
    findings.sort_by(|a, b| a.0.total_cmp(&b.0));
    findings.into_iter().map(|f| f.1).collect()
}

/// Weight of a trial against those that could stand in its place, and their names.
fn weigh(work: &Work, selected: &Selected, chosen: &Chosen, trial: usize) -> (f64, Vec<(String, f64)>) {
    let name = |t: usize| (work.trials[t].name, work.trials[t].joint);
    let mut best: Vec<((&'static str, Option<usize>), f64)> = Vec::new();
    for t in 0..work.trials.len() {
        if chosen.set.contains(&t) && t != trial {
            continue;
        }
        let set: Vec<usize> = chosen.set.iter().map(|&s| if s == trial { t } else { s }).collect();
        let evidence = work.evidence(&selected.linear, &selected.reduced, &set);
        match best.iter_mut().find(|b| b.0 == name(t)) {
            Some(b) => b.1 = b.1.max(evidence),
            None => best.push((name(t), evidence)),
        }
    }
    let top = best.iter().map(|b| b.1).fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = best.iter().map(|b| (b.1 - top).exp()).sum();
    let share = |e: f64| (e - top).exp() / sum;
    let own = best.iter().find(|b| b.0 == name(trial)).map_or(0.0, |b| share(b.1));
    if own >= SURE {
        return (own, Vec::new());
    }
    let mut others: Vec<(String, f64)> = best
        .iter()
        .filter(|b| b.0 != name(trial) && share(b.1) > TOLD)
        .map(|b| {
            let joint = b.0.1.map_or(String::new(), |j| format!(" of {}", work.twin.joints[j].name));
            (format!("{}{joint}", b.0.0), share(b.1))
        })
        .collect();
    others.sort_by(|a, b| b.1.total_cmp(&a.1));
    others.truncate(MOST_RIVALS);
    (own, others)
}

/// Parts with what is left of their residuals, worst first.
fn places(work: &Work, b: &[PartResidual], a: &[PartResidual], options: &FrameOptions) -> Vec<Place> {
    let mut all: Vec<Place> = (0..work.twin.parts.len())
        .filter(|&p| b[p].rms_m > b[p].floor_m + options.accuracy_m || b[p].conflict > CONFLICT_SHARE)
        .map(|p| Place {
            part: work.twin.parts[p].name.clone(),
            before_m: b[p].rms_m,
            after_m: a[p].rms_m,
            conflict: b[p].conflict,
            bounds: b[p].bounds,
        })
        .collect();
    all.sort_by(|x, y| (y.before_m + y.conflict).total_cmp(&(x.before_m + x.conflict)));
    all
}

/// An estimate without an interval of its own.
#[must_use]
pub fn estimate(name: &str, value: f64, unit: &str, half: f64) -> ParameterEstimate {
    ParameterEstimate { name: name.to_owned(), value, unit: unit.to_owned(), interval: (value - half, value + half) }
}
