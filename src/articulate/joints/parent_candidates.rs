//! Possible parents of a part: how simply it moves relative to each, and whether it touches it.

use rayon::prelude::*;

use crate::{
    joints::{
        estimate::JointChoice,
        free_motion::ParentMotion,
        joint::JointEstimate,
        joint_type::{DECISIVE, excess_over_free},
        part_evidence::PartEvidence,
    },
    observations::SurfaceSamples,
    samples::{hinge::axis_off_m, sample_index::SampleIndex},
};
use geometry::Pose;
use model::{JointKind, JointRemark, ParentScore};

/// Score against a turn about a line in the air, beside one of both parts.
/// chosen: 2 ln 50, as one in fifty hinges is a linkage that turns a part about such a line
const IN_AIR: f64 = 8.0;

/// Evidence for a part as the parent of another.
#[derive(Clone, Debug)]
pub(crate) struct ParentCandidate {
    /// 0 is the static part, k the k-th moving part.
    pub parent: usize,
    joint: JointEstimate,
    /// Lowest score of a joint with one freedom, less the free motion's.
    pub excess: f64,
    /// Distance between both parts, the largest over all states, meters.
    pub gap_m: f64,
    /// Sum of the distances of a turn's axis from both parts in state 0, meters; 0 for a slide.
    off_m: f64,
}

/// All possible parents of a part.
pub(crate) struct Candidates {
    all: Vec<ParentCandidate>,
    /// Parts closer than this touch, meters.
    contact_m: f64,
}

impl Candidates {
    /// Whether a part moves as simply relative to a candidate as relative to any other in contact: none is
    /// decisively simpler. (Relative to any part, what moves in a plane turns about some line.)
    fn as_simple(&self, candidate: &ParentCandidate) -> bool {
        let touching = self.all.iter().filter(|c| c.gap_m < self.contact_m);
        let least = touching.map(|c| self.score(c)).fold(f64::INFINITY, f64::min);
        self.score(candidate) < least + DECISIVE
    }

    /// The excess of a candidate, with what is against its hinge.
    fn score(&self, candidate: &ParentCandidate) -> f64 {
        candidate.excess + if candidate.off_m < self.contact_m { 0.0 } else { IN_AIR }
    }

    /// The candidates in contact relative to which the part moves simply, with none decisively simpler. If
    /// some of their turns have an axis close to both parts, as hinges do, only those are returned.
    pub(crate) fn qualified(&self) -> Vec<&ParentCandidate> {
        let simple: Vec<&ParentCandidate> =
            self.all.iter().filter(|c| c.gap_m < self.contact_m && self.as_simple(c)).collect();
        let hinged: Vec<&ParentCandidate> =
            simple.iter().copied().filter(|c| c.off_m < self.contact_m).collect();
        if hinged.is_empty() { simple } else { hinged }
    }

    /// Adds notes on doubts about the parent of part number `part` and on other possible parents.
    pub(crate) fn add_doubts(&self, joint: &mut JointEstimate, part: usize, parent: usize) {
        let scores = self.all.iter().map(|c| (c.parent, ParentScore { excess: c.excess, gap_m: c.gap_m }));
        joint.evidence.parents.extend(scores);
        let qualified = self.qualified();
        let others: Vec<usize> = qualified.iter().map(|c| c.parent).filter(|p| *p != parent).collect();
        if !others.is_empty() {
            joint.evidence.not_observable.push(JointRemark::OtherParents { others, parent });
        }
        let base = self.all.iter().find(|c| c.parent == 0 && parent != 0 && self.as_simple(c));
        let against_base = base.map(|base| self.against_base(base, joint));
        joint.evidence.not_observable.extend(against_base);
        if self.all.len() > 1 && qualified.is_empty() {
            let states = joint.positions.len() + 1;
            joint.evidence.cautions.push(JointRemark::Untouched { link: part + 1, states });
        }
    }

    /// Why a part that moves as simply relative to the static part does not have it as parent.
    fn against_base(&self, base: &ParentCandidate, joint: &JointEstimate) -> JointRemark {
        let touches = base.gap_m < self.contact_m;
        let both_turn = joint.kind.turns() && base.joint.kind.turns();
        JointRemark::StaticAsSimple {
            link: base.parent,
            gap_m: (!touches).then_some(base.gap_m),
            axis_off_m: both_turn.then(|| (base.joint.point - joint.point).cross(&base.joint.axis).norm()),
        }
    }
}

/// A part as a possible parent of another.
struct PossibleParent<'a> {
    /// Its surface in every state.
    surfaces: Vec<&'a SurfaceSamples>,
    indices: Vec<SampleIndex<'a>>,
    /// Its motion from state 0 to every other state.
    motions: Vec<ParentMotion>,
}

impl<'a> PossibleParent<'a> {
    fn new(surfaces: Vec<&'a SurfaceSamples>, motions: impl Iterator<Item = Pose>, reach_m: f64) -> Self {
        Self {
            indices: surfaces.iter().map(|s| SampleIndex::new(s, reach_m)).collect(),
            surfaces,
            // All candidates are judged by motions without a joint, whose errors are comparable.
            motions: motions
                .map(|state1_from_state0| ParentMotion { state1_from_state0, ..ParentMotion::static_part() })
                .collect(),
        }
    }

    /// Largest distance from another part over all states, meters; at most the reach of the index.
    fn gap_m(&self, part: &PossibleParent) -> f64 {
        let mut largest_m = 0.0;
        for (part, own) in part.surfaces.iter().zip(&self.indices) {
            let gap_m = part.points.iter().map(|p| own.distance_m(p)).fold(f64::INFINITY, f64::min);
            largest_m = f64::max(largest_m, gap_m);
        }
        largest_m
    }
}

/// The possible parents of every part. `root` are the motions of the static part, `still` is its surface in
/// every state; parts closer than `contact_m`, meters, touch.
pub(crate) fn parent_candidates(
    root: &[ParentMotion],
    parts: &[PartEvidence],
    still: &[SurfaceSamples],
    contact_m: f64,
) -> Vec<Candidates> {
    // Gaps beyond contact need not be known; twice its distance leaves room for the report.
    let reach_m = 2.0 * contact_m;
    let mut bodies =
        vec![PossibleParent::new(still.iter().collect(), root.iter().map(|m| m.state1_from_state0), reach_m)];
    for part in parts {
        let motions = part.pairs().map(|p| p.motion);
        bodies.push(PossibleParent::new(part.surfaces().collect(), motions, reach_m));
    }
    (0..parts.len())
        .into_par_iter()
        .map(|k| {
            let others = (0..bodies.len()).into_par_iter().filter(|&parent| parent != k + 1);
            let all =
                others.map(|parent| parent_candidate(&parts[k], &bodies[k + 1], parent, &bodies[parent]));
            Candidates { all: all.collect(), contact_m }
        })
        .collect()
}

/// The evidence for body number `parent` as the parent of a part.
fn parent_candidate(
    part: &PartEvidence,
    own: &PossibleParent,
    parent: usize,
    body: &PossibleParent,
) -> ParentCandidate {
    let joint = part.estimated_joint(&body.motions, JointChoice::default());
    // Any motion has a screw axis: beside the part, it does not make a parent simple.
    let threaded = matches!(joint.kind, JointKind::Screw { .. });
    let excess = excess_over_free(&joint.evidence.type_scores, threaded);
    let off_m = if joint.kind == JointKind::Revolute {
        axis_off_m(&joint.point, &joint.axis, &own.surfaces[0].points, &body.surfaces[0].points)
    } else {
        0.0
    };
    ParentCandidate { parent, excess, gap_m: body.gap_m(own), off_m, joint }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use model::JointEvidence;

    fn turning(parent: usize, excess: f64, off_m: f64) -> ParentCandidate {
        let joint = JointEstimate {
            kind: JointKind::Revolute,
            axis: Vector3::z_axis(),
            point: Point3::origin(),
            positions: Vec::new(),
            motions: Vec::new(),
            covariances: Vec::new(),
            drawn: Vec::new(),
            evidence: JointEvidence::default(),
        };
        ParentCandidate { parent, joint, excess, gap_m: 0.002, off_m }
    }

    #[test]
    fn a_hinge_in_the_air_must_be_much_simpler_than_one_on_both_parts() {
        let qualified = |excess: f64, off_m: f64| -> Vec<usize> {
            let all = vec![turning(0, -1.0, off_m), turning(2, excess, 0.004)];
            let candidates = Candidates { all, contact_m: 0.02 };
            candidates.qualified().iter().map(|c| c.parent).collect()
        };
        // The leaf of a folding door turns relative to the frame about a line in the air.
        assert_eq!(qualified(10.0, 0.3), [2]);
        assert_eq!(qualified(10.0, 0.004), [0]);
        assert_eq!(qualified(18.0, 0.3), [0]);
        assert_eq!(qualified(8.0, 0.004), [0, 2]);
    }
}
