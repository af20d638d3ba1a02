//! All evidence of the states on one part, and the joint estimated from it.

use crate::{
    joints::{
        estimate::{JointChoice, estimate_joint},
        free_motion::ParentMotion,
        joint::JointEstimate,
        joint_fit::{JointMotion, PartPlace},
        pair_evidence::PairEvidence,
        symmetry::looks_alike_round,
    },
    observations::SurfaceSamples,
};

/// All evidence on one part: state 0 paired with every other state, in their order.
pub struct PartEvidence<'a> {
    first: PairEvidence<'a>,
    others: Vec<PairEvidence<'a>>,
}

impl<'a> PartEvidence<'a> {
    /// Collects the evidence of all pairs; `None` without one.
    pub fn new(pairs: impl IntoIterator<Item = PairEvidence<'a>>) -> Option<Self> {
        let mut pairs = pairs.into_iter();
        Some(Self { first: pairs.next()?, others: pairs.collect() })
    }

    /// The evidence of every pair.
    pub fn pairs(&self) -> impl Iterator<Item = &PairEvidence<'a>> {
        std::iter::once(&self.first).chain(&self.others)
    }

    /// Its surface in every state.
    pub fn surfaces(&self) -> impl Iterator<Item = &SurfaceSamples> {
        std::iter::once(&self.first.surfaces[0]).chain(self.pairs().map(|p| &p.surfaces[1]))
    }

    /// Position and size of the part in state 0.
    pub fn place(&self) -> PartPlace {
        self.first.place
    }

    /// Estimates the joint between this part and a parent with the given motions to all other states.
    pub fn estimated_joint(&self, parents: &[ParentMotion], choice: JointChoice) -> JointEstimate {
        estimate_joint(&self.joint_motions(parents), self.place(), choice)
    }

    /// A turning joint with its axis at the best place for its fixed direction.
    pub fn settled(&self, joint: JointEstimate, parents: &[ParentMotion]) -> JointEstimate {
        joint.settled(&self.joint_motions(parents))
    }

    /// Whether the part would fit all states as well after a turn about the axis of a joint.
    pub fn looks_alike_round(&self, joint: &JointEstimate) -> bool {
        self.pairs()
            .zip(&joint.motions)
            .all(|(pair, motion)| looks_alike_round(&pair.motion_evidence(), motion, &joint.axis))
    }

    /// The evidence for all motions, with one block size: the blocks of state 0 are joined across motions.
    fn joint_motions<'m>(&'m self, parents: &'m [ParentMotion]) -> Vec<JointMotion<'m>> {
        let mut motions: Vec<JointMotion> =
            self.pairs().zip(parents).map(|(pair, parent)| pair.joint_motion(parent)).collect();
        let block_m = motions.iter().map(|m| m.evidence.block_m).fold(0.0, f64::max);
        motions.iter_mut().for_each(|m| m.evidence.block_m = block_m);
        motions
    }
}
