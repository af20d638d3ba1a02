//! Another type of joint: revolute where the twin has a slide, a slide or a screw where it is revolute.
//! See docs/method.md 15.8.
//!
//! Signature: a part out of reach of its joint's motion, and within reach of another motion. Directions are
//! the joint's own and those of the part's faces; revolute joints are tried on the joint's axis and along the
//! part's edges, screws on the axis with a range of pitches. The best starts are refined with their axis, or
//! their pitch, free.

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
    model::{
        hypothesis::Hypothesis,
        trial::free_joints,
        twin::{SeenMotion, SeenTwin},
    },
};

/// Least mean cost of a part's pixels to doubt its joints.
///
/// derived: the mean of half the square of a normal number: the cost of errors without names in the middle of
/// their grid
const DOUBT: f64 = 0.5;
/// The cost under another type of joint must fall to this share of the cost under the twin's type.
///
/// tuned: made objects (tests/gap_frames.rs)
pub(super) const TYPE_COST: f64 = 0.8;
/// The new type may cost this much more than effects with a fit for every state.
///
/// derived: as many times more as it must cost less than the type in the twin
pub(super) const STATEWISE_COST: f64 = 1.0 / TYPE_COST;
/// Steps of refinement.
const STEPS: usize = 5;
/// Refined starts of each type.
const REFINED: usize = 3;

/// Looks for a joint with another type to bring its part to its place in the frames; the twin with the new
/// type and its state.
#[must_use]
pub fn other_types(problem: &FrameProblem, first: &Selected) -> Option<(TypeChange, SeenTwin, State)> {
    // A fit of every state by itself may stand for a motion the joint lacks.
    let statewise = first.chosen.set.iter().any(|&t| problem.trials[t].log_odds < 0.0);
    let explained = mean_cost(problem, &first.state.hypothesis);
    let before =
        mean_costs_by_part(problem, if statewise { &first.null.hypothesis } else { &first.state.hypothesis });
    let mut doubted = Vec::new();
    for j in free_joints(problem.twin) {
        let joint = &problem.twin.joints[j];
        // A part in a wrong place makes conflicts on the part behind it, too.
        let cost = before[joint.child].max(before[joint.parent]);
        if cost > DOUBT {
            doubted.push((j, cost));
        }
    }
    let (joint, _) = doubted.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let coarse: Vec<CoarseRun> = problem.runs.iter().map(|r| CoarseRun::of_run(r, &problem.scales)).collect();
    // The run with the worst fit of the twin shows the motion best.
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

/// A twin with another law of a joint, and the joint's positions under it.
struct LawStart {
    cost: f64,
    twin: SeenTwin,
    hypothesis: Hypothesis,
}

/// The best starts of each type, found in the run with the worst fit, `worst`, and placed in all.
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
            // Limits in radians say nothing in meters.
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
    // Some of each type go on: the coarse cost of one run must not choose the type.
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

/// A start followed with the axis free, or the pitch of a screw.
fn refined_start(problem: &FrameProblem, joint: usize, start: LawStart) -> (SeenTwin, State) {
    let mut twin = start.twin;
    let own = problem.for_twin(&twin);
    let screw = matches!(twin.joints[joint].kind, SeenMotion::Screw { .. });
    let name = if screw { "wrong_joint_type" } else { "axis_offset" };
    let free = own.trials.iter().position(|t| t.joint == Some(joint) && t.name == name);
    let set: Vec<usize> = free.into_iter().collect();
    let middle = VarianceComponents::middle_of_grid(&problem.scales);
    let mut state = State { hypothesis: start.hypothesis, applied: Vec::new() };
    for _ in 0..STEPS {
        // The result of a step is the law at the start of the next one.
        state.applied.clear();
        follow_steps(&own, &mut state, &set, &middle, 1);
    }
    state.applied.clear();
    let law = state.hypothesis.laws[joint];
    let spec = &mut twin.joints[joint];
    (spec.kind, spec.axis, spec.point) = (law.kind, law.axis, law.point);
    (twin, state)
}
