//! Findings of a selection: parameters, weights and rivals.

use crate::{
    camera::{
        effects::CATALOGUE,
        fit::{linear::Chosen, problem::FrameProblem},
        judge::{
            finding::{CameraFinding, Subject},
            select::Selected,
        },
        model::trial::Fitted,
    },
    judge::{finding::Finding, name_weight::rivals_in_doubt},
};

pub(super) fn findings_of(
    problem: &FrameProblem,
    selected: &Selected,
    chosen: &Chosen,
) -> Vec<CameraFinding> {
    let mut from = problem.nuisance.len();
    let mut findings: Vec<(f64, CameraFinding)> = Vec::new();
    for &t in &chosen.set {
        let trial = &problem.trials[t];
        let n = trial.columns.len();
        let values = chosen.solution.values.rows(from, n).into_owned();
        let covariance = chosen.solution.covariance.view((from, from), (n, n)).into_owned();
        from += n;
        let fitted = Fitted {
            twin: problem.twin,
            hypothesis: &selected.state.hypothesis,
            trial,
            values: &values,
            covariance: &covariance,
        };
        let spec = &CATALOGUE[trial.effect];
        let (weight, alternatives) = weight_and_rivals(problem, selected, chosen, t);
        let finding = Finding {
            index: trial.effect,
            effect: spec.name.to_owned(),
            parameters: (spec.reported)(&fitted),
            weight,
            alternatives,
            experiment: spec.experiment.to_owned(),
            is_sure: true,
        };
        let others: Vec<usize> = chosen.set.iter().copied().filter(|s| *s != t).collect();
        let without = problem.evidence_of_set(&selected.linear, &selected.reduced, &others);
        findings.push((
            without,
            CameraFinding {
                subject: trial.joint.map_or(Subject::Camera, Subject::Joint),
                finding,
                types: spec.types,
                in_urdf: spec.in_urdf,
            },
        ));
    }
    // The finding with the largest loss of evidence comes first.
    findings.sort_by(|a, b| a.0.total_cmp(&b.0));
    findings.into_iter().map(|f| f.1).collect()
}

/// Weight of a trial against its rivals, and their names.
fn weight_and_rivals(
    problem: &FrameProblem,
    selected: &Selected,
    chosen: &Chosen,
    trial: usize,
) -> (f64, Vec<(String, f64)>) {
    let name = |t: usize| (problem.trials[t].name, problem.trials[t].joint);
    let mut best: Vec<((&'static str, Option<usize>), f64)> = Vec::new();
    for t in 0..problem.trials.len() {
        // A trial already chosen cannot replace another.
        if chosen.set.contains(&t) && t != trial {
            continue;
        }
        let set: Vec<usize> = chosen.set.iter().map(|&s| if s == trial { t } else { s }).collect();
        let evidence = problem.evidence_of_set(&selected.linear, &selected.reduced, &set);
        // Variants of one effect at one joint share a name; the best one represents them.
        match best.iter_mut().find(|b| b.0 == name(t)) {
            Some(b) => b.1 = b.1.max(evidence),
            None => best.push((name(t), evidence)),
        }
    }
    // Evidences are large logarithms: relative to the largest, the exponentials stay finite.
    let top = best.iter().map(|b| b.1).fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = best.iter().map(|b| (b.1 - top).exp()).sum();
    let share = |e: f64| (e - top).exp() / sum;
    let (own, mut others): (Vec<_>, Vec<_>) = best.into_iter().partition(|b| b.0 == name(trial));
    let own = own.first().map_or(0.0, |b| share(b.1));
    others.sort_by(|a, b| b.1.total_cmp(&a.1));
    let weights: Vec<f64> = others.iter().map(|b| share(b.1)).collect();
    others.truncate(rivals_in_doubt(own, &weights));
    let mut rivals = Vec::with_capacity(others.len());
    for ((effect, joint), evidence) in others {
        let joint = joint.map_or(String::new(), |j| format!(" of {}", problem.twin.joints[j].name));
        rivals.push((format!("{effect}{joint}"), share(evidence)));
    }
    (own, rivals)
}
