//! Closes holes in flat faces and narrow bays of their borders.

use nalgebra::Vector3;

use super::{
    bays::{Bay, bays_of_rim},
    fill::{Fill, SeenEmpty},
    loops::border_loops,
    reach::Neighbors,
    sheet::Sheet,
};
use crate::vertex_normals;

/// Closes the holes and bays of a sheet; returns their number.
pub(super) fn close_holes(sheet: &mut Sheet, voxel_m: f64, is_seen_empty: SeenEmpty<'_>) -> usize {
    let mesh = &sheet.mesh;
    let Some(loops) = border_loops(mesh) else { return 0 };
    let neighbors = Neighbors::of_mesh(mesh);
    let normals: Vec<Vector3<f64>> = vertex_normals(mesh).iter().map(|n| n.cast()).collect();
    let mut fill = Fill::new(mesh, &neighbors, voxel_m, is_seen_empty);
    let mut count = 0;
    for rim in &loops {
        if fill.fill_gap(rim, false, std::iter::empty()) {
            count += 1;
            continue;
        }
        // Inner vertices of the filled bays.
        let mut is_filled = vec![false; rim.len()];
        for Bay { from, sides, .. } in bays_of_rim(mesh, rim, &normals, voxel_m) {
            let at = |k: usize| (from + k) % rim.len();
            if (0..=sides).any(|k| is_filled[at(k)]) {
                continue;
            }
            let bay: Vec<u32> = (0..=sides).map(|k| rim[at(k)]).collect();
            let others = (sides + 1..rim.len()).map(|k| rim[at(k)]);
            if fill.fill_gap(&bay, true, others) {
                (1..sides).for_each(|k| is_filled[at(k)] = true);
                count += 1;
            }
        }
    }
    let triangles = fill.triangles;
    sheet.is_assumed.extend(triangles.iter().map(|_| true));
    sheet.mesh.triangles.extend(triangles);
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TriangleMesh, borders::plates::plate, edge_defects};
    use nalgebra::Point3;

    /// A plate with a lace of holes of one to three cells, without those that touch another.
    fn lace() -> Sheet {
        let hole = |x: u32, y: u32| {
            let i = x / 8;
            let j = y / 8;
            let size = 1 + (i + 2 * j) % 3;
            (x % 8).wrapping_sub(3) < size && (y % 8).wrapping_sub(3) < size
        };
        Sheet::of_mesh(&plate(40, 32, |x, y| !hole(x, y)))
    }

    #[test]
    fn a_lace_closes_and_says_what_it_assumed() {
        let mut sheet = lace();
        let seen_m2 = sheet.mesh.area_m2();
        assert_eq!(close_holes(&mut sheet, 1.0, &|_| false), 20);
        assert!((sheet.mesh.area_m2() - 40.0 * 32.0).abs() < 1e-3);
        assert!((sheet.assumed_m2() - (40.0 * 32.0 - seen_m2)).abs() < 1e-3);
        assert_eq!(edge_defects(&sheet.mesh).non_manifold, 0);
        assert_eq!(border_loops(&sheet.mesh).unwrap().len(), 1);
        assert!((0..sheet.mesh.triangles.len()).all(|t| sheet.mesh.area_normal(t).z > 0.0));
    }

    #[test]
    fn a_hole_that_was_seen_through_stays() {
        let mut sheet = lace();
        // One point of the largest hole is enough.
        let open = |p: &Point3<f64>| (p - Point3::new(20.5, 4.5, 0.0)).norm() < 0.5;
        let filled = close_holes(&mut sheet, 1.0, &open);
        assert_eq!(filled, 19);
        assert_eq!(border_loops(&sheet.mesh).unwrap().len(), 2);
    }

    #[test]
    fn wide_holes_slots_tubes_and_outer_borders_stay() {
        let wide = plate(40, 40, |x, y| !((8..30).contains(&x) && (8..30).contains(&y)));
        let slot = plate(60, 20, |x, y| !((10..50).contains(&x) && y == 9));
        let small = plate(3, 3, |_, _| true);
        for mesh in [wide, slot, small] {
            assert_eq!(close_holes(&mut Sheet::of_mesh(&mesh), 1.0, &|_| false), 0);
        }
        // A tube of ten sides has two open ends, each small.
        let ring = |k: u32, z: f32| {
            let angle = k as f32 * std::f32::consts::TAU / 10.0;
            Point3::new(1.5 * angle.cos(), 1.5 * angle.sin(), z)
        };
        let vertices = (0..6).flat_map(|z| (0..10).map(move |k| ring(k, z as f32))).collect();
        let cell = |z: u32, k: u32| {
            let [a, b] = [10 * z + k, 10 * z + (k + 1) % 10];
            [[a, b, b + 10], [a, b + 10, a + 10]]
        };
        let triangles = (0..5).flat_map(|z| (0..10).flat_map(move |k| cell(z, k))).collect();
        let tube = TriangleMesh { vertices, triangles, colors: Vec::new() };
        assert_eq!(border_loops(&tube).unwrap().len(), 2);
        assert_eq!(close_holes(&mut Sheet::of_mesh(&tube), 1.0, &|_| false), 0);
    }
}
