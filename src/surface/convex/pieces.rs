//! The seen surface as flat pieces with the wall behind each, and samples on it, for fitting solids.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{Plane, flats::flat_patches, rays::Facets};
use crate::{TriangleMesh, patches::Patch};

/// Samples over a part's surface. chosen: time against detail
const SAMPLES: f64 = 3000.0;
/// Cosine of the largest angle between sides of a patch that count as one direction. chosen: 20 degrees
const ONE_SIDE: f64 = 0.94;
/// Ratio of a wall's thickness to the assumed one from which it is taken for two walls. tuned: made and
/// recorded objects (docs/method.md 16)
const MAX_WALLS: f64 = 4.0;
/// Width in walls below which a gap of the surface is a hole of the recording. tuned: made and recorded
/// objects (docs/method.md 16)
const NARROW_WALLS: f64 = 3.0;
/// Least cosine between a plane, or a face of a solid, and surface that runs along it. chosen: 26 degrees
pub(super) const ALONG: f64 = 0.9;
/// Points nearer to a plane than this lie in it, meters. chosen: above rounding, below any reading
const ON_PLANE_M: f64 = 1e-7;

/// A convex flat piece of the surface and the wall behind it.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    /// Corners, in the plane of its patch, meters.
    pub front: Vec<Vector3<f64>>,
    /// Vector from the front to the back of the wall, or as far into it as a wall is assumed to be thick.
    pub back: Vector3<f64>,
    /// This side's share of the wall, meters: half of it where its other side was seen.
    pub share_m: f64,
    /// Whether its other side was not seen, so its thickness is assumed.
    pub is_assumed: bool,
}

impl Piece {
    /// Lowest and highest distance of the corners from a plane, meters.
    fn height_range_m(&self, plane: &Plane) -> [f64; 2] {
        let heights = self.front.iter().map(|p| plane.normal.dot(p) - plane.offset_m);
        heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], h| [lo.min(h), hi.max(h)])
    }

    /// Its triangles, half the wall's thickness below the front, and that thickness, meters.
    pub(super) fn wall_plates(&self) -> impl Iterator<Item = ([Vector3<f64>; 3], f64)> + '_ {
        let middle = self.back.try_normalize(0.0).unwrap_or_default() * (0.5 * self.share_m);
        let corner = move |k: usize| self.front[k] + middle;
        (1..self.front.len().max(1) - 1).map(move |k| ([corner(0), corner(k), corner(k + 1)], self.share_m))
    }

    /// Its parts behind and in front of a plane. A piece within `slack_m` of the plane is not cut: it counts
    /// as behind the plane, or as in front of it if it faces the other way.
    pub(super) fn cut_at(&self, plane: &Plane, slack_m: f64) -> [Option<Self>; 2] {
        let [lo, hi] = self.height_range_m(plane);
        let along = -plane.normal.dot(&self.back) / self.back.norm();
        if along > ALONG && hi <= slack_m || hi <= ON_PLANE_M {
            return [Some(self.clone()), None];
        }
        if along < -ALONG && lo >= -slack_m || lo >= -ON_PLANE_M {
            return [None, Some(self.clone())];
        }
        [1.0, -1.0].map(|sign| {
            let front = clipped_polygon(&self.front, &(plane.normal * sign), plane.offset_m * sign);
            (front.len() >= 3).then_some(Self { front, ..*self })
        })
    }
}

/// Cuts a convex polygon at a plane (Sutherland and Hodgman 1974); returns the corners that are left.
fn clipped_polygon(polygon: &[Vector3<f64>], normal: &Vector3<f64>, offset_m: f64) -> Vec<Vector3<f64>> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (k, a) in polygon.iter().enumerate() {
        let b = &polygon[(k + 1) % polygon.len()];
        let [da, db] = [a, b].map(|p| normal.dot(p) - offset_m);
        if da <= 0.0 {
            kept.push(*a);
        }
        if (da < 0.0 && db > 0.0) || (da > 0.0 && db < 0.0) {
            kept.push(a + (b - a) * (da / (da - db)));
        }
    }
    kept
}

/// A sample of the surface, or of the side of a wall where the surface ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    /// Position, meters: on the surface itself, not in the plane of its patch, so noise counts.
    pub place: Vector3<f64>,
    /// Unit normal out of the object.
    pub normal: Vector3<f64>,
    /// Its area, square meters.
    pub area_m2: f64,
    /// Index of its face: the samples of one face have one direction and belong together.
    pub face: u32,
}

impl Sample {
    /// Whether another sample lies in front of it, facing it, within a gap.
    fn faces(&self, other: &Self, gap_m: f64) -> bool {
        let way = other.place - self.place;
        let ahead = way.dot(&self.normal);
        way.norm_squared() < gap_m * gap_m && ahead > 0.0 && self.normal.dot(&other.normal) < -0.5
    }

    /// Whether it lies behind a plane, as [`Piece::cut_at`] has it.
    pub(super) fn is_behind(&self, plane: &Plane, slack_m: f64) -> bool {
        let height = plane.normal.dot(&self.place) - plane.offset_m;
        let along = plane.normal.dot(&self.normal);
        if along > ALONG {
            height <= slack_m
        } else if along < -ALONG {
            height < -slack_m
        } else {
            height < 0.0
        }
    }
}

/// A surface to be covered.
pub(super) struct SeenSurface {
    pub pieces: Vec<Piece>,
    pub samples: Vec<Sample>,
    /// Normal of every face.
    pub faces: Vec<Vector3<f64>>,
    /// Area of the surface without the sides of walls, square meters.
    pub area_m2: f64,
}

/// Cuts a mesh into flat pieces. A patch is flat to `flat_m` (root mean square); its pieces lie in its mean
/// plane and its samples on the mesh. A wall reaches to its other side where that was seen within
/// [`MAX_WALLS`] times `wall_m`, else it is `wall_m` thick; it ends `clear_m` before `others`. A piece
/// reaches `thin_m` to `wall_m` into its wall. Where the surface ends, its wall gets a side, unless
/// `goes_on`.
pub(super) fn seen_surface(
    mesh: &TriangleMesh,
    others: &TriangleMesh,
    [flat_m, wall_m, thin_m, clear_m]: [f64; 4],
    goes_on: &dyn Fn(&Point3<f64>) -> bool,
) -> (SeenSurface, Vec<Patch>) {
    let found = flat_patches(mesh, flat_m);
    let mut patch_of = vec![u32::MAX; mesh.triangles.len()];
    for (k, patch) in found.iter().enumerate() {
        patch.triangles.iter().for_each(|&t| patch_of[t as usize] = k as u32);
    }
    let reach_m = MAX_WALLS * wall_m;
    let [own, others] = [mesh, others].map(|m| Facets::of_mesh(m, reach_m));
    let depths: Vec<f64> = (0..mesh.triangles.len())
        .into_par_iter()
        .map(|t| {
            let Some(patch) = found.get(patch_of[t] as usize) else { return f64::INFINITY };
            let middle = mesh.middle_of(t).coords;
            let inwards = -patch.normal;
            // docs/method.md (10.1): a wall ends where another part was seen to begin.
            let other = others.way_m(&middle, &inwards, false) - clear_m;
            own.way_m(&middle, &inwards, true).min(if other < wall_m {
                other.max(0.0)
            } else {
                f64::INFINITY
            })
        })
        .collect();
    let area_m2: f64 = found.iter().map(|p| p.area_m2).sum();
    let mut seen = SeenSurface {
        pieces: Vec::new(),
        samples: Vec::new(),
        faces: found.iter().map(|p| p.normal).collect(),
        area_m2,
    };
    let each = area_m2 / SAMPLES;
    for (k, patch) in found.iter().enumerate() {
        for &t in &patch.triangles {
            let front = flat_corners(mesh, t as usize, patch);
            let area = 0.5 * (front[1] - front[0]).cross(&(front[2] - front[0])).norm();
            if area <= 0.0 {
                continue;
            }
            let depth_m = depths[t as usize];
            let share_m = if depth_m.is_finite() { 0.5 * depth_m.max(thin_m) } else { wall_m };
            let back = -patch.normal * depth_m.clamp(thin_m, wall_m.max(thin_m));
            let is_assumed = !depth_m.is_finite();
            seen.pieces.push(Piece { front: front.to_vec(), back, share_m, is_assumed });
            // A regular grid of barycentric places.
            let [a, b, c] = mesh.corners(t as usize).map(|p| p.coords.cast::<f64>());
            let n = (area / each).sqrt().ceil().max(1.0) as usize;
            let places = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
            for (i, j) in places {
                let mut u = (i as f64 + 0.5) / n as f64;
                let mut v = (j as f64 + 0.5) / n as f64;
                if u + v > 1.0 {
                    (u, v) = (1.0 - u, 1.0 - v);
                }
                // On the diagonal, the sample moves off the triangle's side.
                let (u, v) = if n == 1 { (1.0 / 3.0, 1.0 / 3.0) } else { (u, v) };
                let place = a + (b - a) * u + (c - a) * v;
                let area_m2 = area / (n * n) as f64;
                seen.samples.push(Sample { place, normal: patch.normal, area_m2, face: k as u32 });
            }
        }
    }
    let depths: Vec<f64> = depths.iter().map(|d| d.clamp(thin_m, wall_m.max(thin_m))).collect();
    let walls = PatchWalls { patches: &found, patch_of: &patch_of, depths_m: &depths };
    add_wall_sides(mesh, walls, [each, wall_m], goes_on, &mut seen);
    (seen, found)
}

/// The walls behind the triangles of a mesh.
struct PatchWalls<'a> {
    patches: &'a [Patch],
    /// Number of each triangle's patch.
    patch_of: &'a [u32],
    /// Depth of the wall behind each triangle, meters.
    depths_m: &'a [f64],
}

/// The corners of a triangle in the plane of its patch.
fn flat_corners(mesh: &TriangleMesh, t: usize, patch: &Patch) -> [Vector3<f64>; 3] {
    mesh.corners(t).map(|p| in_plane(&p, patch))
}

/// A point projected along the normal of a patch into its plane.
fn in_plane(p: &Point3<f32>, patch: &Patch) -> Vector3<f64> {
    let p = p.coords.cast::<f64>();
    p - patch.normal * patch.normal.dot(&(p - patch.center.coords))
}

/// Samples on the sides of walls, where the surface ends.
fn add_wall_sides(
    mesh: &TriangleMesh,
    walls: PatchWalls<'_>,
    [each_m2, wall_m]: [f64; 2],
    goes_on: &dyn Fn(&Point3<f64>) -> bool,
    seen: &mut SeenSurface,
) {
    let first = seen.samples.len();
    let mut open: BTreeMap<(u32, u32), (u32, u32, u32)> = BTreeMap::new();
    for (p, q, t) in mesh.sides() {
        let key = (p.min(q), p.max(q));
        if open.remove(&key).is_none() {
            open.insert(key, (p, q, t));
        }
    }
    // Sides of one patch with one direction form one face.
    let mut of_patch: BTreeMap<u32, Vec<(u32, Vector3<f64>)>> = BTreeMap::new();
    for (p, q, t) in open.into_values() {
        let k = walls.patch_of[t as usize];
        let Some(patch) = walls.patches.get(k as usize) else { continue };
        let [a, b] = [p, q].map(|v| in_plane(&mesh.vertices[v as usize], patch));
        let Some(out) = (b - a).cross(&patch.normal).try_normalize(1e-9) else { continue };
        let depth_m = walls.depths_m[t as usize];
        let groups = of_patch.entry(k).or_default();
        let known = groups.iter_mut().find(|(_, sum)| sum.dot(&out) > ONE_SIDE * sum.norm());
        let face = match known {
            Some((face, sum)) => {
                *sum += out * (b - a).norm();
                *face
            }
            None => {
                let face = seen.faces.len() as u32;
                groups.push((face, out * (b - a).norm()));
                seen.faces.push(out);
                face
            }
        };
        let area = (b - a).norm() * depth_m;
        let n = (area / each_m2).ceil().max(1.0) as usize;
        for i in 0..n {
            let edge = a + (b - a) * ((i as f64 + 0.5) / n as f64);
            if goes_on(&Point3::from(edge + out * depth_m)) {
                continue;
            }
            let place = edge - patch.normal * (0.5 * depth_m);
            seen.samples.push(Sample { place, normal: out, area_m2: area / n as f64, face });
        }
    }
    close_narrow(&mut seen.samples, first, NARROW_WALLS * wall_m);
    for (face, sum) in of_patch.into_values().flatten() {
        if let Some(normal) = sum.try_normalize(0.0) {
            seen.faces[face as usize] = normal;
        }
    }
}

/// Drops the samples from `first` on, on sides of walls, that face another side over less than `gap_m`.
fn close_narrow(samples: &mut Vec<Sample>, first: usize, gap_m: f64) {
    let sides = samples.split_off(first);
    samples.extend(sides.iter().filter(|a| !sides.iter().any(|b| a.faces(b, gap_m))));
}
