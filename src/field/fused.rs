//! The fused distances of a state, for training its field.

use nalgebra::{Point3, Vector3};

use geometry::Grid3;

/// Share of the truncation up to which fused distances are exact.
///
/// chosen: one, less rounding
const CUT: f32 = 0.999;

/// Whether a view from `eye` (world) sees the surface from the same side as a point, by the gradient of the
/// fused distances (docs/method.md 3.4); true if no surface is near. Behind a wall thinner than the
/// truncation, its readings would push the other side outwards. `distance_m` is NaN where nothing was
/// observed.
pub(super) fn sees_side(
    distance_m: &Grid3<f32>,
    truncation_m: f64,
    place: &Point3<f64>,
    eye: &Point3<f64>,
) -> bool {
    let (distance_m, slope) = distance_m.sample_with_gradient(place);
    let near = distance_m.abs() < CUT * truncation_m as f32;
    let toward: Vector3<f32> = (eye - place).cast();
    // Negated, so that an unknown gradient excludes no side.
    !near || !(slope.dot(&toward) < 0.0)
}

/// The distances in truncations; unobserved nodes take the value of a nearby observed one, by propagation
/// between neighbors. All -1 without observed nodes.
pub(super) fn extended_distances(distance_m: &Grid3<f32>, truncation_m: f64) -> Grid3<f32> {
    let values = distance_m.values.iter().map(|d| d / truncation_m as f32).collect();
    let mut grid =
        Grid3 { origin: distance_m.origin, spacing_m: distance_m.spacing_m, dims: distance_m.dims, values };
    let [nx, ny, nz] = grid.dims;
    // Breadth first in order of the nodes: nearest first, and independent of the number of threads.
    let mut front: Vec<usize> = (0..grid.values.len()).filter(|&i| grid.values[i].is_finite()).collect();
    while !front.is_empty() {
        let mut next = Vec::new();
        for &i in &front {
            let [x, y, z] = grid.coordinates(i);
            let neighbors = [
                (x > 0).then(|| i - 1),
                (x + 1 < nx).then_some(i + 1),
                (y > 0).then(|| i - nx),
                (y + 1 < ny).then_some(i + nx),
                (z > 0).then(|| i - nx * ny),
                (z + 1 < nz).then_some(i + nx * ny),
            ];
            for n in neighbors.into_iter().flatten() {
                if grid.values[n].is_nan() {
                    grid.values[n] = grid.values[i];
                    next.push(n);
                }
            }
        }
        front = next;
    }
    grid.values.iter_mut().filter(|v| v.is_nan()).for_each(|v| *v = -1.0);
    grid
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::SceneBox;

    /// A plate between z = -0.02 and z = 0.02, known down to its middle from both sides, and for x < 0 alone.
    fn plate() -> Grid3<f32> {
        let scene = SceneBox::around_box(&Point3::new(-0.5, -0.5, -0.5), &Point3::new(0.5, 0.5, 0.5));
        let mut grid = Grid3::over_scene(&scene, 101, f32::NAN);
        for i in 0..grid.values.len() {
            let p = grid.position_of_index(i);
            if p.x < 0.0 {
                grid.values[i] = ((p.z.abs() - 0.02).min(0.1)) as f32;
            }
        }
        grid
    }

    #[test]
    fn a_view_sees_the_side_that_it_is_on() {
        let grid = plate();
        let above = Point3::new(-0.2, 0.0, 0.8);
        let sees = |z: f64| sees_side(&grid, 0.1, &Point3::new(-0.2, 0.05, z), &above);
        assert!(sees(0.05) && sees(0.01) && !sees(-0.01) && !sees(-0.05));
        assert!(sees(-0.3), "too far from the plate to say");
        assert!(sees_side(&grid, 0.1, &Point3::new(0.2, 0.0, -0.05), &above), "nothing is known there");
    }

    #[test]
    fn unknown_nodes_take_the_value_of_a_known_one_nearby() {
        let grid = plate();
        let all = extended_distances(&grid, 0.1);
        for i in 0..all.values.len() {
            let p = grid.position_of_index(i);
            let expected = ((p.z.abs() - 0.02).min(0.1) / 0.1) as f32;
            assert!((all.values[i] - expected).abs() < 1e-6, "{p}: {} for {expected}", all.values[i]);
        }
        let none = Grid3 { values: vec![f32::NAN; grid.values.len()], ..grid };
        assert!(extended_distances(&none, 0.1).values.iter().all(|v| *v == -1.0));
    }
}
