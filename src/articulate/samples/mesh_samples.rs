//! Evenly spread points on a mesh, with smooth normals and colors.

use nalgebra::{Point3, Vector3};

use crate::observations::SurfaceSamples;
use surface::TriangleMesh;

/// Rounds in which vertex normals are averaged with those of the vertices around them.
const NORMAL_ROUNDS: usize = 2;

/// About `count` points on a mesh, one for every equal share of its area in the order of the triangles
/// (systematic sampling: the same mesh gives the same points). Normals are area-weighted vertex normals,
/// averaged over neighbors; colors are interpolated, mid gray without vertex colors.
pub fn mesh_samples(mesh: &TriangleMesh, count: usize) -> SurfaceSamples {
    let normals = smooth_normals(mesh);
    let step = mesh.area_m2() / count.max(1) as f64;
    let mut samples = SurfaceSamples::default();
    // One sample for each step of area: systematic sampling is uniform even over many small triangles.
    let mut reached = 0.0;
    let mut next = 0.5 * step;
    let mut index = 0u32;
    for (t, corners) in mesh.triangles.iter().enumerate() {
        reached += 0.5 * f64::from(mesh.area_normal(t).norm());
        while next < reached && step > 0.0 {
            let [a, b] = plastic_point(index);
            index = index.wrapping_add(1);
            // The other half of the unit square is folded onto the triangle.
            let [a, b] = if a + b > 1.0 { [1.0 - a, 1.0 - b] } else { [a, b] };
            let weights = [1.0 - a - b, a, b];
            let corners = corners.map(|v| v as usize);
            let normal = weighted_sum(corners.map(|v| normals[v]), weights);
            if let Some(normal) = normal.try_normalize(1e-9) {
                let point = weighted_sum(corners.map(|v| mesh.vertices[v].coords.cast()), weights);
                samples.points.push(Point3::from(point));
                samples.normals.push(normal);
                let rgb = weighted_sum(corners.map(|v| vertex_color(mesh, v)), weights);
                samples.colors.push([rgb.x as f32, rgb.y as f32, rgb.z as f32]);
            }
            next += step;
        }
    }
    samples
}

fn weighted_sum(values: [Vector3<f64>; 3], weights: [f64; 3]) -> Vector3<f64> {
    values.into_iter().zip(weights).map(|(value, w)| value * w).sum()
}

/// Color of a vertex in `[0, 1]`; mid gray without vertex colors.
fn vertex_color(mesh: &TriangleMesh, vertex: usize) -> Vector3<f64> {
    Vector3::from(mesh.colors.get(vertex).map_or([0.5; 3], |c| c.map(|x| f64::from(x) / 255.0)))
}

/// The plastic number.
///
/// derived: the real root of x^3 = x + 1
const PLASTIC: f64 = 1.324_717_957_244_746;

/// Low-discrepancy points of the unit square (Roberts' R2 sequence).
fn plastic_point(index: u32) -> [f64; 2] {
    let i = f64::from(index) + 0.5;
    [(i / PLASTIC).fract(), (i / (PLASTIC * PLASTIC)).fract()]
}

/// Unit vertex normals; zero at vertices without triangles.
fn smooth_normals(mesh: &TriangleMesh) -> Vec<Vector3<f64>> {
    let mut normals = vec![Vector3::zeros(); mesh.vertices.len()];
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let normal: Vector3<f64> = mesh.area_normal(t).cast();
        // The normal is twice as long as the area: small triangles count little.
        corners.iter().for_each(|&v| normals[v as usize] += normal);
    }
    make_unit(&mut normals);
    for _ in 0..NORMAL_ROUNDS {
        // Marching cubes leaves steps, which normals show more than positions do.
        let mut sums = normals.clone();
        for corners in &mesh.triangles {
            let sum: Vector3<f64> = corners.iter().map(|&v| normals[v as usize]).sum();
            corners.iter().for_each(|&v| sums[v as usize] += sum);
        }
        normals = sums;
        make_unit(&mut normals);
    }
    normals
}

/// Scales vectors to length 1; vectors without length become zero.
fn make_unit(vectors: &mut [Vector3<f64>]) {
    vectors.iter_mut().for_each(|v| *v = v.try_normalize(1e-15).unwrap_or_default());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_spread_over_a_sphere_with_radial_normals() {
        let mut mesh = TriangleMesh::default();
        let rings = 24u32;
        let steps = 48u32;
        for r in 0..=rings {
            for s in 0..steps {
                let a = std::f32::consts::PI * r as f32 / rings as f32;
                let b = std::f32::consts::TAU * s as f32 / steps as f32;
                mesh.vertices.push(Point3::new(a.sin() * b.cos(), a.sin() * b.sin(), a.cos()));
                mesh.colors.push([255, 0, (255.0 * (0.5 + 0.5 * a.cos())) as u8]);
            }
        }
        let at = |r: u32, s: u32| r * steps + s % steps;
        for r in 0..rings {
            for s in 0..steps {
                mesh.triangles.push([at(r, s), at(r + 1, s), at(r + 1, s + 1)]);
                mesh.triangles.push([at(r, s), at(r + 1, s + 1), at(r, s + 1)]);
            }
        }
        let samples = mesh_samples(&mesh, 4000);
        assert!((3990..=4000).contains(&samples.points.len()));
        for (p, n) in samples.points.iter().zip(&samples.normals) {
            assert!((p.coords.norm() - 1.0).abs() < 0.01 && n.dot(&p.coords) > 0.99);
        }
        // Equal areas hold equal numbers: half of a sphere lies within z of +-0.5.
        let middle = samples.points.iter().filter(|p| p.z.abs() < 0.5).count();
        assert!((1950..2050).contains(&middle), "{middle}");
        assert!(
            samples
                .points
                .iter()
                .zip(&samples.colors)
                .all(|(p, c)| (f64::from(c[2]) - 0.5 - 0.5 * p.z).abs() < 0.02)
        );
        assert_eq!(mesh_samples(&mesh, 4000).points, samples.points);
    }

    #[test]
    fn an_empty_mesh_has_no_samples() {
        assert!(mesh_samples(&TriangleMesh::default(), 100).points.is_empty());
    }
}
