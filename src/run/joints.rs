//! The stage that finds the joints of parts that move.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{
    articulation::{Articulation, PartsOfState},
    scene::Scene,
    state::State,
};
use articulate::{
    JointInference, LiftedMatch, ObservedState, PairEvidence, ParentMotion, PartEvidence, SurfaceDraws,
    TreeJointEstimate, kinematic_tree, published_joint, static_motion,
};
use capture::PoseFindings;
use geometry::{NearestPoints, Pose};

/// Joints of all moving parts, in the order of the parts. What is left of the static part's motion to states
/// that were moved is taken out of theirs.
pub(super) fn joints(
    states: &[State],
    poses: &PoseFindings,
    articulation: &Articulation,
    scene: &Scene,
) -> Vec<TreeJointEstimate> {
    if scene.config.joint.inference == JointInference::Published {
        return published_joints(states, articulation);
    }
    let draws = |(k, s): (usize, &State)| {
        let spacing_m = s.surface.sdf.spacing_m;
        SurfaceDraws::new(&poses.draws, k, &s.surface.samples, s.frames, &scene.noise, spacing_m)
    };
    let draws: Vec<SurfaceDraws> = states.par_iter().enumerate().map(draws).collect();
    // Joints are those of the twin, whose frame is its static part: where that is off as a whole in state 0,
    // so is all that it carries.
    let labels = &articulation.states[0].labels;
    let base: Vec<usize> = (0..labels.len()).filter(|&i| labels[i] == 0).collect();
    let frame = draws[0].rigid_motions(&states[0].surface.samples.points, &base);
    let in_frame =
        |(draws, s): (SurfaceDraws, &State)| draws.without_motions(&frame, &s.surface.samples.points);
    let draws: Vec<SurfaceDraws> = draws.into_iter().zip(states).map(in_frame).collect();
    let evidence = Evidence::new(states, &draws, articulation, scene);
    let parts = (1..articulation.parts()).into_par_iter().filter_map(|part| evidence.part(part));
    let parts: Vec<PartEvidence> = parts.collect();
    // What the static part seems to move by is the error of the world
    // frames; joints against it are free of that.
    let root: Vec<ParentMotion> =
        (1..states.len()).into_par_iter().map(|state| evidence.root(state, &states[state], poses)).collect();
    let extent_m = scene.bounds.extent_m();
    kinematic_tree(&root, &parts, &evidence.states, extent_m, &scene.config.joint)
}

/// Joints of all moving parts by their motions to state 1 alone, each on the static part.
fn published_joints(states: &[State], articulation: &Articulation) -> Vec<TreeJointEstimate> {
    let points = &states[0].surface.samples.points;
    let middle = |part: usize| {
        let labels = articulation.states[0].labels.iter();
        let own = points.iter().zip(labels).filter(|(_, l)| usize::from(**l) == part).map(|(p, _)| p.coords);
        let (sum, count) = own.fold((Vector3::zeros(), 0.0), |(sum, count), p| (sum + p, count + 1.0));
        Point3::from(sum / f64::max(count, 1.0))
    };
    let motions = articulation.states[1].motions.iter().enumerate().skip(1);
    motions.map(|(part, motion)| published_joint(motion, &middle(part))).collect()
}

/// What all states show, by part.
struct Evidence<'a> {
    scene: &'a Scene<'a>,
    articulation: &'a Articulation,
    states: Vec<ObservedState<'a>>,
    /// Matches of each state with state 0, each with the part that it is on.
    matches: Vec<Vec<(LiftedMatch, Option<usize>)>>,
}

impl<'a> Evidence<'a> {
    fn new(
        states: &'a [State],
        draws: &'a [SurfaceDraws],
        articulation: &'a Articulation,
        scene: &'a Scene,
    ) -> Self {
        let parts = &articulation.states;
        let labelled = Labelled {
            nearest: NearestPoints::new(&states[0].surface.samples.points),
            labels: &parts[0].labels,
        };
        let reach_m = scene.config.joint.refine.reach * scene.bounds.extent_m();
        let owned = |(state, parts): (&State, &PartsOfState)| -> Vec<(LiftedMatch, Option<usize>)> {
            let owners = match_owners(&state.matches, &parts.motions, &labelled, reach_m);
            state.matches.iter().copied().zip(owners).collect()
        };
        Self {
            scene,
            articulation,
            states: states
                .iter()
                .zip(draws)
                .zip(parts)
                .map(|((s, draws), parts)| s.observed(&parts.labels, draws))
                .collect(),
            matches: states.iter().zip(parts).map(owned).collect(),
        }
    }

    /// What state 0 and number `state` show of a part.
    fn pair(&self, part: usize, state: usize) -> PairEvidence<'a> {
        let of_part = self.matches[state].iter().filter(|(_, owner)| *owner == Some(part));
        let matches: Vec<LiftedMatch> = of_part.map(|(m, _)| *m).collect();
        PairEvidence::gather(
            part as u8,
            &self.articulation.states[state].motions[part],
            [self.states[0], self.states[state]],
            &matches,
            &self.scene.noise,
            self.scene.bounds.extent_m(),
            &self.scene.config.joint,
        )
    }

    /// What all states show of a part; `None` of a single state.
    fn part(&self, part: usize) -> Option<PartEvidence<'a>> {
        PartEvidence::new((1..self.states.len()).map(|state| self.pair(part, state)))
    }

    /// The motion of the static part to number `state`: none, unless that state's frames were moved, which
    /// leaves it a world frame that is a little its own.
    fn root(&self, number: usize, state: &State, poses: &PoseFindings) -> ParentMotion {
        if state.drift.is_none() && !poses.has_changes() {
            return ParentMotion::static_part();
        }
        let own = self.pair(0, number).free_motion(&self.scene.config.joint);
        // How well all that stands still was brought to rest in the state.
        // (5.3) combines this with the part's own motion.
        let still = match &state.drift {
            Some(drift) => drift.covariance,
            None => poses.worlds.get(number - 1).and_then(|w| w.as_ref()?.covariance),
        };
        match still {
            Some(still) => static_motion(&own, &still),
            None => own,
        }
    }
}

/// Part of the surface of state 0.
struct Labelled<'a> {
    nearest: NearestPoints,
    labels: &'a [u8],
}

impl Labelled<'_> {
    fn part(&self, point: &nalgebra::Point3<f64>) -> Option<usize> {
        self.nearest.nearest_one(point).map(|(i, _)| usize::from(self.labels[i]))
    }
}

/// The motion that explains each match best, of equal ones that of the part whose surface it is on; `None`
/// where none comes within `reach_m`.
fn match_owners(
    matches: &[LiftedMatch],
    motions: &[Pose],
    surface: &Labelled<'_>,
    reach_m: f64,
) -> Vec<Option<usize>> {
    matches.iter().map(|m| match_owner(m, motions, surface, reach_m)).collect()
}

fn match_owner(m: &LiftedMatch, motions: &[Pose], surface: &Labelled<'_>, reach_m: f64) -> Option<usize> {
    let errors_m: Vec<f64> = motions.iter().map(|motion| (motion * m.point0 - m.point1).norm()).collect();
    // By the motion, not by the place: at the border of two parts the nearest sample may be the other's.
    let best = (0..motions.len()).min_by(|&a, &b| errors_m[a].total_cmp(&errors_m[b]))?;
    if errors_m[best] >= reach_m {
        return None;
    }
    // Parts may move alike in a pair of states; the match is then that of the part which it lies on.
    if motions.iter().filter(|motion| **motion == motions[best]).count() == 1 {
        return Some(best);
    }
    let own = surface.part(&m.point0).filter(|own| motions[*own] == motions[best]);
    own.or(Some(best))
}
