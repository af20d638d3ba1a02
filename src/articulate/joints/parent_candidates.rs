//! The parts that could carry a part: how simply it moves against each, and whether it touches it.

use rayon::prelude::*;

use crate::{
    joints::{
        estimate::JointChoice,
        free_motion::ParentMotion,
        joint::JointEstimate,
        joint_config::JointConfig,
        joint_type::{DECISIVE, excess},
        part_evidence::PartEvidence,
    },
    observations::SurfaceSamples,
    samples::{hinge::axis_off_m, sample_index::SampleIndex},
};
use common::note::{Note, NoteCode};
use geometry::Pose;
use model::{JointKind, ParentScore, link_name};

/// How well a part would hang on another.
#[derive(Clone, Debug)]
pub(crate) struct Candidate {
    /// 0 is the static part, k the k-th moving part.
    pub parent: usize,
    joint: JointEstimate,
    /// Lowest score of a joint with one freedom, against that of the free motion.
    pub excess: f64,
    /// Distance of both parts, the largest of all states, meters.
    pub gap_m: f64,
    /// Distance of the axis of a turn from both parts in state 0, summed, meters; 0 for a slide, which has
    /// none.
    off_m: f64,
}

/// All parents that a part could have.
pub(crate) struct Candidates {
    all: Vec<Candidate>,
    /// Parts that are closer touch, meters.
    contact_m: f64,
}

impl Candidates {
    /// Whether a part moves against a candidate no less simply, decisively, than against any other that it
    /// touches.
    fn as_simple(&self, candidate: &Candidate) -> bool {
        let touching = self.all.iter().filter(|c| c.gap_m < self.contact_m);
        candidate.excess < touching.map(|c| c.excess).fold(f64::INFINITY, f64::min) + DECISIVE
    }

    /// The candidates that touch a part and against which it moves no less simply, decisively, than against
    /// any other of them; where some of these turns run by both parts, as hinges do, only those.
    pub(crate) fn qualified(&self) -> Vec<&Candidate> {
        let simple: Vec<&Candidate> =
            self.all.iter().filter(|c| c.gap_m < self.contact_m && self.as_simple(c)).collect();
        let hinged: Vec<&Candidate> = simple.iter().copied().filter(|c| c.off_m < self.contact_m).collect();
        if hinged.is_empty() { simple } else { hinged }
    }

    /// Writes down what speaks against the parent of part number `part` and which others would do.
    pub(crate) fn explain(&self, joint: &mut JointEstimate, part: usize, parent: usize) {
        let all = if joint.positions.len() == 1 { "both" } else { "all" };
        let scores =
            self.all.iter().map(|c| (link_name(c.parent), ParentScore { excess: c.excess, gap_m: c.gap_m }));
        joint.evidence.parents.extend(scores);
        let qualified = self.qualified();
        let others: Vec<String> =
            qualified.iter().filter(|c| c.parent != parent).map(|c| link_name(c.parent)).collect();
        if !others.is_empty() {
            joint.evidence.not_observable.push(Note::new(
                NoteCode::ParentNotDecided,
                format!(
                    "the parent: {} would do as well as {}, which the shortest chain makes it",
                    others.join(" or "),
                    link_name(parent)
                ),
            ));
        }
        let base = self.all.iter().find(|c| c.parent == 0 && parent != 0 && self.as_simple(c));
        let against_base = base.map(|base| self.against_base(base, joint));
        joint.evidence.not_observable.extend(against_base);
        if self.all.len() > 1 && qualified.is_empty() {
            let name = link_name(part + 1);
            joint.evidence.cautions.push(Note::new(
                NoteCode::PartUntouched,
                format!("no part touches {name} in {all} states; it hangs on the static part"),
            ));
        }
    }

    /// Why a part whose motion against the static part is as simple does not hang on it.
    fn against_base(&self, base: &Candidate, joint: &JointEstimate) -> Note {
        let name = link_name(base.parent);
        let why = if base.gap_m < self.contact_m {
            "its axis would not run by both".to_owned()
        } else {
            format!("{name} is {:.0} mm away", 1e3 * base.gap_m)
        };
        let mut sentence = format!("the parent: the motion against {name} is as simple, but {why}");
        if joint.kind.turns() && base.joint.kind.turns() {
            let off_mm = 1e3 * (base.joint.point - joint.point).cross(&base.joint.axis).norm();
            sentence += &format!("; there the axis would lie {off_mm:.0} mm from here");
        }
        Note::new(NoteCode::ParentNotDecided, sentence)
    }
}

/// A part as another one's parent.
struct Body<'a> {
    /// Its surface in every state.
    surfaces: Vec<&'a SurfaceSamples>,
    indices: Vec<SampleIndex<'a>>,
    /// Its motion to every state behind state 0.
    motions: Vec<ParentMotion>,
}

impl<'a> Body<'a> {
    fn new(surfaces: Vec<&'a SurfaceSamples>, motions: impl Iterator<Item = Pose>, reach_m: f64) -> Self {
        // All candidates are judged by motions without a joint, whose errors are much alike.
        let certain = |state1_from_state0| ParentMotion { state1_from_state0, ..ParentMotion::still() };
        Self {
            indices: surfaces.iter().map(|s| SampleIndex::new(s, reach_m)).collect(),
            surfaces,
            motions: motions.map(certain).collect(),
        }
    }

    /// Distance from another part, the largest of all states, meters; at most the reach of the index.
    fn gap_m(&self, part: &Body) -> f64 {
        let in_state = |(part, own): (&&SurfaceSamples, &SampleIndex<'_>)| {
            part.points.iter().map(|p| own.distance_m(p)).fold(f64::INFINITY, f64::min)
        };
        part.surfaces.iter().zip(&self.indices).map(in_state).fold(0.0, f64::max)
    }
}

/// The parents that every part could have. `root` are the motions of the static part, `still` its surface in
/// every state; parts closer than `contact_m` touch.
pub(crate) fn candidates(
    root: &[ParentMotion],
    parts: &[PartEvidence],
    still: &[SurfaceSamples],
    contact_m: f64,
    config: &JointConfig,
) -> Vec<Candidates> {
    // Gaps need not be known beyond the contact; twice it leaves room for the report.
    let reach_m = 2.0 * contact_m;
    let base = Body::new(still.iter().collect(), root.iter().map(|m| m.state1_from_state0), reach_m);
    let moving =
        parts.iter().map(|p| Body::new(p.surfaces().collect(), p.pairs().map(|p| p.motion), reach_m));
    let bodies: Vec<Body> = std::iter::once(base).chain(moving).collect();
    let of_part = |k: usize| {
        let others = (0..bodies.len()).into_par_iter().filter(|&parent| parent != k + 1);
        let all = others.map(|parent| candidate(&parts[k], &bodies[k + 1], parent, &bodies[parent], config));
        Candidates { all: all.collect(), contact_m }
    };
    (0..parts.len()).into_par_iter().map(of_part).collect()
}

/// How well a part would hang on body number `parent`.
fn candidate(part: &PartEvidence, own: &Body, parent: usize, body: &Body, config: &JointConfig) -> Candidate {
    let joint = part.joint(&body.motions, JointChoice::default(), config);
    // A screw line beside the part is that of any motion: it makes no parent simple.
    let threaded = matches!(joint.kind, JointKind::Screw { .. });
    let excess = excess(&joint.evidence.type_scores, threaded);
    let off_m = if joint.kind == JointKind::Revolute {
        axis_off_m((&joint.point, &joint.axis), &own.surfaces[0].points, &body.surfaces[0].points)
    } else {
        0.0
    };
    Candidate { parent, excess, gap_m: body.gap_m(own), off_m, joint }
}
