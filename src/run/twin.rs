//! The stages that turn parts and motions into a model.

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
        label_grid, part_tsdf, select,
    },
    capture::{PoseNoise, RgbdFrame},
    config::Config,
    geometry::{NearestPoints, Pose, SceneBox},
    model::{ArticulatedModel, MovingPart, build},
    surface::{TriangleMesh, keep_components, marching_cubes},
};

/// Joints of all moving parts, in the order of the parts. Where the states' frames were `moved`, coarsely so far, what is left
/// of the static part's motion is taken out of theirs. `pose_noise`: errors of the camera poses, where they were corrected.
pub(super) fn joints(
    frames: [&[RgbdFrame]; 2],
    surfaces: [&StateSurface; 2],
    articulation: &Articulation,
    matches: &[LiftedMatch],
    scene: &SceneBox,
    (moved, pose_noise): (bool, Option<PoseNoise>),
    config: &Config,
) -> Vec<TreeJointEstimate> {
    let states = [0, 1].map(|s| ObservedState {
        frames: frames[s],
        samples: &surfaces[s].samples,
        labels: &articulation.labels[s],
        sdf: &surfaces[s].sdf,
        visible: &surfaces[s].visible,
        area_m2: surfaces[s].mesh.area_m2(),
    });
    let extent_m = scene.extent_m();
    let owners = match_owners(matches, &articulation.motions, config.joint.refine.reach * extent_m);
    let gather = |part: usize| {
        let own: Vec<LiftedMatch> = matches.iter().zip(&owners).filter(|(_, o)| **o == Some(part)).map(|(m, _)| *m).collect();
        PartEvidence::gather(part as u8, &articulation.motions[part], &states, &own, &config.capture.noise, extent_m, &config.joint)
    };
    let parts: Vec<PartEvidence> = (1..articulation.motions.len()).map(gather).collect();
    let root = if moved { gather(0).free_motion(&states, &config.joint) } else { ParentMotion::still() };
    let still = [0, 1].map(|s| select(states[s].samples, states[s].labels, 0));
    let mut joints = kinematic_tree(&root, &parts, &still, &states, extent_m, &config.joint);
    if let Some(noise) = pose_noise {
        for joint in joints.iter_mut().map(|j| &mut j.joint) {
            joint.evidence.covariance += world_covariance(frames[0], &noise, &joint.axis, &joint.point);
        }
    }
    joints
}

/// The motion that explains each match best; `None` where none comes within `reach_m`.
fn match_owners(matches: &[LiftedMatch], motions: &[Pose], reach_m: f64) -> Vec<Option<usize>> {
    let owner = |m: &LiftedMatch| {
        let error = |k: &usize| (motions[*k] * m.point0 - m.point1).norm();
        (0..motions.len()).min_by(|a, b| error(a).total_cmp(&error(b))).filter(|k| error(k) < reach_m)
    };
    matches.iter().map(owner).collect()
}

/// The model: a surface for every part from both states, links, joints.
///
/// # Errors
/// A part without a surface.
pub(super) fn assemble(
    name: &str,
    surfaces: [&StateSurface; 2],
    articulation: &Articulation,
    joints: Vec<TreeJointEstimate>,
    band: &Band,
    config: &Config,
) -> Result<ArticulatedModel, RunError> {
    let states = [0, 1].map(|s| {
        let surface = surfaces[s];
        let labels = label_grid(&surface.tsdf, &surface.samples.points, &articulation.labels[s], 0.999 * band.truncation_m);
        LabelledState { tsdf: surface.tsdf.clone(), weight: surface.weight.clone(), labels, truncation_m: band.truncation_m }
    });
    let colors = [0, 1].map(|s| ColorLookup::new(surfaces[s]));
    let part_surface = |part: usize, motion: &Pose| {
        let field = part_tsdf(part as u8, motion, &states);
        let mut mesh = keep_components(&marching_cubes(&field, 0.0), config.surface.min_component);
        if mesh.is_empty() {
            let message = format!("part {part} has no surface: nothing was seen of it; ask for fewer parts or record more views of it");
            return Err(RunError::stage("assemble", message));
        }
        paint(&mut mesh, motion, &states, &colors);
        Ok((mesh, field))
    };
    let (base, _) = part_surface(0, &Pose::identity())?;
    let mut parts = Vec::with_capacity(joints.len());
    for (i, TreeJointEstimate { parent, joint }) in joints.into_iter().enumerate() {
        let (surface, field) = part_surface(i + 1, &joint.state1_from_state0)?;
        let JointEstimate { kind, axis, point, motion, evidence, .. } = joint;
        parts.push(MovingPart { parent, kind, axis, point, motion, evidence, surface, field: Some(field) });
    }
    Ok(build(name, base, parts, &config.model))
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
fn paint(mesh: &mut TriangleMesh, motion: &Pose, states: &[LabelledState; 2], colors: &[ColorLookup; 2]) {
    let color = |p: &nalgebra::Point3<f32>| {
        let places = [p.cast::<f64>(), motion * p.cast::<f64>()];
        let seen = |s: usize| {
            states[s]
                .labels
                .nearest(&places[s])
                .map_or(0.0, |i| if states[s].labels.values[i] == NO_LABEL { 0.0 } else { states[s].weight.values[i] })
        };
        let s = usize::from(seen(1) > seen(0));
        colors[s].vertices.nearest(&places[s]).and_then(|(i, _)| colors[s].mesh.colors.get(i)).copied().unwrap_or([128; 3])
    };
    mesh.colors = mesh.vertices.par_iter().with_min_len(1024).map(color).collect();
}
