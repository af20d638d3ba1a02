//! Triangle meshes.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use geometry::{Pose, bounding_box, box_corners};

/// An indexed triangle mesh; triangles turn counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TriangleMesh {
    /// Vertex positions, meters.
    #[serde(with = "geometry::bytes")]
    pub vertices: Vec<Point3<f32>>,
    /// Vertex indices.
    #[serde(with = "geometry::bytes")]
    pub triangles: Vec<[u32; 3]>,
    /// sRGB color per vertex; empty where there is none.
    #[serde(with = "geometry::bytes")]
    pub colors: Vec<[u8; 3]>,
}

impl TriangleMesh {
    /// An axis-aligned box of twelve triangles; its vertices are [`box_corners`].
    pub fn cuboid(lower: &Point3<f32>, upper: &Point3<f32>) -> Self {
        let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        Self { vertices: box_corners(lower, upper).to_vec(), triangles, colors: Vec::new() }
    }

    /// Whether there is no triangle.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The three corners of a triangle.
    pub fn corners(&self, triangle: usize) -> [Point3<f32>; 3] {
        self.triangles[triangle].map(|i| self.vertices[i as usize])
    }

    /// The middle of a triangle's corners.
    pub fn middle_of(&self, triangle: usize) -> Point3<f64> {
        Point3::from(
            self.corners(triangle).iter().map(|p| p.coords.cast::<f64>()).sum::<Vector3<f64>>() / 3.0,
        )
    }

    /// Twice the area times the unit normal of a triangle.
    pub fn area_normal(&self, triangle: usize) -> Vector3<f32> {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(&(c - a))
    }

    /// Surface area, square meters.
    pub fn area_m2(&self) -> f64 {
        (0..self.triangles.len()).map(|t| 0.5 * f64::from(self.area_normal(t).norm())).sum()
    }

    /// Lower and upper corner of the axis-aligned bounding box; `None` without vertices.
    pub fn bounds(&self) -> Option<(Point3<f32>, Point3<f32>)> {
        bounding_box(self.vertices.iter().copied())
    }

    /// Sides of the triangles, three each in their order: start, end and triangle.
    pub fn sides(&self) -> impl Iterator<Item = (u32, u32, u32)> + Clone + '_ {
        let numbered = self.triangles.iter().zip(0..);
        numbered.flat_map(|(&[a, b, c], t)| [(a, b, t), (b, c, t), (c, a, t)])
    }

    /// The mesh moved by a rigid motion.
    #[must_use]
    pub fn transformed(&self, target_from_source: &Pose) -> Self {
        let m: nalgebra::Isometry3<f32> = target_from_source.cast();
        Self { vertices: self.vertices.iter().map(|p| m * p).collect(), ..self.clone() }
    }
}
