//! Random points on a surface.

use nalgebra::{Point3, Vector3};
use rand_core::Rng;

use super::TriangleMesh;
use numeric::random::unit_uniform;

/// Points on a mesh; the three lists run in parallel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceSamples {
    /// Positions, meters.
    pub points: Vec<Point3<f32>>,
    /// Unit normals of the triangles they lie on.
    pub normals: Vec<Vector3<f32>>,
    /// Interpolated colors; empty where the mesh has none.
    pub colors: Vec<[u8; 3]>,
    /// Triangles they lie on.
    pub triangles: Vec<u32>,
}

/// `count` points, uniform over the area; none on a mesh without area.
pub fn sample_surface(mesh: &TriangleMesh, count: usize, rng: &mut impl Rng) -> SurfaceSamples {
    let mut cumulative = Vec::with_capacity(mesh.triangles.len());
    let mut total = 0.0;
    for t in 0..mesh.triangles.len() {
        total += f64::from(mesh.area_normal(t).norm());
        cumulative.push(total);
    }
    let mut samples = SurfaceSamples::default();
    if !(total > 0.0 && total.is_finite()) {
        return samples;
    }
    for _ in 0..count {
        let at = unit_uniform(rng) * total;
        // The first triangle whose end lies beyond; triangles without area have no width.
        let t = cumulative.partition_point(|&end| end <= at).min(cumulative.len() - 1);
        // Uniform on the triangle (Osada et al. 2002).
        let root = unit_uniform(rng).sqrt();
        let v = unit_uniform(rng);
        let shares = [1.0 - root, root * (1.0 - v), root * v].map(|s| s as f32);
        let [a, b, c] = mesh.corners(t);
        samples.points.push(Point3::from(a.coords * shares[0] + b.coords * shares[1] + c.coords * shares[2]));
        samples.normals.push(mesh.area_normal(t).try_normalize(0.0).unwrap_or_default());
        samples.triangles.push(t as u32);
        if mesh.colors.len() == mesh.vertices.len() {
            let colors = mesh.triangles[t].map(|i| mesh.colors[i as usize]);
            samples.colors.push(
                [0, 1, 2]
                    .map(|k| (0..3).map(|i| shares[i] * f32::from(colors[i][k])).sum::<f32>().round() as u8),
            );
        }
    }
    samples
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::{box_mesh, color_of};
    use numeric::random::stage_rng;

    #[test]
    fn samples_are_uniform_over_the_area() {
        let half = Vector3::new(0.1f32, 0.2, 0.3);
        let mut mesh = box_mesh(half);
        mesh.colors = mesh.vertices.iter().map(|p| color_of(&p.cast())).collect();
        let samples = sample_surface(&mesh, 40_000, &mut stage_rng(1, "sample", 0));
        let mut counts = [0.0; 3];
        for ((p, n), color) in samples.points.iter().zip(&samples.normals).zip(&samples.colors) {
            let axis = n.iamax();
            counts[axis] += 1.0;
            assert!((p[axis] - n[axis] * half[axis]).abs() < 1e-6);
            let expected = color_of(&p.cast());
            assert!((0..3).all(|k| color[k].abs_diff(expected[k]) <= 1));
        }
        let areas = [0.06, 0.03, 0.02];
        for k in 0..3 {
            assert!((counts[k] / 40_000.0 - areas[k] / 0.11f64).abs() < 0.01);
        }
        let mean: Vector3<f32> = samples.points.iter().map(|p| p.coords).sum::<Vector3<f32>>() / 40_000.0;
        assert!(mean.norm() < 0.005);
        assert_eq!(samples, sample_surface(&mesh, 40_000, &mut stage_rng(1, "sample", 0)));
    }

    #[test]
    fn no_area_gives_no_samples() {
        let mut mesh = box_mesh(Vector3::repeat(0.1));
        mesh.triangles = vec![[0, 0, 1]];
        assert!(sample_surface(&mesh, 10, &mut stage_rng(1, "sample", 0)).points.is_empty());
        assert!(
            sample_surface(&TriangleMesh::default(), 10, &mut stage_rng(1, "sample", 0)).points.is_empty()
        );
    }
}
