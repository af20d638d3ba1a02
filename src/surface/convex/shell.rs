//! A surface as convex solids: slabs for flat walls, thin prisms for what is curved.
//!
//! A scanned surface need not be closed and is seldom convex: its hull or a decomposition of its volume fills
//! the places that things are put into. So the solids follow the surface itself, each as deep as the wall
//! behind it.

use nalgebra::{Matrix3, Point2, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::{ConvexSolid, raster::Raster};
use crate::statistics::median;
use crate::surface::{
    TriangleMesh, keep_components,
    outline::{area, hull_2d, with_fewer_corners},
    patches::{Patch, patches},
    simplify,
};

/// Triangles that the patches are grown on.
const TRIANGLES: usize = 6000;
/// Components with a smaller share of the largest one's triangles are loose fragments.
const MIN_COMPONENT: f64 = 0.03;
/// Share of the surface that the solids stand for; smaller patches beyond it are dropped.
const COVERED: f64 = 0.985;
/// Share of its hull that a patch fills to count as convex.
const CONVEX_FILL: f64 = 0.9;
/// Most solids of a patch.
const PATCH_SOLIDS: usize = 10;
/// Most samples of a face that is looked for near a patch, along an edge and across three patches.
const MAX_STEPS: usize = 300;
/// Most corners of a prism's outline.
const CORNERS: usize = 12;
/// A wall thicker than this many assumed walls is taken for two.
const MAX_WALLS: f64 = 4.0;
/// Rays per patch that measure its wall.
const RAYS: usize = 24;
/// Times that the tolerance may grow, and one.
const ROUNDS: usize = 7;
/// More patches than this times the solids that are wanted are not turned into solids.
const MAX_PATCHES: usize = 4;
/// The tolerance grows by this until the solids are few enough.
const COARSER: f64 = 1.5;

/// Settings of the collision solids.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ConvexConfig {
    /// Most solids of a part.
    pub max_solids: usize,
    /// How far a patch may leave its plane, as a share of the part's extent.
    pub tolerance_share: f64,
    /// No solid is thinner, meters (a simulator refuses flat hulls).
    pub min_thickness_m: f64,
    /// Solids of moving parts are this much smaller on every side, meters.
    pub shrink_m: f64,
    /// Gap that is kept free around the path of a moving part, meters.
    pub gap_m: f64,
}

impl Default for ConvexConfig {
    fn default() -> Self {
        Self {
            max_solids: 32,
            tolerance_share: 0.006,
            min_thickness_m: 0.002,
            shrink_m: 0.001,
            gap_m: 0.0015,
        }
    }
}

/// Whether no view saw what a place (in the mesh's frame, meters) holds.
pub type Hidden<'a> = &'a dyn Fn(&Point3<f64>) -> bool;

/// Convex solids behind a surface, walls `wall_m` thick where the other side of a wall was not seen. A flat
/// wall goes on through `hidden` places, where these are known, up to where it or another wall was seen
/// again, as the floor of a drawer does behind its front. At least one solid for a mesh with area, at most
/// `max_solids`. Deterministic. See docs/method.md 10.1.
#[must_use]
pub fn convex_shell(
    mesh: &TriangleMesh,
    wall_m: f64,
    hidden: Option<Hidden<'_>>,
    config: &ConvexConfig,
) -> Vec<ConvexSolid> {
    let Some((lower, upper)) = mesh.bounds() else { return Vec::new() };
    let extent_m = f64::from((upper - lower).norm());
    let whole = keep_components(mesh, MIN_COMPONENT);
    // A quarter of the tolerance is spent on fewer triangles; the patches have the rest.
    let small = simplify(&whole, TRIANGLES, 0.25 * config.tolerance_share * extent_m);
    let mut tolerance_m = config.tolerance_share * extent_m;
    let mut solids = Vec::new();
    // Coarser until few enough; what is still too much loses its smallest.
    for round in 1..=ROUNDS {
        let found = covering_patches(&small, tolerance_m);
        // A patch may lie inside another's solid, but not most of them.
        if round == ROUNDS || found.len() <= MAX_PATCHES * config.max_solids {
            solids = solids_of(&small, &found, tolerance_m, wall_m, hidden, config);
            if solids.len() <= config.max_solids {
                break;
            }
        }
        tolerance_m *= COARSER;
    }
    solids.sort_by(|a, b| b.volume_m3().total_cmp(&a.volume_m3()));
    solids.truncate(config.max_solids);
    if solids.is_empty() && !mesh.is_empty() {
        // Too small for slabs: its box.
        let pad = |a: f32, b: f32| (config.min_thickness_m - f64::from(b - a)).max(0.0) * 0.5;
        let pads = Vector3::from_fn(|k, _| pad(lower[k], upper[k]));
        solids.push(ConvexSolid::cuboid(&(lower.cast() - pads), &(upper.cast() + pads)));
    }
    solids
}

/// The patches, largest first, that make up [`COVERED`] of the surface.
fn covering_patches(mesh: &TriangleMesh, tolerance_m: f64) -> Vec<Patch> {
    let all = patches(mesh, tolerance_m);
    let total: f64 = all.iter().map(|p| p.area_m2).sum();
    let mut covered = 0.0;
    let needed = |p: &Patch| {
        let before = covered;
        covered += p.area_m2;
        before <= COVERED * total
    };
    all.into_iter().take_while(needed).collect()
}

fn solids_of(
    mesh: &TriangleMesh,
    patches: &[Patch],
    tolerance_m: f64,
    wall_m: f64,
    hidden: Option<Hidden<'_>>,
    config: &ConvexConfig,
) -> Vec<ConvexSolid> {
    let facets = facets(mesh);
    let mut solids: Vec<ConvexSolid> = Vec::new();
    for patch in patches {
        let depth_m = wall_depth(mesh, &facets, patch, wall_m);
        for solid in patch_solids(mesh, patch, [tolerance_m, depth_m, wall_m], hidden, config) {
            if !solids.iter().any(|other| holds(other, &solid, tolerance_m)) {
                solids.push(solid);
            }
        }
    }
    solids
}

/// Whether a solid lies within another one grown by a tolerance.
fn holds(outer: &ConvexSolid, inner: &ConvexSolid, tolerance_m: f64) -> bool {
    let planes = outer.planes();
    inner.vertices.iter().all(|p| planes.iter().all(|q| q.distance_m(p) <= tolerance_m))
}

/// A patch in its own frame: z along its normal.
struct Flat {
    world_from_flat: Matrix3<f64>,
    origin: Point3<f64>,
    triangles: Vec<[Point2<f64>; 3]>,
    /// Lowest and highest corner along the normal.
    range_m: [f64; 2],
}

impl Flat {
    fn of(mesh: &TriangleMesh, patch: &Patch) -> Self {
        let z = patch.normal;
        let x = z.cross(&if z.x.abs() < 0.8 { Vector3::x() } else { Vector3::y() }).normalize();
        let world_from_flat = Matrix3::from_columns(&[x, z.cross(&x), z]);
        let local = |p: Point3<f32>| world_from_flat.tr_mul(&(p.cast::<f64>() - patch.center));
        let corners: Vec<[Vector3<f64>; 3]> =
            patch.triangles.iter().map(|&t| mesh.corners(t as usize).map(local)).collect();
        let heights = corners.iter().flatten().map(|p| p.z);
        let range_m = heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], h| [lo.min(h), hi.max(h)]);
        let triangles = corners.iter().map(|c| c.map(|p| Point2::new(p.x, p.y))).collect();
        Self { world_from_flat, origin: patch.center, triangles, range_m }
    }

    /// A place at a height above the plane.
    fn place(&self, p: &Point2<f64>, height_m: f64) -> Point3<f64> {
        self.origin + self.world_from_flat * Vector3::new(p.x, p.y, height_m)
    }

    fn prism(&self, polygon: &[Point2<f64>], low_m: f64, high_m: f64) -> ConvexSolid {
        let polygon: Vec<Point3<f64>> = polygon.iter().map(|p| self.place(p, 0.0)).collect();
        ConvexSolid::prism(&polygon, &self.world_from_flat.column(2).into_owned(), low_m, high_m)
    }
}

/// The solids of one patch: a prism over its hull where it fills that, else rectangles over what it covers.
fn patch_solids(
    mesh: &TriangleMesh,
    patch: &Patch,
    [tolerance_m, depth_m, wall_m]: [f64; 3],
    hidden: Option<Hidden<'_>>,
    config: &ConvexConfig,
) -> Vec<ConvexSolid> {
    let flat = Flat::of(mesh, patch);
    let points: Vec<Point2<f64>> = flat.triangles.iter().flatten().copied().collect();
    let hull = hull_2d(&points);
    let hull_area = area(&hull);
    if hull.len() < 3 || hull_area < config.min_thickness_m * config.min_thickness_m {
        return Vec::new();
    }
    // The surface is the middle of what scatters around the plane; only a curved patch reaches further.
    let high = flat.range_m[1].min(0.5 * tolerance_m);
    let low = (high - depth_m.max(config.min_thickness_m)).min(flat.range_m[0].max(-tolerance_m));
    let raster = hidden.and_then(|hidden| {
        // Walls may end a little above or below the plane.
        let walls = walls_across(mesh, &flat, &hull, [low - wall_m, high + wall_m], config.min_thickness_m);
        let mut raster = Raster::new(&flat.triangles, &hull, &walls, config.min_thickness_m);
        raster.close_gaps(&walls, |p| hidden(&flat.place(p, 0.5 * (low + high)))).then_some(raster)
    });
    let flat_area: f64 = flat.triangles.iter().map(|t| area(t).abs()).sum();
    if raster.is_none() && flat_area >= CONVEX_FILL * hull_area {
        return vec![flat.prism(&with_fewer_corners(hull, CORNERS), low, high)];
    }
    let mut raster =
        raster.unwrap_or_else(|| Raster::new(&flat.triangles, &hull, &[], config.min_thickness_m));
    raster.close_holes(wall_m);
    raster
        .rectangles(config.max_solids.min(PATCH_SOLIDS))
        .iter()
        .map(|corners| flat.prism(corners, low, high))
        .collect()
}

/// Points of a mesh's steep faces near a patch and its plane, in its frame: where a wall meets it.
fn walls_across(
    mesh: &TriangleMesh,
    flat: &Flat,
    hull: &[Point2<f64>],
    range_m: [f64; 2],
    spacing_m: f64,
) -> Vec<Point2<f64>> {
    let start = (hull[0], hull[0]);
    let (lower, upper) = hull.iter().fold(start, |(lo, hi), p| (lo.inf(p), hi.sup(p)));
    // A gap is never longer than what was seen.
    let (lower, upper) = (lower - (upper - lower), upper + (upper - lower));
    let spacing_m = spacing_m.max((upper - lower).max() / MAX_STEPS as f64);
    let near = |p: &Point2<f64>| (0..2).all(|k| (lower[k]..=upper[k]).contains(&p[k]));
    let mut points = Vec::new();
    for t in 0..mesh.triangles.len() {
        let corners = mesh.corners(t).map(|p| flat.world_from_flat.tr_mul(&(p.cast::<f64>() - flat.origin)));
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let heights =
            corners.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], c| [lo.min(c.z), hi.max(c.z)]);
        // Faces that are steep against the patch, at its height.
        if normal.z.abs() > 0.5 * normal.norm() || heights[0] > range_m[1] || heights[1] < range_m[0] {
            continue;
        }
        let longest = (0..3).map(|k| (corners[k] - corners[(k + 1) % 3]).norm()).fold(0.0, f64::max);
        let steps = ((longest / spacing_m).ceil() as usize).clamp(1, MAX_STEPS);
        for i in 0..=steps {
            for j in 0..=steps - i {
                let (a, b) = (i as f64 / steps as f64, j as f64 / steps as f64);
                let p = corners[0] * a + corners[1] * b + corners[2] * (1.0 - a - b);
                if (range_m[0]..=range_m[1]).contains(&p.z) && near(&p.xy().into()) {
                    points.push(p.xy().into());
                }
            }
        }
    }
    points
}

/// How deep the wall behind a patch is: the median distance to where rays leave it, where that is a wall's;
/// else `wall_m`.
fn wall_depth(mesh: &TriangleMesh, facets: &[Facet], patch: &Patch, wall_m: f64) -> f64 {
    let step = patch.triangles.len().div_ceil(RAYS);
    let reach = MAX_WALLS * wall_m;
    let ray = |&t: &u32| {
        let origin =
            mesh.corners(t as usize).iter().map(|p| p.coords.cast::<f64>()).sum::<Vector3<f64>>() / 3.0;
        exit(facets, &Point3::from(origin), &-patch.normal, reach)
    };
    // docs/method.md (10.1).
    let depth_m = median(patch.triangles.iter().step_by(step).map(ray).collect());
    depth_m.filter(|d| *d < reach).unwrap_or(wall_m)
}

/// A triangle: corners and unit normal.
struct Facet {
    corners: [Point3<f64>; 3],
    normal: Vector3<f64>,
}

fn facets(mesh: &TriangleMesh) -> Vec<Facet> {
    let facet = |t: usize| {
        let normal = mesh.area_normal(t).cast::<f64>().try_normalize(0.0)?;
        Some(Facet { corners: mesh.corners(t).map(|c| c.cast::<f64>()), normal })
    };
    (0..mesh.triangles.len()).filter_map(facet).collect()
}

/// Distance along a ray to the first surface that it leaves the object through, meters; infinite beyond
/// `reach`.
fn exit(facets: &[Facet], origin: &Point3<f64>, direction: &Vector3<f64>, reach: f64) -> f64 {
    let mut nearest = f64::INFINITY;
    for Facet { corners, normal } in facets {
        let speed = normal.dot(direction);
        // The ray enters here, or runs nearly along the face.
        if speed <= 0.2 {
            continue;
        }
        let s = normal.dot(&(corners[0] - origin)) / speed;
        // Not the triangle that the ray starts on, nor anything behind the nearest one.
        if s <= 1e-5 || s >= nearest.min(reach) {
            continue;
        }
        let p = origin + direction * s;
        let inside =
            |k: usize| (corners[(k + 1) % 3] - corners[k]).cross(&(p - corners[k])).dot(normal) >= -1e-15;
        if (0..3).all(inside) {
            nearest = s;
        }
    }
    nearest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::{
        marching_cubes, merge,
        shapes::{box_mesh, grid_of, sphere_mesh, torus},
    };

    fn holds_point(solids: &[ConvexSolid], p: [f64; 3]) -> bool {
        solids.iter().any(|s| s.planes().iter().all(|q| q.distance_m(&Point3::from(p)) <= 0.0))
    }

    /// A tray: walls 10 mm thick around a hollow that is open at the top.
    fn tray() -> TriangleMesh {
        let outer = box_mesh(Vector3::new(0.2, 0.15, 0.06));
        let mut inner = box_mesh(Vector3::new(0.19, 0.14, 0.06));
        inner.vertices.iter_mut().for_each(|p| p.z += 0.01);
        inner.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        let top = |mesh: &TriangleMesh, t: &[u32; 3], z: f32| {
            t.iter().all(|&i| (mesh.vertices[i as usize].z - z).abs() < 1e-6)
        };
        let mut outer_open = outer.clone();
        outer_open.triangles.retain(|t| !top(&outer, t, 0.06));
        let mut inner_open = inner.clone();
        inner_open.triangles.retain(|t| !top(&inner, t, 0.07));
        merge(&[&outer_open, &inner_open])
    }

    #[test]
    fn a_tray_is_made_of_slabs_and_stays_hollow() {
        let solids = convex_shell(&tray(), 0.008, None, &ConvexConfig::default());
        assert!((5..=10).contains(&solids.len()), "{}", solids.len());
        for hollow in [[0.0, 0.0, 0.0], [0.15, 0.1, -0.03], [-0.18, 0.0, 0.05]] {
            assert!(!holds_point(&solids, hollow), "{hollow:?}");
        }
        for wall in [[0.0, 0.0, -0.055], [0.195, 0.0, 0.0], [0.0, -0.145, 0.02]] {
            assert!(holds_point(&solids, wall), "{wall:?}");
        }
    }

    #[test]
    fn a_floor_goes_on_where_no_view_saw_it_and_ends_where_one_saw_a_hole() {
        // The floor between x = -0.19 and -0.12 is missing.
        let mut mesh = marching_cubes(&grid_of(0.25, 126, |p: &Point3<f64>| tray_distance(p)), 0.0);
        let missing = |p: &Point3<f32>| p.x < -0.12 && p.x > -0.185 && p.z < -0.03 && p.y.abs() < 0.135;
        let vertices = mesh.vertices.clone();
        mesh.triangles.retain(|t| !t.iter().all(|&i| missing(&vertices[i as usize])));
        let config = ConvexConfig::default();
        let behind = |p: &Point3<f64>| p.x < -0.11;
        let gap = [-0.15, 0.03, -0.055];
        assert!(!holds_point(&convex_shell(&mesh, 0.008, None, &config), gap));
        let closed = convex_shell(&mesh, 0.008, Some(&behind), &config);
        assert!(holds_point(&closed, gap));
        assert!(!holds_point(&closed, [-0.15, 0.03, -0.03]) && !holds_point(&closed, [0.0, 0.0, 0.0]));
    }

    /// Distance to the tray of [`tray`].
    fn tray_distance(p: &Point3<f64>) -> f64 {
        let cuboid = |center: Vector3<f64>, half: Vector3<f64>| {
            let q = (p.coords - center).abs() - half;
            q.sup(&Vector3::zeros()).norm() + q.max().min(0.0)
        };
        cuboid(Vector3::zeros(), Vector3::new(0.2, 0.15, 0.06))
            .max(-cuboid(Vector3::new(0.0, 0.0, 0.05), Vector3::new(0.19, 0.14, 0.1)))
    }

    #[test]
    fn a_ring_keeps_its_hole_and_a_ball_is_covered() {
        let config = ConvexConfig::default();
        let ring =
            convex_shell(&marching_cubes(&grid_of(0.5, 50, torus(0.3, 0.08)), 0.0), 0.01, None, &config);
        assert!(!holds_point(&ring, [0.0; 3]) && ring.len() <= config.max_solids && ring.len() > 8);
        let ball = convex_shell(&sphere_mesh(0.1, 40), 0.01, None, &config);
        assert!(ball.len() <= config.max_solids);
        for d in [Vector3::x(), Vector3::y(), -Vector3::z()] {
            assert!((0..20).any(|k| holds_point(&ball, (d * (0.101 - 0.001 * f64::from(k))).into())));
        }
    }

    #[test]
    fn every_solid_has_volume_and_a_mesh_without_area_has_none() {
        let solids =
            convex_shell(&box_mesh(Vector3::new(0.2, 0.1, 0.0005)), 0.008, None, &ConvexConfig::default());
        assert!(
            !solids.is_empty() && solids.iter().all(|s| s.thickness_m() >= 0.0019 && s.volume_m3() > 0.0)
        );
        let speck = convex_shell(
            &box_mesh(Vector3::new(0.0004, 0.0004, 0.0004)),
            0.008,
            None,
            &ConvexConfig::default(),
        );
        assert!(!speck.is_empty() && speck.iter().all(|s| s.thickness_m() >= 0.0019));
        assert!(convex_shell(&TriangleMesh::default(), 0.008, None, &ConvexConfig::default()).is_empty());
    }
}
