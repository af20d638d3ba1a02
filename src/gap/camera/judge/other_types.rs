//! Another joint type: revolute where the twin has a slide, a slide or a screw where it is revolute.
//! See docs/method.md 15.8.
//!
//! Signature: the joint's motion cannot bring its part to its place in the frames, but another motion can.
//! Candidate directions are the joint's own and those of the part's faces; revolute joints are tried on the
//! joint's axis and along the part's edges, screws on the axis with several pitches. The best starts are
//! refined with their axis, or their pitch, free.

use crate::camera::{
    fit::{
        components::VarianceComponents,
        cost::{mean_cost, mean_costs_by_part},
        linear::State,
        placement::{CoarseRun, find_position},
        problem::FrameProblem,
    },
    judge::{
        follow::follow_steps,
        laws::{laws_of_other_types, type_rank},
        select::Selected,
        type_change::TypeChange,
    },
    model::{hypothesis::Hypothesis, trial::free_joints, twin::SeenTwin},
};
use geometry::AxisMotion;

/// Least mean cost of a part's pixels for its joints to be doubted.
///
/// derived: the mean of half the square of a standard normal number: the expected cost with unnamed errors in
/// the middle of their grid
const DOUBT: f64 = 0.5;
/// The cost with another joint type must fall to this share of the cost with the twin's type.
///
/// tuned: made objects (tests/gap_frames.rs)
pub(super) const TYPE_COST: f64 = 0.8;
/// The new type may cost this many times the cost of effects with a separate fit for every state.
///
/// derived: the inverse of `TYPE_COST`, the same ratio in the other direction
pub(super) const STATEWISE_COST: f64 = 1.0 / TYPE_COST;
/// Number of refinement steps.
const STEPS: usize = 5;
/// Number of starts refined for each type.
const REFINED: usize = 3;

/// Looks for a joint whose part another type brings to its place in the frames. Returns the change, the twin
/// with the new type, and its state.
pub fn other_types(problem: &FrameProblem, first: &Selected) -> Option<(TypeChange, SeenTwin, State)> {
    // A separate fit for every state may stand for a motion missing in the joint.
    let statewise = first.chosen.set.iter().any(|&t| problem.trials[t].log_odds < 0.0);
    let explained = mean_cost(problem, &first.state.hypothesis);
    let before =
        mean_costs_by_part(problem, if statewise { &first.null.hypothesis } else { &first.state.hypothesis });
    let mut doubted = Vec::new();
    for j in free_joints(problem.twin) {
        let joint = &problem.twin.joints[j];
        // A misplaced part also makes conflicts on the part behind it.
        let cost = before[joint.child].max(before[joint.parent]);
        if cost > DOUBT {
            doubted.push((j, cost));
        }
    }
    let (joint, _) = doubted.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let coarse: Vec<CoarseRun> = problem.runs.iter().map(|r| CoarseRun::of_run(r, &problem.scales)).collect();
    // The run with the worst fit shows the motion best.
    let worst = (0..coarse.len())
        .map(|r| (r, coarse[r].mean_cost(problem.twin, &first.null.hypothesis, r)))
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(r, _)| r)?;
    let starts = best_starts(problem, joint, &coarse, worst, &first.null.hypothesis);
    let refined = starts.into_iter().map(|s| refined_start(problem, joint, s));
    let best = refined.map(|(twin, state)| {
        let cost = mean_cost(&problem.for_twin(&twin), &state.hypothesis);
        (cost, twin, state)
    });
    let (cost, twin, state) = best.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let was = before.last().copied().unwrap_or(f64::INFINITY);
    let spec = &twin.joints[joint];
    let change = TypeChange {
        joint,
        from: problem.twin.joints[joint].kind,
        to: spec.kind,
        axis: spec.axis,
        point: spec.point,
        cost: [was, cost],
    };
    let better = cost < TYPE_COST * was && (!statewise || cost < STATEWISE_COST * explained);
    better.then_some((change, twin, state))
}

/// A twin with another motion law of a joint, and the joint's positions under it.
struct LawStart {
    cost: f64,
    twin: SeenTwin,
    hypothesis: Hypothesis,
}

/// The best starts of each type, found in the run with the worst fit, `worst`, and placed in all runs.
fn best_starts(
    problem: &FrameProblem,
    joint: usize,
    coarse: &[CoarseRun],
    worst: usize,
    null: &Hypothesis,
) -> Vec<LawStart> {
    let mut starts: Vec<LawStart> = laws_of_other_types(problem.twin, joint)
        .into_iter()
        .map(|(kind, axis, point)| {
            let mut twin = problem.twin.clone();
            let spec = &mut twin.joints[joint];
            // Limits in radians do not apply to meters.
            if kind.is_turning() != spec.kind.is_turning() {
                spec.limit = None;
            }
            (spec.kind, spec.axis, spec.point) = (kind, axis, point);
            let mut hypothesis = Hypothesis::of_twin(&twin, problem.runs.len());
            hypothesis.positions.clone_from(&null.positions);
            hypothesis.positions.iter_mut().for_each(|p| p[joint] = 0.0);
            let cost = find_position(&twin, &coarse[worst], &mut hypothesis, worst, joint);
            LawStart { cost, twin, hypothesis }
        })
        .collect();
    starts.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    // Keep some of each type: the coarse cost of one run must not choose the type.
    let mut kept = [0usize; 3];
    starts.retain(|s| {
        let count = &mut kept[type_rank(s.twin.joints[joint].kind)];
        *count += 1;
        *count <= REFINED
    });
    for s in &mut starts {
        for r in (0..coarse.len()).filter(|r| *r != worst) {
            find_position(&s.twin, &coarse[r], &mut s.hypothesis, r, joint);
        }
    }
    starts
}

/// Refines a start with the axis free, or the pitch of a screw.
fn refined_start(problem: &FrameProblem, joint: usize, start: LawStart) -> (SeenTwin, State) {
    let mut twin = start.twin;
    let own = problem.for_twin(&twin);
    let screw = matches!(twin.joints[joint].kind, AxisMotion::Screw { .. });
    let name = if screw { "wrong_joint_type" } else { "axis_offset" };
    let free = own.trials.iter().position(|t| t.joint == Some(joint) && t.name == name);
    let set: Vec<usize> = free.into_iter().collect();
    let middle = VarianceComponents::middle_of_grid(&problem.scales);
    let mut state = State { hypothesis: start.hypothesis, applied: Vec::new() };
    for _ in 0..STEPS {
        // The result of each step is the law at the start of the next one.
        state.applied.clear();
        follow_steps(&own, &mut state, &set, &middle, 1);
    }
    state.applied.clear();
    let law = state.hypothesis.laws[joint];
    let spec = &mut twin.joints[joint];
    (spec.kind, spec.axis, spec.point) = (law.kind, law.axis, law.point);
    (twin, state)
}
