//! The tree of parts: parents are chosen by simplicity of the relative motion and by contact. See
//! docs/method.md 8.10.
//!
//! Relative to its parent, a part moves simply: it turns about one line or slides along one direction.
//! Relative to any other part, it makes the motions of all joints between them, which are simple only by
//! chance (parallel axes, equal directions). A part touches its parent in all states, and turns about a line
//! close to both. The static part is preferred where it qualifies: it gives the shortest chains.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{
    joints::{
        cautions::vagueness,
        estimate::JointChoice,
        flat_faces::flat_faces,
        free_motion::ParentMotion,
        joint::JointEstimate,
        joint_config::JointConfig,
        joint_type::DECISIVE,
        pair_evidence::ObservedState,
        parent_candidates::{Candidates, ParentCandidate, parent_candidates},
        part_evidence::PartEvidence,
        square_axes::{SeenDirection, square_priors},
    },
    observations::SurfaceSamples,
    samples::hinge::HINGE,
};
use common::note::{Note, NoteCode};
use model::{JointKind, JointRemark};

/// A joint and its parent.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TreeJointEstimate {
    /// Index of the parent: 0 is the static part, k the k-th moving part.
    pub parent: usize,
    /// The joint, relative to the parent.
    pub joint: JointEstimate,
}

/// The joints of all moving parts, in their order, each with its parent. `root` are the motions of the static
/// part from state 0 to all other states; `extent_m` is the longest side of the object.
pub fn kinematic_tree(
    root: &[ParentMotion],
    parts: &[PartEvidence],
    states: &[ObservedState],
    extent_m: f64,
    config: &JointConfig,
) -> Vec<TreeJointEstimate> {
    // A joint hides the space between the surfaces of its two parts.
    let contact_m = (HINGE * extent_m).max(2.0 * states[0].sdf.spacing_m);
    let still: Vec<SurfaceSamples> = states.iter().map(|s| s.samples_of_part(0)).collect();
    // Contact and simplicity decide the tree before priors move any axis towards another.
    let candidates = parent_candidates(root, parts, &still, contact_m);
    let parents = chosen_parents(&candidates, contact_m);
    let doubtful = JointChoice { doubt: true, kind: None };
    // The prior of each axis comes from the other axes, each estimated from its motions alone.
    let alone = joints_of_tree(&parents, root, |k, carried| parts[k].estimated_joint(carried, doubtful));
    let axes: Vec<_> = alone.iter().map(JointEstimate::seen_direction).collect();
    let priors = square_priors(&axes, &flat_faces(&still[0]), &config.square);
    let mut joints = joints_of_tree(&parents, root, |k, carried| {
        // Where the parent's joint changes, so does the motion relative to it, but not its kind.
        let known = JointChoice { kind: Some(alone[k].kind), ..doubtful };
        let joint = if parents[k] == 0 { alone[k].clone() } else { parts[k].estimated_joint(carried, known) };
        with_prior(joint, priors[k].as_ref(), &parts[k], carried)
    });
    for (k, joint) in joints.iter_mut().enumerate() {
        add_open_properties(joint, &parts[k], extent_m);
        candidates[k].add_doubts(joint, k, parents[k]);
    }
    joints.into_iter().zip(parents).map(|(joint, parent)| TreeJointEstimate { parent, joint }).collect()
}

/// Adds notes on properties of a joint that the motions of its part do not determine.
fn add_open_properties(joint: &mut JointEstimate, part: &PartEvidence, extent_m: f64) {
    // A turning part has shown its turn; a round one may have turned while it slid.
    if joint.kind == JointKind::Prismatic && part.looks_alike_round(joint) {
        let open = "a turn about its axis: the part looks alike all round, so that a screw would do as well";
        joint.evidence.not_observable.push(Note::new(NoteCode::SpinNotObserved, open).into());
    }
    let vague = vagueness(joint, extent_m);
    joint.evidence.cautions.splice(0..0, vague.into_iter().map(JointRemark::from));
}

/// A joint with a prior of its direction from the other axes and the faces.
fn with_prior(
    joint: JointEstimate,
    prior: Option<&SeenDirection>,
    part: &PartEvidence,
    carried: &[ParentMotion],
) -> JointEstimate {
    match prior {
        Some(prior) => part.settled(joint.with_axis_prior(prior, carried), carried),
        None => joint,
    }
}

/// The joints of a tree, parents first: each is estimated with its parent's motions as found in the tree.
fn joints_of_tree(
    parents: &[usize],
    root: &[ParentMotion],
    estimate: impl Fn(usize, &[ParentMotion]) -> JointEstimate + Sync,
) -> Vec<JointEstimate> {
    let mut found: Vec<Option<JointEstimate>> = vec![None; parents.len()];
    loop {
        let next: Vec<usize> = (0..parents.len())
            .filter(|&k| found[k].is_none() && (parents[k] == 0 || found[parents[k] - 1].is_some()))
            .collect();
        if next.is_empty() {
            return found.into_iter().flatten().collect();
        }
        let estimates: Vec<JointEstimate> = next
            .par_iter()
            .map(|&k| {
                let parent = parents[k].checked_sub(1).and_then(|p| found[p].as_ref());
                estimate(k, &parent.map_or_else(|| root.to_vec(), motions_of_part))
            })
            .collect();
        next.into_iter().zip(estimates).for_each(|(k, estimate)| found[k] = Some(estimate));
    }
}

/// The motions of the joint's part from state 0 to every other state.
fn motions_of_part(joint: &JointEstimate) -> Vec<ParentMotion> {
    let mut motions = Vec::with_capacity(joint.motions.len());
    for (k, (motion, covariance)) in joint.motions.iter().zip(&joint.covariances).enumerate() {
        let drawn = joint.drawn.get(k).cloned().unwrap_or_default();
        motions.push(ParentMotion { state1_from_state0: *motion, covariance: *covariance, drawn });
    }
    motions
}

/// Parent of every part: the static part where it qualifies, else the simplest and nearest qualified
/// candidate that is already in the tree; the static part where there is none.
fn chosen_parents(candidates: &[Candidates], contact_m: f64) -> Vec<usize> {
    let qualified: Vec<Vec<&ParentCandidate>> = candidates.iter().map(Candidates::qualified).collect();
    let mut parents: Vec<Option<usize>> =
        qualified.iter().map(|all| all.iter().any(|c| c.parent == 0).then_some(0)).collect();
    loop {
        let mut best: Option<(f64, usize, usize)> = None;
        for k in (0..parents.len()).filter(|&k| parents[k].is_none()) {
            for c in qualified[k].iter().filter(|c| c.parent > 0 && parents[c.parent - 1].is_some()) {
                // The cost of docs/method.md (8.16): a decisive excess costs as much as the largest contact
                // gap.
                let cost_m = c.gap_m + contact_m * c.excess / DECISIVE;
                if best.is_none_or(|b| cost_m.total_cmp(&b.0).is_lt()) {
                    best = Some((cost_m, k, c.parent));
                }
            }
        }
        let Some((_, k, parent)) = best else { break };
        parents[k] = Some(parent);
    }
    // A part without contact, or with itself among its ancestors, gets the static part as parent.
    parents.into_iter().map(Option::unwrap_or_default).collect()
}

#[cfg(test)]
#[path = "kinematic_tree_tests.rs"]
mod tests;
