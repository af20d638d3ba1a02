//! Builds links in a tree from joints and part surfaces.

use nalgebra::Translation3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    ArticulatedModel, Inertial, Joint, JointDynamics, JointEvidence, JointKind, Limit, LimitSource, Link,
    Material, assumed_dynamics, clear_paths, grasps_of_joint, seat_of_joint, swept_interval,
};
use geometry::{Grid3, Pose};
use surface::{ConvexConfig, Hidden, ShellInertia, TriangleMesh, Walls, few_triangles, merged_mesh};

/// Settings of the model, and assumptions that no camera can measure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelConfig {
    /// Material of the object; gives the density and its range.
    pub material: Material,
    /// Materials of single parts, in the order of the parts, the static one first; parts beyond the list are
    /// of `material`.
    pub part_materials: Vec<Material>,
    /// Density of the walls, kg/m^3; null means the material's.
    pub density_kg_m3: Option<f64>,
    /// Thickness assumed for walls whose other side was not seen, meters.
    pub wall_thickness_m: f64,
    /// Whether unseen walls are displayed, as separate meshes.
    pub draw_assumed: bool,
    /// Largest joint effort, N m or N.
    pub effort: f64,
    /// Largest joint speed, rad/s or m/s.
    pub velocity: f64,
    /// How joint limits are set.
    pub limits: LimitPolicy,
    /// Collision solids.
    pub collision: ConvexConfig,
}

/// Margin of a limit around the observed positions, in standard deviations of these.
/// chosen: 95 % of a normal distribution
const MARGIN_STD: f64 = 2.0;
/// Least margin of a limit, as a share of the observed motion: exactly at a limit, solvers push.
/// chosen: too little to be seen
const LEAST_MARGIN_SHARE: f64 = 0.005;

/// How joint limits are set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LimitPolicy {
    /// The observed interval with a margin, and the closed end where a face meets its seat.
    #[default]
    Seated,
    /// The observed interval: the inner bound.
    Observed,
    /// The collision-free interval: the outer bound.
    Swept,
}

impl Default for ModelConfig {
    fn default() -> Self {
        Self {
            material: Material::default(),
            part_materials: Vec::new(),
            density_kg_m3: None,
            wall_thickness_m: 0.008,
            draw_assumed: true,
            effort: 100.0,
            velocity: 2.0,
            limits: LimitPolicy::default(),
            collision: ConvexConfig::default(),
        }
    }
}

impl ModelConfig {
    /// Density of a part in kg/m^3 (usual, lowest, highest), and a few words on its origin.
    fn density_of_part(&self, part: usize) -> ([f64; 3], String) {
        let material = self.part_materials.get(part).copied().unwrap_or(self.material);
        match self.density_kg_m3 {
            Some(d) => ([d; 3], format!("{d} kg/m^3 (given)")),
            None => (
                material.density_kg_m3(),
                format!("{} kg/m^3 ({}, assumed)", material.density_kg_m3()[0], material.name()),
            ),
        }
    }
}

/// Name of the link of a part; 0 is the static one.
pub fn link_name(part: usize) -> String {
    if part == 0 { "base".to_owned() } else { format!("part_{part}") }
}

/// A moving part: its joint and its surface, as they are in state 0 in the world.
pub struct MovingPart {
    /// Its parent: 0 is the static part, k the k-th moving part. Parents form a tree.
    pub parent: usize,
    /// Type of the joint.
    pub kind: JointKind,
    /// Unit axis, world.
    pub axis: nalgebra::Unit<nalgebra::Vector3<f64>>,
    /// Point of the axis, world, meters; becomes the link's origin.
    pub point: nalgebra::Point3<f64>,
    /// Position in every state after state 0, where it is 0, radians or meters; the one farthest from 0 is
    /// positive.
    pub positions: Vec<f64>,
    /// The evidence for the joint.
    pub evidence: JointEvidence,
    /// Surface in the world in state 0.
    pub surface: TriangleMesh,
    /// Signed distance around it in the world in state 0, NaN where no view saw anything; `None` if
    /// everything was seen.
    pub field: Option<Grid3<f32>>,
}

/// Builds the model: the moving parts in a tree from the static one. Position 0 is state 0. Collision solids
/// follow the surfaces and leave the paths within the limits free; masses come from the surfaces; the limits
/// follow the policy. Grasps are found last, from solids and limits.
pub fn build_model(
    name: &str,
    base: TriangleMesh,
    mut parts: Vec<MovingPart>,
    config: &ModelConfig,
) -> ArticulatedModel {
    // Only for moving parts: a moving part may need space that the static one hides.
    let fields: Vec<_> = std::iter::once(None)
        .chain(parts.iter_mut().map(|p| p.field.take().map(|f| (f, p.point.coords))))
        .collect();
    let mut model = tree_of_parts(name, base, parts, config);
    let hidden: Vec<_> =
        fields.iter().map(|f| f.as_ref().map(|(f, origin)| unseen_places(f, origin))).collect();
    let hidden: Vec<_> = hidden.iter().map(|h| h.as_ref().map(|h| h as Hidden<'_>)).collect();
    let walls = walls_of_links(&model, &hidden, config);
    for (i, walls) in walls.into_iter().enumerate() {
        model.links[i].collision = walls.convex_solids();
        if config.draw_assumed {
            model.links[i].assumed = walls.assumed_faces().clone();
        }
        model.links[i].inertial = wall_inertial(&model.links[i], &walls, i, config);
    }
    let gap_m = config.collision.gap_m;
    let seats: Vec<_> =
        (0..model.joints.len()).into_par_iter().map(|j| seat_of_joint(&model, j, gap_m)).collect();
    for (j, seat) in seats.into_iter().enumerate() {
        model.joints[j].limit.closed = seat;
        if config.limits == LimitPolicy::Seated {
            set_seated_limit(&mut model, j);
        }
    }
    // Before the sweep, which any contact at rest would end at once.
    clear_paths(&mut model, &config.collision);
    let swept: Vec<[f64; 2]> =
        (0..model.joints.len()).into_par_iter().map(|j| swept_interval(&model, j)).collect();
    for (j, swept) in swept.into_iter().enumerate() {
        let limit = &mut model.joints[j].limit;
        limit.swept = Some(swept);
        if config.limits == LimitPolicy::Swept {
            ([limit.lower, limit.upper], limit.source) = (swept, LimitSource::Swept);
        }
        model.joints[j].dynamics = assumed_dynamics(&model, j);
    }
    let found: Vec<_> = (0..model.joints.len()).into_par_iter().map(|j| grasps_of_joint(&model, j)).collect();
    for (j, found) in found.into_iter().enumerate() {
        model.links[model.joints[j].child].grasps = found;
    }
    model
}

/// Whether a place in a link's frame, meters, is unseen. The field is in the world, where the frame has the
/// given origin.
fn unseen_places(
    field: &Grid3<f32>,
    origin: &nalgebra::Vector3<f64>,
) -> impl Fn(&nalgebra::Point3<f64>) -> bool + Sync {
    move |p| field.nearest_node(&(p + origin)).is_some_and(|i| field.values[i].is_nan())
}

/// Sets limits at the observed interval plus a margin; at the closed end the seat is the limit.
fn set_seated_limit(model: &mut ArticulatedModel, j: usize) {
    let [lower, upper] = model.observed_interval(j);
    let joint = &mut model.joints[j];
    let std = joint.evidence.position_std.iter().copied().filter(|s| s.is_finite()).fold(0.0, f64::max);
    let margin = (MARGIN_STD * std).max(LEAST_MARGIN_SHARE * (upper - lower));
    let limit = &mut joint.limit;
    (limit.lower, limit.upper, limit.source) = (lower - margin, upper + margin, LimitSource::Seated);
    match limit.closed {
        // An observed position is always within the limits, even if the seat is a little short of it.
        Some(seat) if seat.above => limit.upper = seat.position.max(upper),
        Some(seat) => limit.lower = seat.position.min(lower),
        None => {}
    }
}

/// The walls of every link, including their unseen parts.
fn walls_of_links(
    model: &ArticulatedModel,
    hidden: &[Option<Hidden<'_>>],
    config: &ModelConfig,
) -> Vec<Walls> {
    let few: Vec<TriangleMesh> =
        model.links.par_iter().map(|l| few_triangles(&l.visual, &config.collision)).collect();
    let walls = (0..few.len()).into_par_iter().map(|i| {
        let others = others_in_all_states(model, &few, i);
        Walls::behind_surface(&few[i], &others, config.wall_thickness_m, hidden[i], &config.collision)
    });
    walls.collect()
}

/// The surfaces of all other links in the frame of a link, over all states.
fn others_in_all_states(model: &ArticulatedModel, surfaces: &[TriangleMesh], link: usize) -> TriangleMesh {
    let mut others = Vec::new();
    for state in &model.states {
        let link_from_world = model.world_from_link(link, state).inverse();
        for k in (0..surfaces.len()).filter(|&k| k != link) {
            others.push(surfaces[k].transformed(&(link_from_world * model.world_from_link(k, state))));
        }
    }
    merged_mesh(&others.iter().collect::<Vec<_>>())
}

fn translation(v: nalgebra::Vector3<f64>) -> Pose {
    Pose::from_parts(Translation3::from(v), nalgebra::UnitQuaternion::identity())
}

/// Links and joints, without solids and masses.
fn tree_of_parts(
    name: &str,
    base: TriangleMesh,
    parts: Vec<MovingPart>,
    config: &ModelConfig,
) -> ArticulatedModel {
    let mut links = vec![bare_link(link_name(0), base)];
    // In state 0 all frames are parallel to the world's, each with its origin on its joint.
    let origins: Vec<_> =
        std::iter::once(nalgebra::Vector3::zeros()).chain(parts.iter().map(|p| p.point.coords)).collect();
    let mut joints = Vec::new();
    // Even an object of one part has two states.
    let count = parts.iter().map(|p| p.positions.len()).max().unwrap_or(1);
    let mut states = vec![vec![0.0; parts.len()]];
    for k in 0..count {
        states.push(parts.iter().map(|p| p.positions.get(k).copied().unwrap_or_default()).collect());
    }
    for (i, part) in parts.into_iter().enumerate() {
        let parent_from_joint = translation(part.point.coords - origins[part.parent]);
        links.push(bare_link(link_name(i + 1), part.surface.transformed(&translation(-part.point.coords))));
        joints.push(Joint {
            name: format!("joint_{}", i + 1),
            kind: part.kind,
            parent: part.parent,
            child: i + 1,
            parent_from_joint,
            axis: part.axis,
            limit: Limit {
                // Starting from 0, the position in state 0, which is not in the list.
                lower: part.positions.iter().copied().fold(0.0, f64::min),
                upper: part.positions.iter().copied().fold(0.0, f64::max),
                effort: config.effort,
                velocity: config.velocity,
                source: LimitSource::Observed,
                swept: None,
                closed: None,
            },
            dynamics: JointDynamics::default(),
            evidence: part.evidence,
        });
    }
    ArticulatedModel { name: name.to_owned(), links, joints, states }
}

fn bare_link(name: String, visual: TriangleMesh) -> Link {
    let inertial = Inertial {
        mass_kg: 0.0,
        center_of_mass: nalgebra::Point3::origin(),
        inertia: nalgebra::Matrix3::zeros(),
        assumption: String::new(),
        mass_range_kg: [0.0; 2],
    };
    let assumed = TriangleMesh::default();
    Link { name, visual, assumed_m2: 0.0, assumed, collision: Vec::new(), inertial, grasps: Vec::new() }
}

/// Mass properties of a link's walls. Without area the mass stays 0, which validation refuses.
fn wall_inertial(link: &Link, walls: &Walls, part: usize, config: &ModelConfig) -> Inertial {
    let ([usual, lowest, highest], density) = config.density_of_part(part);
    let Some(ShellInertia { mass_kg, center_of_mass, inertia }) = walls.shell_inertia(usual) else {
        return link.inertial.clone();
    };
    let wall_mm = 1e3 * config.wall_thickness_m;
    let assumed = walls.assumed_share();
    let assumption = format!(
        "walls of the seen surface ({wall_mm} mm where the other side was not seen, {:.0} % of the mass; \
         flat walls of moving parts go on where no view looked), {density}",
        100.0 * assumed
    );
    // From half to twice the assumed thickness, and from the lightest to the heaviest kind of the material.
    let mass_range_kg =
        [mass_kg * (1.0 - 0.5 * assumed) * lowest / usual, mass_kg * (1.0 + assumed) * highest / usual];
    Inertial { mass_kg, center_of_mass, inertia, assumption, mass_range_kg }
}
