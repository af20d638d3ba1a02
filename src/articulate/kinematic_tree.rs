//! Which part carries which: parents by the simplicity of the relative motion and by contact.
//!
//! A part moves simply against its parent: it turns about one line or slides along one direction. Against any other part
//! it makes the motions of all joints between them, which are simple only by chance (parallel axes, equal directions).
//! A part touches its parent in all states, and turns about a line that runs by both. The static part is preferred where it
//! qualifies: of the explanations it is the one with the shortest chains.

use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use super::{
    JointConfig, JointEstimate, ObservedState, ParentMotion, PartEvidence, SurfaceSamples,
    flat_faces::flat_faces,
    hinge::axis_off_m,
    joint::{DECISIVE, excess},
    joint_of_part, pair_of,
    sample_index::SampleIndex,
    square_axes::square_priors,
    vagueness::vagueness,
};
use crate::{
    geometry::Pose,
    model::{JointKind, ParentScore, link_name},
};

/// Two parts touch where their samples come closer than this share of the object's longest side, or two grid spacings:
/// what the surfaces of a joint are apart that hides between them.
const CONTACT_SHARE: f64 = 0.06;

/// A joint and what it hangs on.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TreeJointEstimate {
    /// Part that carries it: 0 is the static one, k the k-th moving part.
    pub parent: usize,
    /// The joint, the parent's motion taken out.
    pub joint: JointEstimate,
}

/// How well a part would hang on another.
#[derive(Clone, Debug)]
struct Candidate {
    parent: usize,
    joint: JointEstimate,
    /// Lowest score of a joint with one freedom, against that of the free motion.
    excess: f64,
    /// Distance of both parts, the largest of all states, metres.
    gap_m: f64,
    /// Distance of the axis of a turn from both parts in state 0, summed, metres; 0 for a slide, which has none.
    off_m: f64,
}

/// Whether a part moves against a candidate no less simply, decisively, than against any other that it touches.
fn as_simple(candidate: &Candidate, all: &[Candidate], contact_m: f64) -> bool {
    let touching = all.iter().filter(|c| c.gap_m < contact_m);
    candidate.excess < touching.map(|c| c.excess).fold(f64::INFINITY, f64::min) + DECISIVE
}

/// The candidates that touch a part and against which it moves no less simply, decisively, than against any other of them;
/// where some of these turns run by both parts, as hinges do, only those.
fn qualified(candidates: &[Candidate], contact_m: f64) -> impl Iterator<Item = &Candidate> {
    let touching = move |c: &&Candidate| c.gap_m < contact_m;
    let simple = move |c: &&Candidate| touching(c) && as_simple(c, candidates, contact_m);
    let hinged = move |c: &&Candidate| c.off_m < contact_m;
    let some = candidates.iter().filter(simple).any(|c| hinged(&c));
    candidates.iter().filter(simple).filter(move |c| !some || hinged(c))
}

/// The joints of all moving parts, in their order, each with its parent. A part has one evidence for each motion from state 0
/// to another state, and `root` is the motion of the static part to each of these; `still` is the static part's surface in
/// each state, `extent_m` the longest side of the object.
#[must_use]
pub fn kinematic_tree(
    root: &[ParentMotion],
    parts: &[Vec<PartEvidence>],
    still: &[SurfaceSamples],
    states: &[ObservedState],
    extent_m: f64,
    config: &JointConfig,
) -> Vec<TreeJointEstimate> {
    let contact_m = (CONTACT_SHARE * extent_m).max(2.0 * states[0].sdf.spacing_m);
    let candidates = candidates(root, parts, still, states, contact_m, config);
    let parents = attach(&candidates, contact_m);
    let alone = grown(&parents, |k, carried| joint_of_part(&parts[k], carried, states, true, None, config), root);
    let axes: Vec<_> = alone.iter().map(JointEstimate::seen_direction).collect();
    let priors = square_priors(&axes, &flat_faces(&still[0]), &config.square);
    // Where the parent's joint changes, so does the motion against it, not its kind.
    let square = |k: usize, carried: &[ParentMotion]| {
        let joint = match parents[k] {
            0 => alone[k].clone(),
            _ => joint_of_part(&parts[k], carried, states, true, Some(alone[k].kind), config),
        };
        let Some(prior) = &priors[k] else { return joint };
        let joint = joint.towards(prior, carried);
        match (parts[k].as_slice(), carried) {
            ([part], [parent]) => part.placed(joint, parent, &pair_of(states, 0), config),
            _ => joint,
        }
    };
    let joints = grown(&parents, square, root);
    let explained = joints.into_iter().enumerate().map(|(k, mut joint)| {
        if let ([part], JointKind::Prismatic) = (parts[k].as_slice(), joint.kind)
            && part.looks_alike_round(&joint, &pair_of(states, 0), config)
        {
            let said = "a turn about its axis: the part looks alike all round, so that a screw would do as well";
            joint.evidence.not_observable.push(said.to_owned());
        }
        let vague = vagueness(&joint, extent_m);
        joint.evidence.cautions.splice(0..0, vague);
        explain(&mut joint, k, parents[k], &candidates[k], contact_m);
        TreeJointEstimate { parent: parents[k], joint }
    });
    explained.collect()
}

/// The joints of a tree, parents first: each is estimated with its parent's motions as the tree makes them.
fn grown(parents: &[usize], estimate: impl Fn(usize, &[ParentMotion]) -> JointEstimate, root: &[ParentMotion]) -> Vec<JointEstimate> {
    let mut found: Vec<Option<JointEstimate>> = vec![None; parents.len()];
    while let Some(k) = (0..parents.len()).find(|&k| found[k].is_none() && (parents[k] == 0 || found[parents[k] - 1].is_some())) {
        let carried = parents[k].checked_sub(1).and_then(|p| found[p].as_ref()).map_or_else(|| root.to_vec(), carried);
        found[k] = Some(estimate(k, &carried));
    }
    found.into_iter().flatten().collect()
}

/// What the joint's part does in every state behind state 0.
fn carried(joint: &JointEstimate) -> Vec<ParentMotion> {
    let motion = |(m, c): (&Pose, &Matrix6<f64>)| ParentMotion { state1_from_state0: *m, covariance: *c };
    joint.motions.iter().zip(&joint.covariances).map(motion).collect()
}

/// All parents that every part could have.
fn candidates(
    root: &[ParentMotion],
    parts: &[Vec<PartEvidence>],
    still: &[SurfaceSamples],
    states: &[ObservedState],
    contact_m: f64,
    config: &JointConfig,
) -> Vec<Vec<Candidate>> {
    let reach_m = 2.0 * contact_m;
    let all: Vec<Vec<&SurfaceSamples>> = std::iter::once(still.iter().collect()).chain(parts.iter().map(|p| surfaces(p))).collect();
    let indices: Vec<Vec<SampleIndex<'_>>> = all.iter().map(|s| s.iter().map(|s| SampleIndex::new(s, reach_m)).collect()).collect();
    let motion = |part: usize, k: usize| if part == 0 { root[k].state1_from_state0 } else { parts[part - 1][k].motion };
    let candidate = |k: usize, parent: usize| {
        let carried = |m: usize| ParentMotion { state1_from_state0: motion(parent, m), ..ParentMotion::still() };
        let carried: Vec<ParentMotion> = (0..root.len()).map(carried).collect();
        let joint = joint_of_part(&parts[k], &carried, states, false, None, config);
        let threaded = matches!(joint.kind, JointKind::Screw { .. });
        let excess = excess(&joint.evidence.type_scores, threaded);
        let off_m = match joint.kind {
            JointKind::Revolute => axis_off_m((&joint.point, &joint.axis), &all[k + 1][0].points, &all[parent][0].points),
            _ => 0.0,
        };
        Candidate { parent, excess, gap_m: gap_m(&all[k + 1], &indices[parent]), off_m, joint }
    };
    let of = |k: usize| (0..=parts.len()).filter(|&p| p != k + 1).map(|p| candidate(k, p)).collect();
    (0..parts.len()).map(of).collect()
}

/// Surface of a part in every state.
fn surfaces(part: &[PartEvidence]) -> Vec<&SurfaceSamples> {
    part.iter().take(1).map(|p| &p.surfaces[0]).chain(part.iter().map(|p| &p.surfaces[1])).collect()
}

/// Distance of a part from another, the largest of all states, metres; at most the reach of the index.
fn gap_m(part: &[&SurfaceSamples], other: &[SampleIndex<'_>]) -> f64 {
    let in_state =
        |(part, other): (&&SurfaceSamples, &SampleIndex<'_>)| part.points.iter().map(|p| other.distance_m(p)).fold(f64::INFINITY, f64::min);
    part.iter().zip(other).map(in_state).fold(0.0, f64::max)
}

/// Parent of every part: the static part where it qualifies, else the candidate that does and is in the tree already,
/// simplest and nearest first; the static part where none does.
fn attach(candidates: &[Vec<Candidate>], contact_m: f64) -> Vec<usize> {
    let mut parents: Vec<Option<usize>> =
        candidates.iter().map(|all| qualified(all, contact_m).find(|c| c.parent == 0).map(|_| 0)).collect();
    loop {
        let open = (0..parents.len()).filter(|&k| parents[k].is_none());
        let reached = |c: &&Candidate| c.parent > 0 && parents[c.parent - 1].is_some();
        let best = open
            .flat_map(|k| qualified(&candidates[k], contact_m).filter(reached).map(move |c| (k, c)))
            .min_by(|(_, a), (_, b)| (a.gap_m + contact_m * a.excess / DECISIVE).total_cmp(&(b.gap_m + contact_m * b.excess / DECISIVE)));
        let Some((k, c)) = best else { break };
        parents[k] = Some(c.parent);
    }
    parents.into_iter().map(Option::unwrap_or_default).collect()
}

/// Says what speaks against the parent and which others would do.
fn explain(joint: &mut JointEstimate, part: usize, parent: usize, candidates: &[Candidate], contact_m: f64) {
    let all = if joint.positions.len() == 1 { "both" } else { "all" };
    let evidence = &mut joint.evidence;
    for c in candidates {
        evidence.parents.insert(link_name(c.parent), ParentScore { excess: c.excess, gap_m: c.gap_m });
    }
    let others: Vec<String> = qualified(candidates, contact_m).filter(|c| c.parent != parent).map(|c| link_name(c.parent)).collect();
    if !others.is_empty() {
        let [own, others] = [link_name(parent), others.join(" or ")];
        evidence.not_observable.push(format!("the parent: {others} would do as well as {own}, which the shortest chain makes it"));
    }
    if let Some(c) = candidates.iter().find(|c| c.parent == 0 && parent != 0 && as_simple(c, candidates, contact_m)) {
        let base = link_name(0);
        let why = if c.gap_m < contact_m {
            "its axis would not run by both".to_owned()
        } else {
            format!("{base} is {:.0} mm away", 1e3 * c.gap_m)
        };
        let turns = joint.kind.turns() && c.joint.kind.turns();
        let off_mm = 1e3 * (c.joint.point - joint.point).cross(&c.joint.axis).norm();
        let elsewhere = if turns { format!("; there the axis would lie {off_mm:.0} mm from here") } else { String::new() };
        evidence.not_observable.push(format!("the parent: the motion against {base} is as simple, but {why}{elsewhere}"));
    }
    if candidates.len() > 1 && qualified(candidates, contact_m).next().is_none() {
        let name = link_name(part + 1);
        evidence.cautions.push(format!("no part touches {name} in {all} states; it hangs on the static part"));
    }
}

#[cfg(test)]
#[path = "kinematic_tree_tests.rs"]
mod tests;
