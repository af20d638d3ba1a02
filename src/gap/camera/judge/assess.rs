//! Diagnosis of a twin from frames: fit, selection of effects, joint types, missing geometry, verdict, proof.

use crate::camera::{
    fit::{
        cost::{SAME_COST, mean_cost},
        linear::State,
        placement::{CoarseRun, find_positions},
        problem::FrameProblem,
    },
    judge::{
        conclude::{AsGiven, concluded_diagnosis},
        diagnosis::FrameDiagnosis,
        follow::settle_without_effects,
        missing_geometry::missing_geometry,
        other_types::{STATEWISE_COST, TYPE_COST, other_types},
        proof::by_part,
        select::{Selected, selected_effects},
        type_change::TypeChange,
    },
    model::{
        displacement::{apart_m, made_m},
        hypothesis::Hypothesis,
        missing::Missing,
        twin::SeenTwin,
    },
    record::{frames::FrameRun, options::FrameOptions},
};

/// Why frames allow no diagnosis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AssessError {
    /// No pixel shows the twin.
    #[error(
        "no pixel of the frames lies on the posed twin: check that the recordings show the object, that \
         their camera poses are in the frame of the twin's root link, and that the twin is in meters"
    )]
    NothingSeen,
}

/// Diagnoses a twin from frames.
///
/// # Errors
/// [`AssessError`].
pub fn frame_diagnosis(
    twin: &SeenTwin,
    runs: &[FrameRun],
    options: &FrameOptions,
) -> Result<FrameDiagnosis, AssessError> {
    let problem = FrameProblem::new(twin, runs, options);
    let start = State { hypothesis: placed_hypothesis(&problem), applied: Vec::new() };
    let first = selected_effects(&problem, start).ok_or(AssessError::NothingSeen)?;
    // Only a candidate here: whether it is better is judged once missing geometry is known.
    let changed = other_types(&problem, &first);
    let second = around_missing(&problem, &first);
    let as_given = second.as_ref().map_or(&first, |s| &s.1);
    let null = as_given.null.hypothesis.clone();
    let parts = by_part(&problem, &null);
    if let Some((change, other, state)) = changed {
        let other_problem = problem.for_twin(&other);
        if is_better(&problem, as_given, &change, (&other_problem, &state)) {
            let selected = selected_effects(&other_problem, state).ok_or(AssessError::NothingSeen)?;
            let given = AsGiven { twin, fitted: first.null.hypothesis, parts: &parts };
            return Ok(concluded_diagnosis(&other_problem, selected, Some(change), given));
        }
    }
    let (lacks, selected) = second.unwrap_or((Vec::new(), first));
    let given = AsGiven { twin, fitted: null, parts: &parts };
    Ok(concluded_diagnosis(&FrameProblem { lacks, ..problem }, selected, None, given))
}

/// The twin with its joints at the positions shown by the coarse frames.
fn placed_hypothesis(problem: &FrameProblem) -> Hypothesis {
    let twin = problem.twin;
    let mut start = Hypothesis::of_twin(twin, problem.runs.len());
    for (r, run) in problem.runs.iter().enumerate() {
        for (j, joint) in twin.joints.iter().enumerate() {
            start.positions[r][j] = run.positions.get(&joint.name).copied().unwrap_or_default();
        }
        find_positions(twin, &CoarseRun::of_run(run, &problem.scales), &mut start, r);
    }
    start
}

/// Whether a joint of another type explains the frames better than the twin as given, and by more than the
/// twin's own errors.
fn is_better(
    problem: &FrameProblem,
    as_given: &Selected,
    change: &TypeChange,
    (other, state): (&FrameProblem, &State),
) -> bool {
    // A separate fit for every state costs less than any law; a law need only come near it.
    let statewise = as_given.chosen.set.iter().any(|&t| problem.trials[t].log_odds < 0.0);
    let most = if statewise { STATEWISE_COST } else { TYPE_COST };
    let null = (problem.twin, &as_given.null.hypothesis);
    let apart_m = apart_m(change.joint, null, (other.twin, &state.hypothesis));
    apart_m > made_m(problem.twin, Some(change.joint))
        && seen_cost(other, state) < most * seen_cost(problem, &as_given.state)
}

/// Mean cost of the frames, without readings of missing geometry.
fn seen_cost(problem: &FrameProblem, state: &State) -> f64 {
    let mut judge = problem.for_twin(problem.twin);
    judge.lacks = missing_geometry(&judge, &state.hypothesis);
    mean_cost(&judge, &state.hypothesis)
}

/// The twin's missing geometry, and the effects selected without its readings, if they explain the rest
/// better.
fn around_missing(problem: &FrameProblem, first: &Selected) -> Option<(Vec<Missing>, Selected)> {
    let mut null = first.null.clone();
    let mut lacks = missing_geometry(problem, &null.hypothesis);
    if lacks.is_empty() {
        return None;
    }
    let mut without = problem.for_twin(problem.twin);
    // Missing geometry biases the fit and is itself found from the fit, so both are repeated.
    for _ in 0..2 {
        without.lacks = lacks;
        settle_without_effects(&without, &mut null);
        lacks = missing_geometry(&without, &null.hypothesis);
    }
    let second = selected_effects(&without, null)?;
    (seen_cost(problem, &second.state) < SAME_COST * seen_cost(problem, &first.state))
        .then_some((lacks, second))
}
