//! Normals of the faces, sides and corners of a mesh. Their sign at a closest point shows inside from
//! outside (angle-weighted pseudo-normals, Baerentzen and Aanaes 2005).

use nalgebra::Vector3;

use super::{
    TriangleMesh,
    edges::Edges,
    triangle::{Feature, closest_on_triangle},
};
use numeric::lists::Lists;

/// No triangle.
const NONE: u32 = u32::MAX;
/// Largest number of steps of a walk over the mesh.
const MAX_STEPS: usize = 64;

/// Faces, sides and corners of a mesh, in the coordinates given by the caller.
pub(super) struct Pseudonormals {
    /// Corner positions of each triangle.
    pub corners: Vec<[Vector3<f32>; 3]>,
    faces: Vec<Vector3<f32>>,
    sides: Vec<[Vector3<f32>; 3]>,
    vertices: Vec<Vector3<f32>>,
    triangles: Vec<[u32; 3]>,
    /// Triangle across each side; [`NONE`] where there is none or more than one.
    across: Vec<[u32; 3]>,
    /// Triangles around each vertex.
    rings: Lists<u32>,
    /// Bit `i`: side `i` has no other triangle; bit `3 + i`: corner `i` lies on such a side.
    open: Vec<u8>,
}

/// The closest point of a triangle to a query.
struct ClosestFeature {
    /// Squared distance.
    distance2: f32,
    triangle: u32,
    /// The feature on which the point lies.
    feature: Feature,
}

impl Pseudonormals {
    /// Pseudo-normals of a mesh with its vertices at `positions`.
    pub(crate) fn of_mesh(mesh: &TriangleMesh, positions: &[Vector3<f32>]) -> Self {
        let corners: Vec<[Vector3<f32>; 3]> =
            mesh.triangles.iter().map(|t| t.map(|i| positions[i as usize])).collect();
        let faces: Vec<Vector3<f32>> = corners
            .iter()
            .map(|[a, b, c]| (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default())
            .collect();
        let mut vertices = vec![Vector3::zeros(); positions.len()];
        for ((t, c), face) in mesh.triangles.iter().zip(&corners).zip(&faces) {
            for k in 0..3 {
                // Weighted by the angle at the corner, so it does not matter how a flat face is cut into
                // triangles.
                let u = c[(k + 1) % 3] - c[k];
                let v = c[(k + 2) % 3] - c[k];
                vertices[t[k] as usize] += face * u.cross(&v).norm().atan2(u.dot(&v));
            }
        }
        let corners_of = mesh.triangles.iter().zip(0..).flat_map(|(corners, t)| corners.map(|v| (v, t)));
        let rings = Lists::of_entries(positions.len(), corners_of);
        let count = corners.len();
        let sides = faces.iter().map(|n| [*n; 3]).collect();
        let triangles = mesh.triangles.clone();
        let mut all = Self {
            corners,
            faces,
            sides,
            vertices,
            triangles,
            across: vec![[NONE; 3]; count],
            rings,
            open: vec![0; count],
        };
        all.join_sides(&Edges::of_mesh(mesh));
        all
    }

    /// Sums the face normals over the triangles of each side, and marks open sides and their corners.
    fn join_sides(&mut self, edges: &Edges) {
        let mut open_vertices = vec![false; self.vertices.len()];
        for (a, same) in edges.by_lower_end() {
            let place = |side: u32| (side as usize / 3, side as usize % 3);
            // Each face of a side covers half a turn around it: both weigh the same.
            let sum: Vector3<f32> = same.iter().map(|s| self.faces[place(s.1).0]).sum();
            for (t, k) in same.iter().map(|s| place(s.1)) {
                self.sides[t][k] = sum;
            }
            match *same {
                [(b, side)] => {
                    let (t, k) = place(side);
                    self.open[t] |= 1 << k;
                    open_vertices[a as usize] = true;
                    open_vertices[b as usize] = true;
                }
                // A walk crosses only sides of two triangles; with more, its direction would be ambiguous.
                [(_, one), (_, other)] => {
                    let (t, k) = place(one);
                    let (u, l) = place(other);
                    (self.across[t][k], self.across[u][l]) = (u as u32, t as u32);
                }
                _ => {}
            }
        }
        for (t, corners) in self.triangles.iter().enumerate() {
            for k in 0..3 {
                self.open[t] |= u8::from(open_vertices[corners[k] as usize]) << (3 + k);
            }
        }
    }

    /// Unit normal of a triangle; zero without area.
    pub(crate) fn face_normal(&self, triangle: usize) -> &Vector3<f32> {
        &self.faces[triangle]
    }

    /// Normal of a feature, not normalized.
    pub(crate) fn feature_normal(&self, triangle: usize, feature: Feature) -> Vector3<f32> {
        match feature {
            Feature::Face => self.faces[triangle],
            Feature::Edge(i) => self.sides[triangle][i as usize],
            Feature::Corner(i) => self.vertices[self.triangles[triangle][i as usize] as usize],
        }
    }

    /// Whether a feature lies on the border of an open mesh.
    pub(crate) fn is_open(&self, triangle: usize, feature: Feature) -> bool {
        match feature {
            Feature::Face => false,
            Feature::Edge(i) => self.open[triangle] >> i & 1 == 1,
            Feature::Corner(i) => self.open[triangle] >> (3 + i) & 1 == 1,
        }
    }

    /// Squared distance of a point to a triangle.
    pub(crate) fn squared_distance(&self, p: &Vector3<f32>, triangle: u32) -> f32 {
        (p - closest_on_triangle(p, &self.corners[triangle as usize]).0).norm_squared()
    }

    fn closest_feature(&self, p: &Vector3<f32>, triangle: u32) -> ClosestFeature {
        let (q, feature) = closest_on_triangle(p, &self.corners[triangle as usize]);
        ClosestFeature { distance2: (p - q).norm_squared(), triangle, feature }
    }

    /// Walks over the mesh from the closer of two triangles to ever closer neighbors of the point, until
    /// there is none; returns the last triangle.
    pub(crate) fn nearest_by_walk(&self, p: &Vector3<f32>, starts: [u32; 2]) -> u32 {
        let mut best = self.closest_feature(p, starts[0]);
        if starts[1] != starts[0] {
            let other = self.closest_feature(p, starts[1]);
            if other.distance2 < best.distance2 {
                best = other;
            }
        }
        for _ in 0..MAX_STEPS {
            let before = best.distance2;
            let t = best.triangle as usize;
            match best.feature {
                Feature::Face => break,
                Feature::Edge(i) => {
                    let next = self.across[t][i as usize];
                    if next != NONE {
                        let other = self.closest_feature(p, next);
                        if other.distance2 < best.distance2 {
                            best = other;
                        }
                    }
                }
                Feature::Corner(i) => {
                    let corner = self.corners[t][i as usize];
                    let away = p - corner;
                    for &next in self.rings.list_at(self.triangles[t][i as usize]) {
                        // The corner is the closest point of this triangle too, unless one of its sides leads
                        // closer to the query.
                        if self.corners[next as usize].iter().all(|c| away.dot(&(c - corner)) <= 0.0) {
                            continue;
                        }
                        let other = self.closest_feature(p, next);
                        if other.distance2 < best.distance2 {
                            best = other;
                        }
                    }
                }
            }
            if best.distance2 >= before {
                break;
            }
        }
        best.triangle
    }
}
