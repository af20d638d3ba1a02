//! Cuts a mesh into patches that are flat to a tolerance.

use std::collections::VecDeque;

use nalgebra::{Point3, Vector3};

use super::{TriangleMesh, edges::Edges};

/// Cosine of the largest angle of a triangle to its patch, and to the patch's first triangle.
/// chosen: 35 degrees
const MIN_COSINE: f64 = 0.82;

/// Triangles near one plane, joined by sides.
#[derive(Clone, Debug)]
pub(crate) struct Patch {
    /// Triangles, ascending.
    pub triangles: Vec<u32>,
    /// Mean normal, pointing out of the object.
    pub normal: Vector3<f64>,
    /// Center of area.
    pub center: Point3<f64>,
    /// Area, square meters.
    pub area_m2: f64,
}

/// Sums over the triangles of a patch.
#[derive(Default)]
struct Sums {
    normal: Vector3<f64>,
    center: Vector3<f64>,
    area: f64,
}

impl Sums {
    fn add_triangle(&mut self, area_normal: &Vector3<f64>, corners: &[Point3<f64>; 3]) {
        let area = 0.5 * area_normal.norm();
        self.normal += area_normal * 0.5;
        self.center += corners.iter().map(|p| p.coords).sum::<Vector3<f64>>() * (area / 3.0);
        self.area += area;
    }
}

/// Patches, each grown from the largest free triangle over neighbors whose corners are within `tolerance_m`
/// of the patch's plane; largest area first.
pub(crate) fn grown_patches(mesh: &TriangleMesh, tolerance_m: f64) -> Vec<Patch> {
    let count = mesh.triangles.len();
    let corners: Vec<[Point3<f64>; 3]> = (0..count).map(|t| mesh.corners(t).map(|p| p.cast())).collect();
    let normals: Vec<Vector3<f64>> = corners.iter().map(|[a, b, c]| (b - a).cross(&(c - a))).collect();
    let neighbors = Edges::of_mesh(mesh).neighbors(mesh.triangles.len(), |_| true);
    let mut order: Vec<usize> = (0..count).filter(|&t| normals[t].norm() > 0.0).collect();
    // Large triangles have the most reliable normals: patches start there. Equal ones are ordered by index.
    order.sort_by(|a, b| normals[*b].norm_squared().total_cmp(&normals[*a].norm_squared()).then(a.cmp(b)));
    let mut taken = vec![false; count];
    let mut found = Vec::new();
    for seed in order {
        if taken[seed] {
            continue;
        }
        let mut sums = Sums::default();
        let mut triangles = Vec::new();
        let mut queue = VecDeque::from([seed]);
        taken[seed] = true;
        let first = normals[seed].normalize();
        while let Some(t) = queue.pop_front() {
            triangles.push(t as u32);
            sums.add_triangle(&normals[t], &corners[t]);
            // The plane is updated with every triangle.
            let normal = sums.normal.normalize();
            let center = sums.center / sums.area;
            for &n in &neighbors[t] {
                let n = n as usize;
                let least = MIN_COSINE * normals[n].norm();
                // Compared with the first triangle as well: around a cylinder small turns would add up.
                let is_turned = normals[n].dot(&normal) < least || normals[n].dot(&first) < least;
                if !taken[n]
                    && !is_turned
                    && corners[n].iter().all(|p| (p.coords - center).dot(&normal).abs() <= tolerance_m)
                {
                    taken[n] = true;
                    queue.push_back(n);
                }
            }
        }
        triangles.sort_unstable();
        let normal = sums.normal.normalize();
        let center = Point3::from(sums.center / sums.area);
        found.push(Patch { triangles, normal, center, area_m2: sums.area });
    }
    found.sort_by(|a, b| b.area_m2.total_cmp(&a.area_m2));
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::{box_mesh, sphere_mesh};

    #[test]
    fn a_box_has_six() {
        let found = grown_patches(&box_mesh(Vector3::new(0.3, 0.2, 0.1)), 0.002);
        assert_eq!(found.len(), 6);
        assert!((found[0].area_m2 - 0.24).abs() < 1e-6 && found[0].normal.z.abs() > 0.999);
    }

    #[test]
    fn a_sphere_has_as_many_as_the_tolerance_asks_for() {
        let mesh = sphere_mesh(0.3, 60);
        let few = grown_patches(&mesh, 0.03);
        let many = grown_patches(&mesh, 0.003);
        assert!(few.len() < many.len(), "{} {}", few.len(), many.len());
        assert_eq!(many.iter().map(|p| p.triangles.len()).sum::<usize>(), mesh.triangles.len());
    }
}
