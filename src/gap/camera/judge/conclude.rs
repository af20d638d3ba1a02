//! Turns a selection into a diagnosis: findings, verdict, proof, places.

use crate::{
    camera::{
        fit::{
            components::{VarianceComponents, largest_m},
            problem::FrameProblem,
        },
        judge::{
            diagnosis::{FrameDiagnosis, OutstandingPart},
            effect_size::without_small,
            missing_finding::missing_finding,
            missing_geometry::missing_geometry,
            proof::{PartResidual, by_part, frame_gap},
            select::{Selected, with_set},
            type_change::TypeChange,
            weigh::findings_of,
        },
        model::{displacement::joints_at_rest, hypothesis::Hypothesis, twin::SeenTwin},
    },
    judge::verdict::Verdict,
};
use common::note::{Note, NoteCode};

/// Largest share of the seen area in conflict for a verdict of agreement.
///
/// tuned: made objects (tests/gap_frames.rs)
const CONFLICT_SHARE: f64 = 0.08;
/// Least displacement of a joint's child between recordings, as a multiple of a pixel's noise, for the frames
/// to tell anything about the joint.
///
/// tuned: made objects (tests/gap_frames.rs)
const LEAST_WAYS: f64 = 10.0;
/// Fewest patches for a verdict.
const MIN_PATCHES: usize = 60;

/// The twin as given, fitted, with the residuals of its parts.
pub(super) struct AsGiven<'a> {
    /// The twin.
    pub twin: &'a SeenTwin,
    /// Its fit without effects.
    pub fitted: Hypothesis,
    /// Residuals of its parts under that fit.
    pub parts: &'a [PartResidual],
}

/// Turns a selection into a diagnosis.
pub(super) fn concluded_diagnosis(
    problem: &FrameProblem,
    selected: Selected,
    change: Option<TypeChange>,
    given: AsGiven,
) -> FrameDiagnosis {
    let mut notes = Vec::new();
    let selected = without_small(problem, selected, &mut notes);
    // The motion law of the changed joint is fitted together with the effects.
    let freed = change.as_ref().and_then(|c| {
        let free: Vec<usize> =
            c.freeing_trials(problem).into_iter().filter(|t| !selected.chosen.set.contains(t)).collect();
        with_set(problem, &selected, &[selected.chosen.set.clone(), free].concat())
    });
    let after = updated_hypothesis(problem, &selected, freed.as_ref());
    let mut findings = findings_of(problem, &selected, &selected.chosen);
    if let (Some(change), Some(freed)) = (&change, &freed) {
        findings.insert(0, change.as_finding(problem, freed));
    }
    let missing = missing_geometry(problem, &after);
    findings.extend(missing.iter().map(|m| missing_finding(m, problem.twin)));
    let gap = frame_gap(problem, (given.twin, &given.fitted), &after, &missing);
    let parts = by_part(problem, &after);
    let too_few = selected.linear.patch_means.len() < MIN_PATCHES;
    if too_few {
        findings.clear();
        notes.push(few_patches(selected.linear.patch_means.len()));
    }
    let least_m = LEAST_WAYS * gap.noise_floor.max(problem.options.accuracy_m);
    let still = joints_at_rest(problem.twin, &after, least_m);
    notes.extend(still.iter().map(|(j, way_m)| stands_still(&problem.twin.joints[*j].name, *way_m)));
    let nothing_moves = !problem.twin.joints.is_empty() && still.len() == problem.twin.joints.len();
    let unexplained = parts.iter().any(|p| p.rms_m > p.floor_m + largest_m(&problem.scales))
        || gap.conflict_after > CONFLICT_SHARE;
    let ambiguous = findings.iter().any(|f| !f.finding.alternatives.is_empty());
    let verdict = match (findings.is_empty(), ambiguous, unexplained) {
        _ if too_few => Verdict::Insufficient,
        // Agreement of the frames proves nothing about joints at rest.
        (true, _, false) if nothing_moves => Verdict::Insufficient,
        (false, true, _) => Verdict::Ambiguous,
        (false, false, _) => Verdict::Named,
        (true, _, true) => Verdict::Unknown,
        (true, _, false) => Verdict::None,
    };
    FrameDiagnosis {
        verdict,
        findings,
        twin: problem.twin.clone(),
        before: given.fitted,
        after,
        gap,
        places: outstanding_parts(problem, given.parts, &parts),
        scales: problem.scales,
        notes,
    }
}

/// The twin with the chosen effects.
fn updated_hypothesis(problem: &FrameProblem, selected: &Selected, freed: Option<&Selected>) -> Hypothesis {
    if let Some(freed) = freed {
        return freed.state.hypothesis.clone();
    }
    if selected.chosen.set.is_empty() {
        return selected.null.hypothesis.clone();
    }
    let mut after = selected.state.clone();
    problem.step_state(
        &mut after,
        &selected.chosen.set,
        &selected.chosen.solution.components,
        problem.gate_m(),
    );
    after.hypothesis
}

fn few_patches(count: usize) -> Note {
    let text = format!(
        "only {count} patches of the object are seen: film 10 views or more from all sides at each position, \
         the object filling the image"
    );
    Note::new(NoteCode::FewPatches, text)
}

fn stands_still(joint: &str, way_m: f64) -> Note {
    let text = format!(
        "{joint} stands at one place in all recordings ({:.1} mm apart): film it at two positions or more, \
         most of its range apart, or nothing is known of its axis and its type",
        1e3 * way_m
    );
    Note::new(NoteCode::JointStands, text)
}

/// Parts with their remaining residuals, worst first.
fn outstanding_parts(problem: &FrameProblem, b: &[PartResidual], a: &[PartResidual]) -> Vec<OutstandingPart> {
    let unnamed_m = VarianceComponents::middle_of_grid(&problem.scales).total_m();
    let mut all: Vec<OutstandingPart> = (0..problem.twin.parts.len())
        .filter(|&p| b[p].rms_m > b[p].floor_m + unnamed_m || b[p].conflict > CONFLICT_SHARE)
        .map(|p| OutstandingPart {
            part: problem.twin.parts[p].name.clone(),
            before_m: b[p].rms_m,
            after_m: a[p].rms_m,
            conflict: b[p].conflict,
            bounds: b[p].bounds,
        })
        .collect();
    all.sort_by(|x, y| (y.before_m + y.conflict).total_cmp(&(x.before_m + x.conflict)));
    all
}
