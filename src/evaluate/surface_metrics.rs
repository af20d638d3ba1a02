//! Distances between surfaces.

use nalgebra::Point3;
use rand_core::Rng;
use rayon::prelude::*;

use super::distance::MeshDistance;
use geometry::NearestPoints;
use numeric::random::unit_uniform;
use surface::TriangleMesh;

/// `count` points drawn uniformly by area from a mesh; empty if the mesh has no area.
#[must_use]
pub(crate) fn sample_surface(mesh: &TriangleMesh, count: usize, rng: &mut impl Rng) -> Vec<Point3<f64>> {
    let mut sum = 0.0;
    let cumulative: Vec<f64> = (0..mesh.triangles.len())
        .map(|t| {
            sum += f64::from(mesh.area_normal(t).norm());
            sum
        })
        .collect();
    if sum <= 0.0 {
        return Vec::new();
    }
    let mut points = Vec::with_capacity(count);
    for _ in 0..count {
        let at = unit_uniform(rng) * sum;
        let triangle = cumulative.partition_point(|&c| c <= at).min(cumulative.len() - 1);
        let [a, b, c] = mesh.corners(triangle).map(|p| p.cast::<f64>());
        let mut u = unit_uniform(rng);
        let mut v = unit_uniform(rng);
        // The other half of the parallelogram is folded back, so the density is uniform.
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        points.push(a + (b - a) * u + (c - a) * v);
    }
    points
}

/// Chamfer distance as published, 1e-3 m^2: mean squared distance from `a` to the nearest point of `b`, plus
/// the same from `b` to `a`, times 1000: docs/method.md (13.2). `None` if a set is empty.
#[must_use]
pub(crate) fn chamfer_distance(a: &[Point3<f64>], b: &[Point3<f64>]) -> Option<f64> {
    Some(1000.0 * (mean_squared_m2(a, b)? + mean_squared_m2(b, a)?))
}

fn mean_squared_m2(from: &[Point3<f64>], to: &[Point3<f64>]) -> Option<f64> {
    let tree = NearestPoints::new(to);
    // Computed in parallel but summed in order: the sum does not depend on the number of threads.
    let squared: Option<Vec<f64>> =
        from.par_iter().map(|p| tree.nearest_one(p).map(|(_, d)| d * d)).collect();
    mean_of(&squared?)
}

/// Mean distance from points to a mesh, millimeters; `None` without points or triangles.
#[must_use]
pub(crate) fn mean_distance_mm(points: &[Point3<f64>], mesh: &TriangleMesh) -> Option<f64> {
    if mesh.is_empty() {
        return None;
    }
    let distance = MeshDistance::new(mesh);
    let distances: Vec<f64> = points.par_iter().map(|p| distance.distance_m(p)).collect();
    Some(1000.0 * mean_of(&distances)?)
}

/// Mean, summed in the order of the values; `None` without values.
pub(super) fn mean_of(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::example::box_mesh;
    use numeric::random::stage_rng;

    #[test]
    fn samples_lie_on_the_surface_by_area() {
        // Area by face pair: 2 * (1*2 + 1*3 + 2*3) = 22; the two x faces have 12.
        let mesh = box_mesh([0.0; 3], [1.0, 2.0, 3.0], [0; 3]);
        let points = sample_surface(&mesh, 20_000, &mut stage_rng(1, "test", 0));
        let on_x = points.iter().filter(|p| p.x.abs() < 1e-9 || (p.x - 1.0).abs() < 1e-9).count() as f64;
        assert!((on_x / 20_000.0 - 12.0 / 22.0).abs() < 0.015, "{on_x}");
        let middle = points.iter().fold(nalgebra::Vector3::zeros(), |s, p| s + p.coords) / 20_000.0;
        assert!((middle - nalgebra::Vector3::new(0.5, 1.0, 1.5)).norm() < 0.02);
        assert!(mean_distance_mm(&points, &mesh).unwrap() < 1e-4);
        assert!(sample_surface(&TriangleMesh::default(), 10, &mut stage_rng(1, "test", 0)).is_empty());
    }

    #[test]
    fn chamfer_of_a_square_has_the_known_floor() {
        // docs/method.md (13.3): two samplings of the same surface of A square meters are 0.0637 A apart.
        let mut square = box_mesh([0.0; 3], [1.0; 3], [0; 3]);
        square.triangles.truncate(2);
        let draw = |k| sample_surface(&square, 10_000, &mut stage_rng(3, "test", k));
        let floor = chamfer_distance(&draw(0), &draw(1)).unwrap();
        assert!((floor - 0.0637).abs() < 0.003, "{floor}");
    }

    #[test]
    fn chamfer_is_the_sum_of_both_squared_directions() {
        let a = [Point3::origin(), Point3::new(0.0, 0.0, 1.0)];
        let b = [Point3::new(0.1, 0.0, 0.0)];
        // a to b: (0.01 + 1.01) / 2; b to a: 0.01.
        assert!((chamfer_distance(&a, &b).unwrap() - 520.0).abs() < 1e-9);
        assert_eq!(chamfer_distance(&a, &[]), None);
    }
}
