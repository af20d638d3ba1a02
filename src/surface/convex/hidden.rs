//! Walls assumed in hidden places.

use nalgebra::{Matrix3, Point2, Point3, Vector3};

use super::{Hidden, MIN_THICKNESS_M, pieces::Piece, raster::Raster};
use crate::{TriangleMesh, outline::hull_2d, patches::Patch};
use geometry::bounding_box;

/// Largest number of samples along an edge of a face near a patch, across three patch sizes.
const MAX_STEPS: usize = 300;
/// Largest number of rectangles in the gaps of a patch.
const RECTANGLES: usize = 10;
/// Patches below this share of the surface are not continued. tuned: made and recorded objects
/// (docs/method.md 16)
const LEAST_SHARE: f64 = 0.005;

/// An unseen wall.
pub(super) struct HiddenWall {
    /// Its rectangle, with the wall behind it.
    pub piece: Piece,
    /// Mean color of the adjacent seen face, where the mesh has colors.
    pub color: Option<[u8; 3]>,
}

/// Flat walls in hidden places: each continues the seen surface of a wall to another seen part of it or to
/// another wall.
pub(super) fn hidden_walls(
    mesh: &TriangleMesh,
    patches: &[Patch],
    wall_m: f64,
    hidden: Hidden<'_>,
) -> Vec<HiddenWall> {
    let total: f64 = patches.iter().map(|p| p.area_m2).sum();
    let large = patches.iter().filter(|p| p.area_m2 >= LEAST_SHARE * total);
    large.flat_map(|patch| walls_in_gaps(mesh, patch, wall_m, hidden)).collect()
}

/// The fronts of unseen walls, counter-clockwise seen from in front.
pub(super) fn front_mesh(walls: &[HiddenWall]) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for HiddenWall { piece, color } in walls {
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(piece.front.iter().map(|p| Point3::from(p.cast::<f32>())));
        mesh.colors.extend(color.iter().flat_map(|c| piece.front.iter().map(move |_| *c)));
        let corners = piece.front.len() as u32;
        mesh.triangles.extend((1..corners - 1).map(|k| [first, first + k, first + k + 1]));
    }
    mesh
}

/// Mean color of a patch by area; `None` for a mesh without colors.
fn mean_color(mesh: &TriangleMesh, patch: &Patch) -> Option<[u8; 3]> {
    let mut sum = Vector3::zeros();
    let mut area = 0.0;
    for &t in &patch.triangles {
        let own = mesh.area_normal(t as usize).norm();
        for v in mesh.triangles[t as usize] {
            sum += Vector3::from(mesh.colors.get(v as usize)?.map(f32::from)) * own;
            area += own;
        }
    }
    (area > 0.0).then(|| (sum / area).map(|c| c.round() as u8).into())
}

/// Walls in the gaps of a patch.
fn walls_in_gaps(mesh: &TriangleMesh, patch: &Patch, wall_m: f64, hidden: Hidden<'_>) -> Vec<HiddenWall> {
    let flat = Flat::of_patch(mesh, patch);
    let points: Vec<Point2<f64>> = flat.triangles.iter().flatten().copied().collect();
    let hull = hull_2d(&points);
    if hull.len() < 3 {
        return Vec::new();
    }
    // Walls may end a little in front of or behind the plane.
    let walls = walls_across(mesh, &flat, &hull, [-2.0 * wall_m, wall_m], MIN_THICKNESS_M);
    let mut raster = Raster::new(&flat.triangles, &hull, &walls, MIN_THICKNESS_M);
    if !raster.close_gaps(&walls, |p| hidden(&flat.place_at_height(p, -0.5 * wall_m))) {
        return Vec::new();
    }
    let back = -patch.normal * wall_m;
    let color = mean_color(mesh, patch);
    let mut walls = Vec::new();
    for corners in raster.closed_rectangles(RECTANGLES) {
        let front = corners.iter().map(|p| flat.place_at_height(p, 0.0).coords).collect();
        walls.push(HiddenWall { piece: Piece { front, back, share_m: wall_m, is_assumed: true }, color });
    }
    walls
}

/// A patch in its own frame: z along its normal.
struct Flat {
    world_from_flat: Matrix3<f64>,
    origin: Point3<f64>,
    triangles: Vec<[Point2<f64>; 3]>,
}

impl Flat {
    fn of_patch(mesh: &TriangleMesh, patch: &Patch) -> Self {
        let z = patch.normal;
        let x = z.cross(&if z.x.abs() < 0.8 { Vector3::x() } else { Vector3::y() }).normalize();
        let world_from_flat = Matrix3::from_columns(&[x, z.cross(&x), z]);
        let mut flat = Self { world_from_flat, origin: patch.center, triangles: Vec::new() };
        flat.triangles = patch
            .triangles
            .iter()
            .map(|&t| mesh.corners(t as usize).map(|p| flat.in_patch_frame(&p).xy().into()))
            .collect();
        flat
    }

    /// A point in the patch's frame.
    fn in_patch_frame(&self, p: &Point3<f32>) -> Vector3<f64> {
        self.world_from_flat.tr_mul(&(p.cast::<f64>() - self.origin))
    }

    /// A place at a height above the plane.
    fn place_at_height(&self, p: &Point2<f64>, height_m: f64) -> Point3<f64> {
        self.origin + self.world_from_flat * Vector3::new(p.x, p.y, height_m)
    }
}

/// Points, in a patch's frame, of the mesh's steep faces near the patch and its plane: there another wall
/// meets it.
fn walls_across(
    mesh: &TriangleMesh,
    flat: &Flat,
    hull: &[Point2<f64>],
    range_m: [f64; 2],
    spacing_m: f64,
) -> Vec<Point2<f64>> {
    let Some((lower, upper)) = bounding_box(hull.iter().copied()) else { return Vec::new() };
    // A gap is never longer than the seen surface beside it.
    let (lower, upper) = (lower - (upper - lower), upper + (upper - lower));
    let spacing_m = spacing_m.max((upper - lower).max() / MAX_STEPS as f64);
    let near = |p: &Point2<f64>| (0..2).all(|k| (lower[k]..=upper[k]).contains(&p[k]));
    let mut points = Vec::new();
    for t in 0..mesh.triangles.len() {
        let corners = mesh.corners(t).map(|p| flat.in_patch_frame(&p));
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let heights =
            corners.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], c| [lo.min(c.z), hi.max(c.z)]);
        // Only faces steep against the patch, at its height.
        if normal.z.abs() > 0.5 * normal.norm() || heights[0] > range_m[1] || heights[1] < range_m[0] {
            continue;
        }
        let longest = (0..3).map(|k| (corners[k] - corners[(k + 1) % 3]).norm()).fold(0.0, f64::max);
        let steps = ((longest / spacing_m).ceil() as usize).clamp(1, MAX_STEPS);
        for i in 0..=steps {
            for j in 0..=steps - i {
                let a = i as f64 / steps as f64;
                let b = j as f64 / steps as f64;
                let p = corners[0] * a + corners[1] * b + corners[2] * (1.0 - a - b);
                if (range_m[0]..=range_m[1]).contains(&p.z) && near(&p.xy().into()) {
                    points.push(p.xy().into());
                }
            }
        }
    }
    points
}
