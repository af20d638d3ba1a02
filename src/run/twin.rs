//! The stages that turn parts and motions into a model.

use nalgebra::Matrix6;
use rayon::prelude::*;

use super::{
    RunError,
    articulation::Articulation,
    state_surface::{Band, StateSurface},
    world_noise::world_covariance,
};
use crate::{
    articulate::{
        JointEstimate, LabelledState, LiftedMatch, NO_LABEL, ObservedState, ParentMotion, PartEvidence, TreeJointEstimate, kinematic_tree,
        label_grid, pair_of, part_tsdf, select, static_motion,
    },
    capture::{PoseNoise, RgbdFrame},
    config::Config,
    geometry::{NearestPoints, Pose, SceneBox},
    model::{ArticulatedModel, MovingPart, build},
    surface::{TriangleMesh, keep_components, marching_cubes},
};

/// What all states show.
pub(super) struct Seen<'a> {
    /// Frames of every state.
    pub frames: &'a [&'a [RgbdFrame]],
    /// Surface of every state.
    pub surfaces: &'a [StateSurface],
    /// Matches of state 0 with each other state.
    pub matches: &'a [Vec<LiftedMatch>],
    /// Which of the other states' frames were moved, coarsely so far.
    pub moved: &'a [bool],
    /// Covariance of a left perturbation of what stands still in each of these (translation 3, rotation 3), where all that stands
    /// still tells of it.
    pub still: &'a [Option<Matrix6<f64>>],
    /// Errors of the camera poses of state 0, where they were corrected.
    pub pose_noise: Option<PoseNoise>,
}

/// Joints of all moving parts, in the order of the parts. What is left of the static part's motion to states that were moved
/// is taken out of theirs.
pub(super) fn joints(seen: &Seen<'_>, articulation: &Articulation, scene: &SceneBox, config: &Config) -> Vec<TreeJointEstimate> {
    let state = |(s, surface): (usize, &StateSurface)| ObservedState {
        frames: seen.frames[s],
        samples: &seen.surfaces[s].samples,
        labels: &articulation.labels[s],
        sdf: &seen.surfaces[s].sdf,
        visible: &seen.surfaces[s].visible,
        area_m2: surface.mesh.area_m2(),
    };
    let states: Vec<ObservedState> = seen.surfaces.iter().enumerate().map(state).collect();
    let extent_m = scene.extent_m();
    let labelled = Labelled { nearest: NearestPoints::new(&seen.surfaces[0].samples.points), labels: &articulation.labels[0] };
    let reach_m = config.joint.refine.reach * extent_m;
    let owners: Vec<Vec<Option<usize>>> =
        seen.matches.iter().zip(&articulation.motions).map(|(m, motions)| match_owners(m, motions, &labelled, reach_m)).collect();
    let gather = |part: usize, k: usize| {
        let of_part = seen.matches[k].iter().zip(&owners[k]).filter(|(_, o)| **o == Some(part));
        let own: Vec<LiftedMatch> = of_part.map(|(m, _)| *m).collect();
        let (pair, start) = (pair_of(&states, k), &articulation.motions[k][part]);
        PartEvidence::gather(part as u8, start, &pair, &own, &config.capture.noise, extent_m, &config.joint)
    };
    let count = articulation.motions.first().map_or(1, Vec::len);
    let motions = 0..articulation.motions.len();
    let parts: Vec<Vec<PartEvidence>> = (1..count).map(|part| motions.clone().map(|k| gather(part, k)).collect()).collect();
    let root = |k: usize| {
        if !seen.moved[k] {
            return ParentMotion::still();
        }
        let own = gather(0, k).free_motion(&pair_of(&states, k), &config.joint);
        match seen.still[k] {
            Some(still) => static_motion(&own, &still),
            None => own,
        }
    };
    let root: Vec<ParentMotion> = motions.clone().map(root).collect();
    let still: Vec<_> = states.iter().map(|s| select(s.samples, s.labels, 0)).collect();
    let mut joints = kinematic_tree(&root, &parts, &still, &states, extent_m, &config.joint);
    if let Some(noise) = &seen.pose_noise {
        for joint in joints.iter_mut().map(|j| &mut j.joint) {
            joint.evidence.covariance += world_covariance(seen.frames[0], noise, &joint.axis, &joint.point);
        }
    }
    joints
}

/// Part of the surface of state 0.
struct Labelled<'a> {
    nearest: NearestPoints,
    labels: &'a [u8],
}

impl Labelled<'_> {
    fn part(&self, point: &nalgebra::Point3<f64>) -> Option<usize> {
        self.nearest.nearest(point).map(|(i, _)| usize::from(self.labels[i]))
    }
}

/// The motion that explains each match best, of equal ones that of the part whose surface it is on; `None` where none comes
/// within `reach_m`.
fn match_owners(matches: &[LiftedMatch], motions: &[Pose], surface: &Labelled<'_>, reach_m: f64) -> Vec<Option<usize>> {
    let alike = |a: usize| motions.iter().filter(|m| **m == motions[a]).count() > 1;
    let owner = |m: &LiftedMatch| {
        let error = |k: &usize| (motions[*k] * m.point0 - m.point1).norm();
        let best = (0..motions.len()).min_by(|a, b| error(a).total_cmp(&error(b))).filter(|k| error(k) < reach_m)?;
        let own = || surface.part(&m.point0).filter(|own| motions[*own] == motions[best]);
        Some(if alike(best) { own().unwrap_or(best) } else { best })
    };
    matches.iter().map(owner).collect()
}

/// The model: a surface for every part from all states, links, joints.
///
/// # Errors
/// A part without a surface.
pub(super) fn assemble(
    name: &str,
    surfaces: &[StateSurface],
    articulation: &Articulation,
    joints: Vec<TreeJointEstimate>,
    band: &Band,
    config: &Config,
) -> Result<ArticulatedModel, RunError> {
    let state = |(s, surface): (usize, &StateSurface)| {
        let labels = label_grid(&surface.tsdf, &surface.samples.points, &articulation.labels[s], 0.999 * band.truncation_m);
        LabelledState { tsdf: surface.tsdf.clone(), weight: surface.weight.clone(), labels, truncation_m: band.truncation_m }
    };
    let states: Vec<LabelledState> = surfaces.iter().enumerate().map(state).collect();
    let colors: Vec<ColorLookup> = surfaces.iter().map(ColorLookup::new).collect();
    let part_surface = |part: usize, motions: &[Pose]| {
        let motions: Vec<Pose> = std::iter::once(Pose::identity()).chain(motions.iter().copied()).collect();
        let field = part_tsdf(part as u8, &motions, &states);
        let mut mesh = keep_components(&marching_cubes(&field, 0.0), config.surface.min_component);
        if mesh.is_empty() {
            let message = format!("part {part} has no surface: nothing was seen of it; ask for fewer parts or record more views of it");
            return Err(RunError::stage("assemble", message));
        }
        paint(&mut mesh, &motions, &states, &colors);
        Ok((mesh, field))
    };
    let (base, _) = part_surface(0, &vec![Pose::identity(); surfaces.len() - 1])?;
    let mut parts = Vec::with_capacity(joints.len());
    for (i, TreeJointEstimate { parent, joint }) in joints.into_iter().enumerate() {
        let (surface, field) = part_surface(i + 1, &joint.motions)?;
        let JointEstimate { kind, axis, point, positions, evidence, .. } = joint;
        parts.push(MovingPart { parent, kind, axis, point, positions, evidence, surface, field: Some(field) });
    }
    let mut model = build(name, base, parts, &config.model);
    // Of an object of one part nothing else tells how often it was seen.
    model.states.resize_with(surfaces.len(), Vec::new);
    Ok(model)
}

/// Colors of a state's surface by nearest vertex.
struct ColorLookup<'a> {
    mesh: &'a TriangleMesh,
    vertices: NearestPoints,
}

impl<'a> ColorLookup<'a> {
    fn new(surface: &'a StateSurface) -> Self {
        let points: Vec<_> = surface.mesh.vertices.iter().map(|p| p.cast()).collect();
        Self { mesh: &surface.mesh, vertices: NearestPoints::new(&points) }
    }
}

/// Gives every vertex the color of the state that saw the place better.
fn paint(mesh: &mut TriangleMesh, motions: &[Pose], states: &[LabelledState], colors: &[ColorLookup]) {
    let color = |p: &nalgebra::Point3<f32>| {
        let place = |s: usize| if s == 0 { p.cast::<f64>() } else { motions[s] * p.cast::<f64>() };
        let seen = |s: usize| {
            states[s]
                .labels
                .nearest(&place(s))
                .map_or(0.0, |i| if states[s].labels.values[i] == NO_LABEL { 0.0 } else { states[s].weight.values[i] })
        };
        let (s, _) = (1..states.len()).map(|s| (s, seen(s))).fold((0, seen(0)), |a, b| if b.1 > a.1 { b } else { a });
        colors[s].vertices.nearest(&place(s)).and_then(|(i, _)| colors[s].mesh.colors.get(i)).copied().unwrap_or([128; 3])
    };
    mesh.colors = mesh.vertices.par_iter().with_min_len(1024).map(color).collect();
}
