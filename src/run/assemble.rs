//! The stage `assemble`: builds the model from parts and joints.

use nalgebra::Point3;
use rayon::prelude::*;
use tracing::debug;

use super::{
    RunError,
    articulation::{Articulation, PartsOfState},
    scene::Scene,
    state::State,
    state_surface::StateSurface,
};
use articulate::{JointEstimate, LabelledState, NO_LABEL, TreeJointEstimate, label_grid, part_tsdf};
use geometry::{Grid3, NearestPoints, Pose};
use model::{ArticulatedModel, MovingPart, build_model};
use surface::{DepthView, Mended, Readings, TriangleMesh, keep_components, marching_cubes, mend_borders};

/// Builds the model: a surface for every part from all states without their `left_out` samples, links,
/// joints.
///
/// # Errors
/// A part without a surface.
pub(super) fn assemble(
    name: &str,
    states: &[State],
    articulation: &Articulation,
    left_out: &[Vec<bool>],
    joints: Vec<TreeJointEstimate>,
    scene: &Scene,
) -> Result<ArticulatedModel, RunError> {
    let truncation_m = scene.band.truncation_m;
    let colors: Vec<ColorLookup> = states.iter().map(|s| ColorLookup::new(&s.surface)).collect();
    let labelled: Vec<LabelledState> = states
        .iter()
        .zip(&articulation.states)
        .zip(left_out)
        .map(|((state, parts), left_out)| labelled_state(state, parts, left_out, truncation_m))
        .collect();
    let evidence = SurfaceEvidence { states, labelled: &labelled, colors: &colors, scene };
    // The static part in the world of state 0, then the moving ones by their joints' motions, which may
    // differ slightly from those of registration.
    let still = vec![Pose::identity(); states.len() - 1];
    let (base, surfaces) = rayon::join(
        || evidence.part_surface(0, &still),
        || {
            let moving = joints.par_iter().enumerate();
            moving.map(|(i, tree)| evidence.part_surface(i + 1, &tree.joint.motions)).collect::<Vec<_>>()
        },
    );
    let base = base?;
    let mut assumed = vec![base.assumed_m2];
    let mut parts = Vec::with_capacity(joints.len());
    for (surface, TreeJointEstimate { parent, joint }) in surfaces.into_iter().zip(joints) {
        let PartSurface { mesh: surface, assumed_m2, field } = surface?;
        assumed.push(assumed_m2);
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
    let mut model = build_model(name, base.mesh, parts, &scene.config.model);
    for (link, assumed_m2) in model.links.iter_mut().zip(assumed) {
        link.assumed_m2 = assumed_m2;
    }
    // A model of one part has no joint positions that show its number of states.
    model.states.resize_with(states.len(), Vec::new);
    Ok(model)
}

/// A state with the part labels of its surface samples transferred to the nodes of its grid.
fn labelled_state(
    state: &State,
    parts: &PartsOfState,
    left_out: &[bool],
    truncation_m: f64,
) -> LabelledState {
    let StateSurface { tsdf, weight, samples, .. } = &state.surface;
    let labels: Vec<u8> =
        parts.labels.iter().zip(left_out).map(|(l, out)| if *out { NO_LABEL } else { *l }).collect();
    // 0.999: at the truncation distance itself a value is only a lower bound.
    let labels = label_grid(tsdf, &samples.points, &labels, 0.999 * truncation_m);
    LabelledState::new(tsdf.clone(), weight.clone(), labels, truncation_m)
}

/// All states, as evidence for the surfaces of parts.
struct SurfaceEvidence<'a> {
    states: &'a [State<'a>],
    labelled: &'a [LabelledState],
    colors: &'a [ColorLookup<'a>],
    scene: &'a Scene<'a>,
}

/// The surface of one part in state 0.
struct PartSurface {
    mesh: TriangleMesh,
    /// Area of mended holes, square meters.
    assumed_m2: f64,
    /// Signed distance to the surface, meters.
    field: Grid3<f32>,
}

impl SurfaceEvidence<'_> {
    /// The colored surface of a part with `motions` from state 0 to the others.
    ///
    /// # Errors
    /// A part without a surface.
    fn part_surface(&self, part: usize, motions: &[Pose]) -> Result<PartSurface, RunError> {
        let motions: Vec<Pose> = std::iter::once(Pose::identity()).chain(motions.iter().copied()).collect();
        // (9.1)
        let field = part_tsdf(part as u8, &motions, self.labelled);
        let raw = keep_components(&marching_cubes(&field, 0.0), self.scene.config.surface.min_component);
        let fused = raw.triangles.len();
        let Mended { mut mesh, assumed_m2, .. } = mended(raw, &field, &motions, self.states, self.scene);
        debug!(part, triangles = fused, mended = mesh.triangles.len(), assumed_m2, "surface of a part");
        if mesh.is_empty() {
            let message = format!(
                "part {part} has no surface: nothing was seen of it; ask for fewer parts or record more \
                 views of it"
            );
            return Err(RunError::stage("assemble", message));
        }
        paint(&mut mesh, &motions, self.labelled, self.colors);
        Ok(PartSurface { mesh, assumed_m2, field })
    }
}

/// A part's mesh with mended borders (docs/method.md 9.1), if the settings ask for it.
fn mended(
    mesh: TriangleMesh,
    field: &Grid3<f32>,
    motions: &[Pose],
    states: &[State],
    scene: &Scene,
) -> Mended {
    let config = &scene.config.surface;
    if !config.mend_borders {
        return Mended { mesh, holes: 0, assumed_m2: 0.0 };
    }
    let far_m = 0.5 * scene.band.truncation_m as f32;
    let free: Vec<&Grid3<bool>> = states.iter().map(|s| &s.surface.free).collect();
    let is_seen_empty = |p: &Point3<f64>| is_seen_empty(p, field, far_m, motions, &free);
    let mut views = Vec::new();
    for (state, (observed, motion)) in states.iter().zip(motions).enumerate() {
        let frames = observed.frames.iter();
        views.extend(frames.map(|frame| DepthView { frame, world_from_mesh: *motion, state }));
    }
    let readings = Readings { views: &views, noise: scene.noise, is_seen_empty: &is_seen_empty };
    mend_borders(&mesh, field.spacing_m, config.close_holes, &readings)
}

/// Whether views saw no surface of a part at a place: all nodes around it are certainly empty in some state,
/// or the part's field is beyond `far_m` at all of them, as where another part is.
fn is_seen_empty(
    place: &Point3<f64>,
    field: &Grid3<f32>,
    far_m: f32,
    motions: &[Pose],
    free: &[&Grid3<bool>],
) -> bool {
    field.all_around(place, |m| *m > far_m)
        || motions.iter().zip(free).any(|(motion, free)| free.holds_around(&(motion * place)))
}

/// Looks up the color of a state's surface at the nearest vertex.
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
        self.vertices.nearest_one(place).and_then(|(i, _)| self.mesh.colors.get(i)).copied()
    }
}

/// How often and how well a state's views saw a place, as fusion weight; 0 away from every surface.
fn seen(state: &LabelledState, place: &Point3<f64>) -> f32 {
    let node = state.labels.nearest_node(place).filter(|&i| state.labels.values[i] != NO_LABEL);
    node.map_or(0.0, |i| state.weight.values[i])
}

/// Gray where no state has a color.
const UNSEEN: [u8; 3] = [128; 3];

/// Gives every vertex the color from the state that saw it best.
fn paint(mesh: &mut TriangleMesh, motions: &[Pose], states: &[LabelledState], colors: &[ColorLookup]) {
    let vertices = mesh.vertices.par_iter().with_min_len(1024);
    mesh.colors = vertices.map(|p| best_seen_color(&p.cast(), motions, states, colors)).collect();
}

/// Color of a place of state 0, from the state that saw it best.
fn best_seen_color(
    first: &Point3<f64>,
    motions: &[Pose],
    states: &[LabelledState],
    colors: &[ColorLookup],
) -> [u8; 3] {
    let places = states.iter().zip(colors).zip(motions.iter().map(|m| m * first));
    let seen = places.map(|((state, colors), place)| (seen(state, &place), place, colors));
    let best = seen.reduce(|a, b| if b.0 > a.0 { b } else { a });
    best.and_then(|(_, place, colors)| colors.color(&place)).unwrap_or(UNSEEN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::SceneBox;

    #[test]
    fn a_place_is_empty_where_a_state_saw_it_or_the_field_is_far() {
        let scene = SceneBox::around_box(&Point3::new(-0.5, -0.5, -0.5), &Point3::new(0.5, 0.5, 0.5));
        let mut field = Grid3::over_scene(&scene, 41, f32::NAN);
        let mut still = Grid3::over_scene(&scene, 41, false);
        let mut moved = Grid3::over_scene(&scene, 41, false);
        for i in 0..field.values.len() {
            let p = field.position_of_index(i);
            if p.x > 0.2 {
                field.values[i] = (0.3 - p.y) as f32;
            }
            still.values[i] = p.x < -0.2;
            // Seen empty where the part stands after its motion of 0.3 along z.
            moved.values[i] = p.z > 0.2 && p.y < -0.2;
        }
        let motions = [Pose::identity(), Pose::translation(0.0, 0.0, 0.3)];
        let is_empty =
            |x, y, z| is_seen_empty(&Point3::new(x, y, z), &field, 0.05, &motions, &[&still, &moved]);
        assert!(!is_empty(0.0, 0.0, 0.0), "nobody saw anything there");
        assert!(is_empty(-0.4, 0.0, 0.0), "free in state 0");
        assert!(is_empty(0.0, -0.4, 0.0) && !is_empty(0.0, -0.4, -0.2), "free in state 1, or not");
        assert!(is_empty(0.4, 0.0, 0.0) && !is_empty(0.4, 0.28, 0.0), "far from the surface, or at it");
    }
}
