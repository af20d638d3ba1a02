//! Which part carries which: parents by the simplicity of the relative motion and by contact.
//!
//! A part moves simply against its parent: it turns about one line or slides along one direction. Against any other part
//! it makes the motions of all joints between them, which are simple only by chance (parallel axes, equal directions).
//! A part touches its parent in both states. The static part is preferred where it qualifies: of the explanations of two
//! states it is the one with the shortest chains.

use super::{
    JointConfig, JointEstimate, ObservedState, ParentMotion, PartEvidence, SurfaceSamples, joint::DECISIVE, sample_index::SampleIndex,
};
use crate::model::{JointKind, ParentScore, link_name};

/// Two parts touch where their samples come closer than this share of the object's longest side, or two grid spacings:
/// what the surfaces of a joint are apart that hides between them.
const CONTACT_SHARE: f64 = 0.06;

/// A joint and what it hangs on.
#[derive(Clone, Debug)]
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
    /// Distance of both parts, the larger of both states, metres.
    gap_m: f64,
}

/// The candidates that touch a part and against which it moves no less simply, decisively, than against any other of them.
fn qualified(candidates: &[Candidate], contact_m: f64) -> impl Iterator<Item = &Candidate> {
    let touching = move |c: &&Candidate| c.gap_m < contact_m;
    let simplest = candidates.iter().filter(touching).map(|c| c.excess).fold(f64::INFINITY, f64::min);
    candidates.iter().filter(touching).filter(move |c| c.excess < simplest + DECISIVE)
}

/// The joints of all moving parts, in their order, each with its parent. `root` is the motion of the static part, `still` is the static part's surface in each
/// state, `extent_m` the longest side of the object.
#[must_use]
pub fn kinematic_tree(
    root: &ParentMotion,
    parts: &[PartEvidence],
    still: &[SurfaceSamples; 2],
    states: &[ObservedState; 2],
    extent_m: f64,
    config: &JointConfig,
) -> Vec<TreeJointEstimate> {
    let contact_m = (CONTACT_SHARE * extent_m).max(2.0 * states[0].sdf.spacing_m);
    let candidates = candidates(root, parts, still, states, contact_m, config);
    let parents = attach(&candidates, contact_m);
    let mut found: Vec<Option<TreeJointEstimate>> = vec![None; parts.len()];
    // Parents first: each joint is estimated with its parent's motion as the tree makes it.
    while let Some(k) = (0..parts.len()).find(|&k| found[k].is_none() && (parents[k] == 0 || found[parents[k] - 1].is_some())) {
        let parent = match parents[k].checked_sub(1).and_then(|p| found[p].as_ref()) {
            None => root.clone(),
            Some(p) => ParentMotion { state1_from_state0: p.joint.state1_from_state0, covariance: p.joint.motion_covariance },
        };
        let mut joint = parts[k].joint(&parent, states, config);
        if let Some(plane) = turning_child(&candidates, &parents, k) {
            joint = parts[k].parallel_joint(&joint, plane, &parent, states, config).unwrap_or(joint);
        }
        explain(&mut joint, k, parents[k], &candidates[k], contact_m);
        found[k] = Some(TreeJointEstimate { parent: parents[k], joint });
    }
    found.into_iter().flatten().collect()
}

/// The turn, in the world, of a part that hangs on part `k` (counted from 0) and whose own motion is a plain rotation. Two
/// turns make one only where their axes are parallel or meet; that of the child is often known better, as it turns more.
fn turning_child<'a>(candidates: &'a [Vec<Candidate>], parents: &[usize], k: usize) -> Option<&'a JointEstimate> {
    let children = (0..parents.len()).filter(|&c| parents[c] == k + 1);
    let in_world = children.filter_map(|c| candidates[c].iter().find(|x| x.parent == 0));
    in_world.filter(|c| c.excess < DECISIVE && c.joint.kind == JointKind::Revolute).map(|c| &c.joint).next()
}

/// All parents that every part could have.
fn candidates(
    root: &ParentMotion,
    parts: &[PartEvidence],
    still: &[SurfaceSamples; 2],
    states: &[ObservedState; 2],
    contact_m: f64,
    config: &JointConfig,
) -> Vec<Vec<Candidate>> {
    let reach_m = 2.0 * contact_m;
    let surfaces: Vec<&[SurfaceSamples; 2]> = std::iter::once(still).chain(parts.iter().map(|p| &p.surfaces)).collect();
    let indices: Vec<[SampleIndex<'_>; 2]> = surfaces.iter().map(|s| [0, 1].map(|k| SampleIndex::new(&s[k], reach_m))).collect();
    let motion = |part: usize| if part == 0 { root.state1_from_state0 } else { parts[part - 1].motion };
    let candidate = |k: usize, parent: usize| {
        let carried = ParentMotion { state1_from_state0: motion(parent), ..ParentMotion::still() };
        let joint = parts[k].joint(&carried, states, config);
        Candidate { parent, excess: excess(&joint), gap_m: gap_m(&parts[k], &indices[parent]), joint }
    };
    let of = |k: usize| (0..=parts.len()).filter(|&p| p != k + 1).map(|p| candidate(k, p)).collect();
    (0..parts.len()).map(of).collect()
}

/// Score of the best joint with one freedom against that of the free motion; a screw, which is one of any motion, pays
/// as in the choice of the type.
fn excess(joint: &JointEstimate) -> f64 {
    let of = |name: &str| joint.evidence.type_scores.get(name).copied().unwrap_or(f64::INFINITY);
    let screw = if matches!(joint.kind, JointKind::Screw { .. }) { of("screw") + DECISIVE } else { f64::INFINITY };
    of("prismatic").min(of("revolute")).min(screw) - of("free")
}

/// Distance of a part from another, the larger of both states, metres; at most the reach of the index.
fn gap_m(part: &PartEvidence, other: &[SampleIndex<'_>; 2]) -> f64 {
    let in_state = |s: usize| part.surfaces[s].points.iter().map(|p| other[s].distance_m(p)).fold(f64::INFINITY, f64::min);
    in_state(0).max(in_state(1))
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
    let evidence = &mut joint.evidence;
    for c in candidates {
        evidence.parents.insert(link_name(c.parent), ParentScore { excess: c.excess, gap_m: c.gap_m });
    }
    let others: Vec<String> = qualified(candidates, contact_m).filter(|c| c.parent != parent).map(|c| link_name(c.parent)).collect();
    if !others.is_empty() {
        let [own, others] = [link_name(parent), others.join(" or ")];
        evidence.not_observable.push(format!("the parent: {others} would do as well as {own}, which the shortest chain makes it"));
    }
    if candidates.len() > 1 && qualified(candidates, contact_m).next().is_none() {
        let name = link_name(part + 1);
        evidence.cautions.push(format!("no part touches {name} in both states; it hangs on the static part"));
    }
}

#[cfg(test)]
#[path = "kinematic_tree_tests.rs"]
mod tests;
