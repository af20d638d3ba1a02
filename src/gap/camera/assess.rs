//! The diagnosis of a twin by frames: fit, selection, type of joint, missing geometry, verdict, proof.

use super::{
    effects::CATALOGUE,
    fit::{Chosen, GATE_M, State, Work},
    frames::FrameRun,
    kinds::{KindChange, mean_cost, other_kinds},
    missing::{Missing, missing_geometry},
    own_error::{apart_m, still},
    placement::{CoarseRun, find_positions},
    proof::{FrameGap, PartResidual, by_part, frame_gap},
    select::{Selected, select, settle, with_set},
    trial::{Fitted, INTERVAL},
    twin::{Hypothesis, SeenTwin},
};
use crate::gap::verdict::{Finding, ParameterEstimate, Verdict};

/// Least weight of a set among its rivals for a name of its own.
const SURE: f64 = 0.9;
/// Rivals below this weight are not told.
const TOLD: f64 = 0.02;
/// Most rivals that are told.
const MOST_RIVALS: usize = 4;
/// Costs that are the same.
const SAME: f64 = 1.05;
/// The cost under another type of joint must be below this share of that under the type in the twin, and under that with
/// effects that fit every state by itself.
const KIND_COST: [f64; 2] = [0.8, 1.2];
/// Share of the area seen that may conflict under a verdict of agreement.
const CONFLICT_SHARE: f64 = 0.08;
/// Residual of cells beyond the camera's noise that nothing explains and that is not passed over, metres.
const UNEXPLAINED_M: f64 = 0.003;
/// Residual beyond the camera's noise from which a part is told as a place, metres.
const PLACE_M: f64 = 0.0015;
/// Multiple of a pixel's noise that a joint's child must move between recordings, for anything to be known of the joint.
const LEAST_WAYS: f64 = 10.0;
/// What an effect must move, in errors of the twin.
const MOVES: f64 = 1.0;
/// Fewest cells for a verdict.
const MIN_CELLS: usize = 60;

/// What a diagnosis by frames may take for granted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameOptions {
    /// Least error of the twin's surface and joints, metres; what the frames show beyond it is found with the effects.
    pub accuracy_m: f64,
    /// A frame of every so many is left to the proof.
    pub held_out_every: usize,
}

impl Default for FrameOptions {
    fn default() -> Self {
        Self { accuracy_m: 0.0003, held_out_every: 3 }
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
    let work = Work::new(twin, runs, options);
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
    let changed = other_kinds(&work, &first);
    let second = around_missing(&work, &first);
    let null = second.as_ref().map_or(&first.null, |s| &s.1.null).hypothesis.clone();
    let before = by_part(&work, &null);
    let as_given = second.as_ref().map_or(&first, |s| &s.1);
    let (best, chosen) = (seen_cost(&work, &as_given.state), &as_given.chosen);
    if let Some((change, other, state)) = changed {
        let statewise = chosen.set.iter().any(|&t| work.trials[t].log_odds < 0.0);
        let work = work.of(&other);
        let apart_m = apart_m(change.joint, (twin, &null), (&other, &state.hypothesis));
        let own_m = twin.own.made_m(twin, Some(change.joint));
        if apart_m > own_m && seen_cost(&work, &state) < KIND_COST[usize::from(statewise)] * best {
            let selected = select(&work, state).ok_or_else(nothing)?;
            return Ok(conclude(&work, selected, Some(change), (twin, first.null.hypothesis, &before), options));
        }
    }
    let (lacks, selected) = second.unwrap_or((Vec::new(), first));
    Ok(conclude(&Work { lacks, ..work }, selected, None, (twin, null, &before), options))
}

/// Mean cost of what is seen, but for readings of geometry that the twin would lack.
fn seen_cost(work: &Work, state: &State) -> f64 {
    let mut judge = work.of(work.twin);
    judge.lacks = missing_geometry(&judge, &state.hypothesis, &work.options);
    mean_cost(&judge, &state.hypothesis)
}

/// Where the twin seems to lack geometry: what it lacks, and effects selected without readings of that, if these explain
/// the rest better.
fn around_missing(work: &Work, first: &Selected) -> Option<(Vec<Missing>, Selected)> {
    let mut null = first.null.clone();
    let mut lacks = missing_geometry(work, &null.hypothesis, &work.options);
    if lacks.is_empty() {
        return None;
    }
    let mut without = work.of(work.twin);
    for _ in 0..2 {
        without.lacks = lacks;
        settle(&without, &mut null);
        lacks = missing_geometry(&without, &null.hypothesis, &work.options);
    }
    let second = select(&without, null)?;
    (seen_cost(work, &second.state) < SAME * seen_cost(work, &first.state)).then_some((lacks, second))
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
    let selected = without_small(work, selected, &mut notes);
    // The law of a joint of another type is fitted with the effects.
    let freed = kind.as_ref().and_then(|k| {
        let free: Vec<usize> = k.free(work).into_iter().filter(|t| !selected.chosen.set.contains(t)).collect();
        with_set(work, &selected, &[selected.chosen.set.clone(), free].concat())
    });
    let mut after = selected.state.clone();
    if let Some(freed) = &freed {
        after.clone_from(&freed.state);
    } else if selected.chosen.set.is_empty() {
        after.clone_from(&selected.null);
    } else {
        work.step(&mut after, &selected.chosen.set, &selected.chosen.solution.sizes, GATE_M);
    }
    let chosen = &selected.chosen;
    let mut findings = told_findings(work, &selected, chosen);
    findings.iter_mut().for_each(|f| widen(work.twin, f));
    if let (Some(change), Some(freed)) = (&kind, &freed) {
        findings.insert(0, change.finding(work, freed));
    }
    let missing = missing_geometry(work, &after.hypothesis, options);
    findings.extend(missing.iter().map(|m| m.finding(work.twin)).map(|mut f| {
        if !work.twin.own.is_exact() {
            // Nothing in the frames tells which.
            f.finding.weight = 0.5;
            f.finding.alternatives.push(("geometry that the reconstruction itself lacks".into(), 0.5));
        }
        f
    }));
    let gap = frame_gap(work, (original, &null), &after.hypothesis, &missing);
    let parts = by_part(work, &after.hypothesis);
    let places = places(work, before, &parts);
    let ambiguous = findings.iter().any(|f| !f.finding.alternatives.is_empty());
    let off = |p: &PartResidual| p.rms_m > p.floor_m + UNEXPLAINED_M;
    let unexplained = parts.iter().any(off) || gap.conflict_after > CONFLICT_SHARE;
    if selected.linear.cells.len() < MIN_CELLS {
        notes.push(format!(
            "only {} patches of the object are seen: film 10 views or more from all sides at each position, the object filling the image",
            selected.linear.cells.len()
        ));
        findings.clear();
    }
    let still = still(work.twin, &after.hypothesis, LEAST_WAYS * gap.noise_floor.max(options.accuracy_m));
    for (j, way_m) in &still {
        notes.push(format!(
            "{} stands at one place in all recordings ({:.1} mm apart): film it at two positions or more, most of its range apart, or nothing \
             is known of its axis and its type",
            work.twin.joints[*j].name,
            1e3 * way_m
        ));
    }
    let nothing_moves = !work.twin.joints.is_empty() && still.len() == work.twin.joints.len();
    let verdict = match (findings.is_empty(), ambiguous, unexplained) {
        _ if selected.linear.cells.len() < MIN_CELLS => Verdict::Insufficient,
        (true, _, false) if nothing_moves => Verdict::Insufficient,
        (false, true, _) => Verdict::Ambiguous,
        (false, false, _) => Verdict::Named,
        (true, _, true) => Verdict::Unknown,
        (true, _, false) => Verdict::None,
    };
    FrameDiagnosis { verdict, findings, missing, twin: work.twin.clone(), before: null, after: after.hypothesis, gap, kind, places, notes }
}

/// Lets go of effects that move what they concern by less than the twin errs.
fn without_small(work: &Work, mut selected: Selected, notes: &mut Vec<String>) -> Selected {
    loop {
        let accuracy_m = selected.chosen.solution.sizes.patch_m;
        let own_m = |i: usize| (MOVES * accuracy_m).max(work.twin.own.made_m(work.twin, work.trials[selected.chosen.set[i]].joint));
        let all = (0..selected.chosen.set.len()).map(|i| (i, moved_m(work, &selected, i), own_m(i)));
        let least = all.min_by(|a, b| (a.1 / a.2).total_cmp(&(b.1 / b.2)));
        let Some((i, moved_m, own_m)) = least.filter(|(_, moved_m, own_m)| moved_m < own_m) else { return selected };
        let mut set = selected.chosen.set.clone();
        let name = work.trials[set.remove(i)].name;
        notes.push(format!(
            "{name} would move what is seen by {:.1} mm; too little for a twin whose own errors are {:.1} mm",
            1e3 * moved_m,
            1e3 * own_m
        ));
        let Some(next) = with_set(work, &selected, &set) else { return selected };
        selected = next;
    }
}

/// Widens the intervals of an axis by what the twin itself does not know of it.
fn widen(twin: &SeenTwin, finding: &mut CameraFinding) {
    let Some(own) = finding.joint.filter(|_| finding.finding.effect == "axis_offset").and_then(|j| twin.own.joints.get(j)) else { return };
    for p in &mut finding.finding.parameters {
        let own = INTERVAL * if p.unit == "rad" { own.axis_rad } else { own.place_m };
        p.interval = (p.value - (p.value - p.interval.0).hypot(own), p.value + (p.interval.1 - p.value).hypot(own));
        // Both are lengths.
        p.interval.0 = p.interval.0.max(0.0);
    }
}

/// How much an effect of the set moves what it concerns across the surface: root mean square without the largest, metres.
fn moved_m(work: &Work, selected: &Selected, which: usize) -> f64 {
    let (linear, set) = (&selected.linear, &selected.chosen.set);
    let own = &linear.of_trial[set[which]];
    let from = work.nuisance.len() + set[..which].iter().map(|&t| linear.of_trial[t].len()).sum::<usize>();
    let values = selected.chosen.solution.values.rows(from, own.len());
    let concerned = (0..linear.system.matrix.nrows()).filter(|&i| own.iter().any(|&c| linear.system.matrix[(i, c)] != 0.0));
    let moved = |i: usize| own.iter().zip(values.iter()).map(|(&c, x)| linear.system.matrix[(i, c)] * x).sum::<f64>();
    let mut squares: Vec<f64> = concerned.map(|i| moved(i).powi(2)).collect();
    squares.sort_unstable_by(f64::total_cmp);
    // Without the largest, so that a few conflicting cells do not count.
    let kept = squares.len() - squares.len() / 20;
    (squares[..kept].iter().sum::<f64>() / kept.max(1) as f64).sqrt()
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
fn places(work: &Work, b: &[PartResidual], a: &[PartResidual]) -> Vec<Place> {
    let mut all: Vec<Place> = (0..work.twin.parts.len())
        .filter(|&p| b[p].rms_m > b[p].floor_m + PLACE_M || b[p].conflict > CONFLICT_SHARE)
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
