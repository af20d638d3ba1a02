//! All that the states show of one part, and the joint that it makes.

use crate::{
    joints::{
        estimate::{JointChoice, estimate_joint},
        free_motion::ParentMotion,
        joint::JointEstimate,
        joint_config::JointConfig,
        joint_fit::{JointMotion, PartPlace},
        pair_evidence::PairEvidence,
        symmetry::looks_alike_round,
    },
    observations::SurfaceSamples,
};

/// All that the states show of one part: the evidence of state 0 with every other state, in their order.
pub struct PartEvidence<'a> {
    first: PairEvidence<'a>,
    others: Vec<PairEvidence<'a>>,
}

impl<'a> PartEvidence<'a> {
    /// The evidence of all pairs; `None` without one.
    #[must_use]
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

    /// Where it is in state 0.
    #[must_use]
    pub fn place(&self) -> PartPlace {
        self.first.place
    }

    /// The joint between a parent, by its motions to all other states, and this part.
    #[must_use]
    pub fn joint(
        &self,
        parents: &[ParentMotion],
        choice: JointChoice,
        config: &JointConfig,
    ) -> JointEstimate {
        estimate_joint(&self.motions(parents), self.place(), choice, &config.refine)
    }

    /// A turning joint, its axis moved to where it suits its direction best.
    #[must_use]
    pub fn settled(
        &self,
        joint: JointEstimate,
        parents: &[ParentMotion],
        config: &JointConfig,
    ) -> JointEstimate {
        joint.settled(&self.motions(parents), &config.refine)
    }

    /// Whether the part would fit all states as well if it had turned about the axis of a joint.
    #[must_use]
    pub fn looks_alike_round(&self, joint: &JointEstimate, config: &JointConfig) -> bool {
        let alike = |(pair, motion)| {
            looks_alike_round(&PairEvidence::evidence(pair), motion, &joint.axis, &config.refine)
        };
        self.pairs().zip(&joint.motions).all(alike)
    }

    /// What is known of all motions, with blocks of one size, as those of state 0 are counted across motions.
    fn motions<'m>(&'m self, parents: &'m [ParentMotion]) -> Vec<JointMotion<'m>> {
        let mut motions: Vec<JointMotion> =
            self.pairs().zip(parents).map(|(pair, parent)| pair.joint_motion(parent)).collect();
        let block_m = motions.iter().map(|m| m.evidence.block_m).fold(0.0, f64::max);
        motions.iter_mut().for_each(|m| m.evidence.block_m = block_m);
        motions
    }
}
