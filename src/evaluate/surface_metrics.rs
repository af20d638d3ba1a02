//! Distances between surfaces.

use nalgebra::Point3;
use rand_core::Rng;
use rayon::prelude::*;

use geometry::NearestPoints;
use surface::{MeshDistance, TriangleMesh, sample_surface};

/// `count` points drawn uniformly by area from a mesh; empty if the mesh has no area.
pub(crate) fn points_on_surface(mesh: &TriangleMesh, count: usize, rng: &mut impl Rng) -> Vec<Point3<f64>> {
    sample_surface(mesh, count, rng).points.iter().map(|p| p.cast()).collect()
}

/// Chamfer distance as published, 1e-3 m^2: mean squared distance from `a` to the nearest point of `b`, plus
/// the same from `b` to `a`, times 1000: docs/method.md (13.2). `None` if a set is empty.
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
pub(crate) fn mean_distance_mm(points: &[Point3<f64>], mesh: &TriangleMesh) -> Option<f64> {
    let points: Vec<Point3<f32>> = points.iter().map(|p| p.cast()).collect();
    let distances: Vec<f64> =
        MeshDistance::new(mesh)?.distances_m(&points).into_iter().map(f64::from).collect();
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
    fn a_surface_is_at_no_distance_from_its_samples() {
        let mesh = box_mesh([0.0; 3], [1.0, 2.0, 3.0], [0; 3]);
        let points = points_on_surface(&mesh, 2000, &mut stage_rng(1, "test", 0));
        assert!(mean_distance_mm(&points, &mesh).unwrap() < 1e-3);
        assert_eq!(mean_distance_mm(&points, &TriangleMesh::default()), None);
        assert_eq!(mean_distance_mm(&[], &mesh), None);
    }

    #[test]
    fn chamfer_of_a_square_has_the_known_floor() {
        // docs/method.md (13.3): two samplings of the same surface of A square meters are 0.0637 A apart.
        let mut square = box_mesh([0.0; 3], [1.0; 3], [0; 3]);
        square.triangles.truncate(2);
        let draw = |k| points_on_surface(&square, 10_000, &mut stage_rng(3, "test", k));
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
