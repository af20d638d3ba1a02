//! The stage that makes the model of parts and joints.

use nalgebra::Point3;
use rayon::prelude::*;

use super::{
    RunError,
    articulation::{Articulation, PartsOfState},
    scene::Scene,
    state::State,
    state_surface::StateSurface,
};
use crate::{
    articulate::{JointEstimate, LabelledState, NO_LABEL, TreeJointEstimate, label_grid, part_tsdf},
    geometry::{NearestPoints, Pose},
    model::{ArticulatedModel, MovingPart, build},
    surface::{TriangleMesh, keep_components, marching_cubes},
};

/// The model: a surface for every part from all states, links, joints.
///
/// # Errors
/// A part without a surface.
pub(super) fn assemble(
    name: &str,
    states: &[State],
    articulation: &Articulation,
    joints: Vec<TreeJointEstimate>,
    scene: &Scene,
) -> Result<ArticulatedModel, RunError> {
    let truncation_m = scene.band.truncation_m;
    let labelled = |(state, parts): (&State, &PartsOfState)| {
        let StateSurface { tsdf, weight, samples, .. } = &state.surface;
        // 0.999: at the truncation itself a node only says that it is farther than that.
        let labels = label_grid(tsdf, &samples.points, &parts.labels, 0.999 * truncation_m);
        LabelledState { tsdf: tsdf.clone(), weight: weight.clone(), labels, truncation_m }
    };
    let colors: Vec<ColorLookup> = states.iter().map(|s| ColorLookup::new(&s.surface)).collect();
    let states: Vec<LabelledState> = states.iter().zip(&articulation.states).map(labelled).collect();
    let part_surface = |part: usize, motions: &[Pose]| {
        let motions: Vec<Pose> = std::iter::once(Pose::identity()).chain(motions.iter().copied()).collect();
        // (9.1)
        let field = part_tsdf(part as u8, &motions, &states);
        let mut mesh = keep_components(&marching_cubes(&field, 0.0), scene.config.surface.min_component);
        if mesh.is_empty() {
            let message = format!(
                "part {part} has no surface: nothing was seen of it; ask for fewer parts or record more \
                 views of it"
            );
            return Err(RunError::stage("assemble", message));
        }
        paint(&mut mesh, &motions, &states, &colors);
        Ok((mesh, field))
    };
    // The static part in the world of state 0, then the moving ones by their joints' motions, which may
    // differ a little from those of registration.
    let (base, _) = part_surface(0, &vec![Pose::identity(); states.len() - 1])?;
    let mut parts = Vec::with_capacity(joints.len());
    for (i, TreeJointEstimate { parent, joint }) in joints.into_iter().enumerate() {
        let (surface, field) = part_surface(i + 1, &joint.motions)?;
        let JointEstimate { kind, axis, point, positions, evidence, .. } = joint;
        parts.push(MovingPart {
            parent,
            kind,
            axis,
            point,
            positions,
            evidence,
            surface,
            field: Some(field),
        });
    }
    let mut model = build(name, base, parts, &scene.config.model);
    // Of an object of one part nothing else says how often it was seen.
    model.states.resize_with(states.len(), Vec::new);
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

    fn color(&self, place: &Point3<f64>) -> Option<[u8; 3]> {
        self.vertices.nearest(place).and_then(|(i, _)| self.mesh.colors.get(i)).copied()
    }
}

/// How often and how well a state's views saw a place, by fusion's weight; 0 away from every surface.
fn seen(state: &LabelledState, place: &Point3<f64>) -> f32 {
    let node = state.labels.nearest(place).filter(|&i| state.labels.values[i] != NO_LABEL);
    node.map_or(0.0, |i| state.weight.values[i])
}

/// Gray where no state has a color.
const UNSEEN: [u8; 3] = [128; 3];

/// Gives every vertex the color of the state that saw the place better.
fn paint(mesh: &mut TriangleMesh, motions: &[Pose], states: &[LabelledState], colors: &[ColorLookup]) {
    let color = |p: &Point3<f32>| {
        let first = p.cast::<f64>();
        let places = states.iter().zip(colors).zip(motions.iter().map(|m| m * first));
        let seen = places.map(|((state, colors), place)| (seen(state, &place), place, colors));
        let best = seen.reduce(|a, b| if b.0 > a.0 { b } else { a });
        best.and_then(|(_, place, colors)| colors.color(&place)).unwrap_or(UNSEEN)
    };
    mesh.colors = mesh.vertices.par_iter().with_min_len(1024).map(color).collect();
}
