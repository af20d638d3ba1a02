//! Mass properties of thin shells.

use nalgebra::{Matrix3, Point3, Vector3};

/// Mass, center of mass and inertia.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShellInertia {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Center of mass, meters.
    pub center_of_mass: Point3<f64>,
    /// Inertia about the center of mass, kg m^2.
    pub inertia: Matrix3<f64>,
}

/// Mass properties of triangles of one density, each with its thickness in meters (docs/method.md 10.2: a
/// reconstructed surface need not be closed, its volume is meaningless). `None` if the area, a thickness or
/// the density is not positive and finite.
///
/// With `m` and `n` the mass and normal of a triangle with corners `v_i`, the second moment is the sum of `m
/// / 12 * (s s^T + sum_i v_i v_i^T)`, `s = sum_i v_i` (exact on the triangle), and `m thickness^2 / 12 * n
/// n^T` across it; the inertia is `tr(C) I - C`. An isotropic addition of `1e-3` of the thickness term makes
/// it positive definite and fulfil the triangle inequality for any triangles.
pub(crate) fn plates_inertia(
    plates: impl Iterator<Item = ([Vector3<f64>; 3], f64)>,
    density_kg_m3: f64,
) -> Option<ShellInertia> {
    let mut plates = plates.peekable();
    // Relative to a point of the first triangle: far from the origin digits would be lost.
    let origin = plates.peek()?.0[0];
    let mut mass = 0.0;
    let mut first = Vector3::zeros();
    let mut second = Matrix3::zeros();
    for (corners, thickness_m) in plates {
        let surface_density = thickness_m * density_kg_m3;
        if !(thickness_m > 0.0 && surface_density > 0.0 && surface_density.is_finite()) {
            return None;
        }
        let [a, b, c] = corners.map(|p| p - origin);
        let area_normal = (b - a).cross(&(c - a));
        let Some(normal) = area_normal.try_normalize(0.0) else { continue };
        let m = 0.5 * area_normal.norm() * surface_density;
        let sum = a + b + c;
        mass += m;
        first += sum * (m / 3.0);
        // docs/method.md (10.3): the triangle, then its thickness.
        second +=
            (sum * sum.transpose() + a * a.transpose() + b * b.transpose() + c * c.transpose()) * (m / 12.0);
        second += (normal * normal.transpose() + Matrix3::identity() * 1e-3)
            * (m * thickness_m * thickness_m / 12.0);
    }
    if !(mass > 0.0 && mass.is_finite()) {
        return None;
    }
    let center: Vector3<f64> = first / mass;
    // Moved from this point to the center of mass (parallel axes).
    let central = second - center * center.transpose() * mass;
    let inertia = Matrix3::identity() * central.trace() - central;
    Some(ShellInertia {
        mass_kg: mass,
        center_of_mass: Point3::from(origin + center),
        // Symmetric to the last bit.
        inertia: (inertia + inertia.transpose()) * 0.5,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        TriangleMesh, merged_mesh,
        shapes::{box_mesh, sphere_mesh},
    };
    use geometry::Pose;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    /// All of a mesh with one thickness.
    fn shell_inertia(mesh: &TriangleMesh, thickness_m: f64, density_kg_m3: f64) -> Option<ShellInertia> {
        let corners = |t: usize| mesh.corners(t).map(|p| p.coords.cast::<f64>());
        plates_inertia((0..mesh.triangles.len()).map(|t| (corners(t), thickness_m)), density_kg_m3)
    }

    fn quad(half_x: f32, half_y: f32) -> TriangleMesh {
        let vertices =
            [[-half_x, -half_y, 0.0], [half_x, -half_y, 0.0], [half_x, half_y, 0.0], [-half_x, half_y, 0.0]];
        TriangleMesh {
            vertices: vertices.map(Point3::from).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            colors: Vec::new(),
        }
    }

    #[test]
    fn a_sphere_shell() {
        let shell = shell_inertia(&sphere_mesh(0.3, 200), 0.002, 600.0).unwrap();
        let mass = 4.0 * PI * 0.09 * 0.002 * 600.0;
        assert!((shell.mass_kg / mass - 1.0).abs() < 1e-3);
        assert!(shell.center_of_mass.coords.norm() < 1e-6);
        assert!(
            (shell.inertia - Matrix3::identity() * (2.0 / 3.0 * mass * 0.09)).norm() < 2e-3 * mass * 0.09
        );
    }

    #[test]
    fn a_plate_is_a_solid_plate() {
        let shell = shell_inertia(&quad(0.2, 0.1), 0.02, 500.0).unwrap();
        let mass = 0.4 * 0.2 * 0.02 * 500.0;
        let solid = Vector3::new(0.04 + 0.0004, 0.16 + 0.0004, 0.04 + 0.16) * (mass / 12.0);
        assert!((shell.mass_kg - mass).abs() < 1e-6);
        // The isotropic share adds 2e-3 of the thickness term.
        assert!((shell.inertia - Matrix3::from_diagonal(&solid)).norm() < 3e-3 * mass * 0.0004);
    }

    #[test]
    fn nothing_to_weigh_is_refused() {
        let mut line = quad(0.1, 0.1);
        line.triangles = vec![[0, 1, 1]];
        assert!(shell_inertia(&line, 0.002, 600.0).is_none());
        assert!(shell_inertia(&TriangleMesh::default(), 0.002, 600.0).is_none());
        for (thickness, density) in [(0.0, 600.0), (0.002, -1.0), (f64::NAN, 600.0), (0.002, f64::INFINITY)] {
            assert!(shell_inertia(&quad(0.1, 0.1), thickness, density).is_none());
        }
    }

    fn is_valid(inertia: &Matrix3<f64>) -> bool {
        let e = inertia.symmetric_eigenvalues();
        e.min() > 0.0 && e.sum() - e.max() > e.max()
    }

    #[test]
    fn a_sliver_has_a_valid_inertia() {
        assert!(is_valid(&shell_inertia(&quad(1.0, 1e-6), 0.001, 600.0).unwrap().inertia));
        assert!(is_valid(&shell_inertia(&quad(0.3, 0.3), 1e-5, 600.0).unwrap().inertia));
    }

    proptest! {
        #[test]
        fn moving_the_mesh_moves_its_mass(
            t in prop::array::uniform3(-2.0..2.0f64),
            w in prop::array::uniform3(-2.0..2.0f64),
        ) {
            let mesh = merged_mesh(&[&box_mesh(Vector3::new(0.1, 0.2, 0.3)), &quad(0.4, 0.1)]);
            let motion = Pose::new(t.into(), w.into());
            let at = shell_inertia(&mesh, 0.004, 600.0).unwrap();
            let moved = shell_inertia(&mesh.transformed(&motion), 0.004, 600.0).unwrap();
            prop_assert!((at.mass_kg / moved.mass_kg - 1.0).abs() < 1e-5);
            prop_assert!((motion * at.center_of_mass - moved.center_of_mass).norm() < 1e-5);
            let r = motion.rotation.to_rotation_matrix();
            prop_assert!((r * at.inertia * r.transpose() - moved.inertia).norm() < 1e-4 * at.inertia.norm());
            prop_assert!(is_valid(&moved.inertia));
        }
    }
}
