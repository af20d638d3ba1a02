//! Fills gaps in flat faces where no view saw through them.

use std::collections::BTreeSet;

use nalgebra::{Point2, Point3};

use super::{
    face::Face,
    polygon::{is_inside, triangulate},
    reach::{Neighbors, Reach},
};
use crate::TriangleMesh;

/// Largest distance between the examined points of a fill, voxels. derived: half of a grid's resolution
const SAMPLE_STEP: f64 = 0.5;

/// Whether views saw empty space at a point (meters).
pub(super) type SeenEmpty<'a> = &'a dyn Fn(&Point3<f64>) -> bool;

/// New triangles in gaps of a mesh.
pub(super) struct Fill<'a> {
    mesh: &'a TriangleMesh,
    neighbors: &'a Neighbors,
    reach: Reach<'a>,
    /// The triangles at each vertex.
    around: Vec<Vec<u32>>,
    voxel_m: f64,
    is_seen_empty: SeenEmpty<'a>,
    /// Sides of the new triangles, lower vertex first.
    taken: BTreeSet<(u32, u32)>,
    /// The new triangles.
    pub triangles: Vec<[u32; 3]>,
}

impl<'a> Fill<'a> {
    pub(super) fn new(
        mesh: &'a TriangleMesh,
        neighbors: &'a Neighbors,
        voxel_m: f64,
        is_seen_empty: SeenEmpty<'a>,
    ) -> Self {
        let mut around = vec![Vec::new(); mesh.vertices.len()];
        for (t, corners) in mesh.triangles.iter().enumerate() {
            corners.iter().for_each(|&v| around[v as usize].push(t as u32));
        }
        let reach = Reach::new(mesh, neighbors);
        let taken = BTreeSet::new();
        let triangles = Vec::new();
        Self { mesh, neighbors, reach, around, voxel_m, is_seen_empty, taken, triangles }
    }

    /// Fills the gap within a rim with the surface on its left. From its last vertex to the first runs a side
    /// of the border or, with `is_bay`, a new one. Returns whether it was filled: not where `others`,
    /// vertices of the border, lie in it, where the face is not flat, or where a point of it was seen empty.
    pub(super) fn fill_gap(&mut self, rim: &[u32], is_bay: bool, others: impl Iterator<Item = u32>) -> bool {
        let mesh = self.mesh;
        if is_bay && self.has_side(rim[0], rim[rim.len() - 1]) {
            return false;
        }
        let Some(face) = Face::around_rim(mesh, rim, &mut self.reach, &self.around, self.voxel_m) else {
            return false;
        };
        // Reversed: the new triangles lie on the other side of the rim.
        let at = |k: usize| rim[rim.len() - 1 - k];
        let position = |v: u32| mesh.vertices[v as usize].cast::<f64>();
        let flat: Vec<Point2<f64>> = (0..rim.len()).map(|k| face.in_plane(&position(at(k)))).collect();
        let mut others = others.map(|v| face.in_plane(&position(v)));
        if others.any(|p| is_inside(&p, &flat)) {
            return false;
        }
        let Some(cut) = triangulate(&flat, |i, j| self.has_side(at(i), at(j))) else { return false };
        let new: Vec<[u32; 3]> = cut.into_iter().map(|t| t.map(at)).collect();
        let step_m = SAMPLE_STEP * self.voxel_m;
        let mut points = new.iter().flat_map(|t| points_of_triangle(&t.map(position), step_m));
        if points.any(|p| (self.is_seen_empty)(&p)) {
            return false;
        }
        let sides = new.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        self.taken.extend(sides.map(|(p, q)| (p.min(q), p.max(q))));
        self.triangles.extend(new);
        true
    }

    /// Whether the mesh or a new triangle has a side between two vertices.
    fn has_side(&self, a: u32, b: u32) -> bool {
        self.neighbors.are_joined(a, b) || self.taken.contains(&(a.min(b), a.max(b)))
    }
}

/// Points of a triangle, its corners left out, no farther apart than `step_m`.
fn points_of_triangle(corners: &[Point3<f64>; 3], step_m: f64) -> impl Iterator<Item = Point3<f64>> + use<> {
    let [a, b, c] = *corners;
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    // No gap is wider than a few voxels.
    let n = ((longest / step_m).ceil() as usize).clamp(1, 64);
    (0..n).flat_map(move |i| {
        (0..n - i).map(move |j| {
            let [u, v] = [i, j].map(|k| (k as f64 + 1.0 / 3.0) / n as f64);
            a + (b - a) * u + (c - a) * v
        })
    })
}
