//! The stage that finds the joints of moving parts.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{articulation::Articulation, scene::Scene, state::State};
use articulate::{
    JOINT_REACH, JointInference, LiftedMatch, ObservedState, PairEvidence, ParentMotion, PartEvidence,
    SurfaceDraws, TreeJointEstimate, kinematic_tree, published_joint, static_motion,
};
use capture::PoseFindings;
use geometry::{NearestPoints, Pose};

/// Joints of all moving parts, in the order of the parts. The remaining motion of the static part in moved
/// states is removed from theirs.
pub(super) fn joints(
    states: &[State],
    poses: &PoseFindings,
    articulation: &Articulation,
    scene: &Scene,
) -> Vec<TreeJointEstimate> {
    if scene.config.joint.inference == JointInference::Published {
        return published_joints(states, articulation);
    }
    let draws: Vec<SurfaceDraws> = states
        .par_iter()
        .enumerate()
        .map(|(k, s)| {
            let spacing_m = s.surface.sdf.spacing_m;
            SurfaceDraws::new(&poses.draws, k, &s.surface.samples, s.frames, &scene.noise, spacing_m)
        })
        .collect();
    // The static part is the frame of the twin and of its joints: an error of the static part as a whole in
    // state 0 shifts all other parts.
    let labels = &articulation.states[0].labels;
    let base: Vec<usize> = (0..labels.len()).filter(|&i| labels[i] == 0).collect();
    let frame = draws[0].rigid_motions(&states[0].surface.samples.points, &base);
    let draws: Vec<SurfaceDraws> = draws
        .into_iter()
        .zip(states)
        .map(|(draws, s)| draws.without_motions(&frame, &s.surface.samples.points))
        .collect();
    let evidence = Evidence::new(states, &draws, articulation, scene);
    let parts = (1..articulation.parts()).into_par_iter().filter_map(|part| evidence.part(part));
    let parts: Vec<PartEvidence> = parts.collect();
    // The apparent motion of the static part is the error of the world frames; joints relative to it are free
    // of this error.
    let root: Vec<ParentMotion> =
        (1..states.len()).into_par_iter().map(|state| evidence.root(state, &states[state], poses)).collect();
    let extent_m = scene.bounds.extent_m();
    kinematic_tree(&root, &parts, &evidence.states, extent_m, &scene.config.joint)
}

/// Joints of all moving parts by their motions to state 1 alone, each on the static part.
fn published_joints(states: &[State], articulation: &Articulation) -> Vec<TreeJointEstimate> {
    let points = &states[0].surface.samples.points;
    let labels = &articulation.states[0].labels;
    let motions = articulation.states[1].motions.iter().enumerate().skip(1);
    motions.map(|(part, motion)| published_joint(motion, &mean_of_part(points, labels, part))).collect()
}

/// Mean of the surface samples of a part, meters.
fn mean_of_part(points: &[Point3<f64>], labels: &[u8], part: usize) -> Point3<f64> {
    let own = points.iter().zip(labels).filter(|(_, l)| usize::from(**l) == part).map(|(p, _)| p.coords);
    let (sum, count) = own.fold((Vector3::zeros(), 0.0), |(sum, count), p| (sum + p, count + 1.0));
    Point3::from(sum / f64::max(count, 1.0))
}

/// Evidence of all states, by part.
struct Evidence<'a> {
    scene: &'a Scene<'a>,
    articulation: &'a Articulation,
    states: Vec<ObservedState<'a>>,
    /// Matches of each state with state 0, each with its part.
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
        let reach_m = JOINT_REACH * scene.bounds.extent_m();
        let mut matches = Vec::with_capacity(states.len());
        for (state, parts) in states.iter().zip(parts) {
            let owners = match_owners(&state.matches, &parts.motions, &labelled, reach_m);
            matches.push(state.matches.iter().copied().zip(owners).collect());
        }
        Self {
            scene,
            articulation,
            states: states
                .iter()
                .zip(draws)
                .zip(parts)
                .map(|((s, draws), parts)| s.observed(&parts.labels, draws))
                .collect(),
            matches,
        }
    }

    /// Evidence for a part from state 0 and state number `state`.
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
        )
    }

    /// Evidence for a part from all states; `None` with a single state.
    fn part(&self, part: usize) -> Option<PartEvidence<'a>> {
        PartEvidence::new((1..self.states.len()).map(|state| self.pair(part, state)))
    }

    /// The motion of the static part to state `number`: zero, unless the frames of this state were moved, as
    /// their world frame then differs slightly.
    fn root(&self, number: usize, state: &State, poses: &PoseFindings) -> ParentMotion {
        if state.drift.is_none() && !poses.has_changes() {
            return ParentMotion::static_part();
        }
        let own = self.pair(0, number).free_motion();
        // Uncertainty of the alignment of still surfaces in the state.
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

/// The motion closest to each match and, of equal ones, that of the part under it; `None` if none comes
/// within `reach_m`.
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
    // Parts may share a motion in a pair of states; the match then belongs to the part under it.
    if motions.iter().filter(|motion| **motion == motions[best]).count() == 1 {
        return Some(best);
    }
    let own = surface.part(&m.point0).filter(|own| motions[*own] == motions[best]);
    own.or(Some(best))
}
