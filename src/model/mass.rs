//! Mass properties of collision solids.

use nalgebra::{Matrix3, Point3, Vector3};

use super::Inertial;
use crate::surface::{ConvexSolid, Plane};

/// Points per solid that its mass is taken at.
const POINTS: u32 = 1024;
/// Bases of the low-discrepancy sequence that places them.
const BASES: [u32; 3] = [2, 3, 5];

/// Mass, center and inertia of the union of solids of one density; where solids overlap, mass counts once.
/// `None` without volume or with a density that is not positive. See docs/method.md (10.2).
///
/// Every solid is filled with points of equal volume (Halton sequence in its tetrahedra); a point that lies
/// in `n` solids counts `1/n`. As a sum of point masses the inertia is positive and fulfils the triangle
/// inequality.
#[must_use]
pub fn solids_inertial(solids: &[ConvexSolid], density_kg_m3: f64, assumption: &str) -> Option<Inertial> {
    if !(density_kg_m3 > 0.0 && density_kg_m3.is_finite()) {
        return None;
    }
    let planes: Vec<Vec<Plane>> = solids.iter().map(ConvexSolid::planes).collect();
    // At least one: rounding may leave a point outside its own solid.
    let holders =
        |p: &Point3<f64>| planes.iter().filter(|s| s.iter().all(|q| q.distance_m(p) <= 1e-9)).count().max(1);
    let mut masses: Vec<(f64, Vector3<f64>)> = Vec::new();
    for solid in solids {
        let each = density_kg_m3 * solid.volume_m3() / f64::from(POINTS);
        masses.extend(interior_points(solid).iter().map(|p| (each / holders(p) as f64, p.coords)));
    }
    let mass_kg: f64 = masses.iter().map(|(m, _)| m).sum();
    if !(mass_kg > 0.0 && mass_kg.is_finite()) {
        return None;
    }
    // docs/method.md (10.2).
    let center = masses.iter().map(|(m, p)| p * *m).sum::<Vector3<f64>>() / mass_kg;
    let second: Matrix3<f64> = masses.iter().map(|(m, p)| (p - center) * (p - center).transpose() * *m).sum();
    let inertia = Matrix3::identity() * second.trace() - second;
    Some(Inertial {
        mass_kg,
        center_of_mass: center.into(),
        inertia: (inertia + inertia.transpose()) * 0.5,
        assumption: assumption.to_owned(),
        mass_range_kg: [mass_kg; 2],
    })
}

/// [`POINTS`] points that fill a solid evenly.
fn interior_points(solid: &ConvexSolid) -> Vec<Point3<f64>> {
    let parts: Vec<(f64, [Point3<f64>; 4])> = solid.tetrahedra().filter(|(v, _)| *v > 0.0).collect();
    let total: f64 = parts.iter().map(|(v, _)| v).sum();
    let (mut points, mut before, mut part) = (Vec::with_capacity(POINTS as usize), 0.0, 0);
    for k in 0..POINTS {
        // Tetrahedra take turns in proportion to their volume.
        let place = total * (f64::from(k) + 0.5) / f64::from(POINTS);
        while part + 1 < parts.len() && before + parts[part].0 < place {
            before += parts[part].0;
            part += 1;
        }
        let Some((_, corners)) = parts.get(part) else { break };
        // Sorted uniform numbers are the cuts of a unit length into four even weights.
        // From 1: number 0 is a corner in every base.
        let mut cuts = BASES.map(|base| halton(k + 1, base));
        cuts.sort_by(f64::total_cmp);
        let weights = [cuts[0], cuts[1] - cuts[0], cuts[2] - cuts[1], 1.0 - cuts[2]];
        points
            .push(Point3::from(corners.iter().zip(weights).map(|(c, w)| c.coords * w).sum::<Vector3<f64>>()));
    }
    points
}

/// The digits of `index` in a base, mirrored at the point.
fn halton(mut index: u32, base: u32) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0);
    while index > 0 {
        digit /= f64::from(base);
        value += digit * f64::from(index % base);
        index /= base;
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cuboid(lower: [f64; 3], upper: [f64; 3]) -> ConvexSolid {
        ConvexSolid::cuboid(&lower.into(), &upper.into())
    }

    #[test]
    fn a_box_weighs_and_turns_as_one() {
        let found = solids_inertial(&[cuboid([1.0, 0.0, 0.0], [1.4, 0.2, 0.1])], 500.0, "").unwrap();
        assert!((found.mass_kg - 4.0).abs() < 1e-9);
        assert!((found.center_of_mass - Point3::new(1.2, 0.1, 0.05)).norm() < 2e-3);
        for (k, expected) in [(0, 0.05), (1, 0.17), (2, 0.2)] {
            assert!(
                (found.inertia[(k, k)] / (4.0 / 12.0 * expected) - 1.0).abs() < 0.03,
                "{k}: {}",
                found.inertia
            );
        }
    }

    #[test]
    fn what_overlaps_counts_once() {
        let whole = solids_inertial(&[cuboid([0.0; 3], [1.0, 1.0, 1.0])], 100.0, "").unwrap();
        let twice = [
            cuboid([0.0; 3], [0.7, 1.0, 1.0]),
            cuboid([0.3, 0.0, 0.0], [1.0, 1.0, 1.0]),
            cuboid([0.0; 3], [0.7, 1.0, 1.0]),
        ];
        let found = solids_inertial(&twice, 100.0, "").unwrap();
        assert!((found.mass_kg / whole.mass_kg - 1.0).abs() < 0.01, "{}", found.mass_kg);
        assert!((found.center_of_mass - whole.center_of_mass).norm() < 0.01);
        assert!(solids_inertial(&[], 100.0, "").is_none() && solids_inertial(&twice, 0.0, "").is_none());
    }
}
