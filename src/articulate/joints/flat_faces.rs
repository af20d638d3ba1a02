//! Finds the directions of the flat faces of a surface from its normals.

use nalgebra::{Matrix3, Unit, Vector3};

use crate::{joints::square_axes::SeenDirection, observations::SurfaceSamples};

/// Normals within this angle belong to one face. No other face is looked for within twice the angle.
///
/// tuned: random objects (eval/random_objects.md)
const NEAR_DEG: f64 = 4.0;
/// Smallest share of the surface in a face: larger faces were found to be true to .3 degrees, smaller ones to
/// be tilted by a degree.
///
/// tuned: random objects (eval/random_objects.md)
const LEAST_SHARE: f64 = 0.1;
/// Least ratio of the normals near a face's direction to those in the ring of twice the angle around it; for
/// a cylinder the two numbers are equal.
///
/// tuned: random objects (eval/random_objects.md)
const CONTRAST: f64 = 3.0;
/// Number of normals tried.
const TRIED: usize = 300;
/// Standard deviation of a face's direction: errors of a fused surface are correlated over a face.
///
/// tuned: random objects (eval/random_objects.md)
const STD_DEG: f64 = 0.15;

/// The directions of large flat faces, largest first; opposite faces count as one.
pub(crate) fn flat_faces(surface: &SurfaceSamples) -> Vec<SeenDirection> {
    let [near, ring] = [NEAR_DEG, 2.0 * NEAR_DEG].map(|d| d.to_radians().cos());
    let normals = &surface.normals;
    let mut open: Vec<&Vector3<f64>> = normals.iter().step_by(normals.len().div_ceil(TRIED).max(1)).collect();
    let mut faces = Vec::new();
    while let Some((count, start)) =
        open.iter().map(|d| (count_near(normals, d, near), **d)).reduce(|a, b| if b.0 > a.0 { b } else { a })
    {
        if count < LEAST_SHARE * normals.len() as f64 {
            break;
        }
        let face = mean_normal_near(normals, start, near);
        let count = count_near(normals, &face, near);
        // A bent side has as many normals in the ring as in the middle; those of a flat face fall off
        // sharply.
        if count > CONTRAST * (count_near(normals, &face, ring) - count) {
            let across = Matrix3::identity() - face.into_inner() * face.transpose();
            faces.push(SeenDirection { direction: face, covariance: across * STD_DEG.to_radians().powi(2) });
        }
        // Normals nearby start no other face, whether this one was kept or not, so the search ends.
        open.retain(|n| n.dot(&face).abs() < ring && n.dot(&start).abs() < ring);
    }
    faces
}

/// Number of normals within an angle (given by its cosine) of a direction or its opposite: opposite faces of
/// a body show one direction.
fn count_near(normals: &[Vector3<f64>], direction: &Vector3<f64>, cosine: f64) -> f64 {
    normals.iter().filter(|n| n.dot(direction).abs() > cosine).count() as f64
}

/// Mean of the normals, or their opposites, near a direction.
fn mean_normal_near(normals: &[Vector3<f64>], start: Vector3<f64>, near: f64) -> Unit<Vector3<f64>> {
    (0..10).fold(Unit::new_normalize(start), |d, _| {
        let sum: Vector3<f64> =
            normals.iter().filter(|n| n.dot(&d).abs() > near).map(|n| n * n.dot(&d).signum()).sum();
        Unit::try_new(sum, 1e-9).unwrap_or(d)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface(normals: Vec<Vector3<f64>>) -> SurfaceSamples {
        SurfaceSamples {
            points: vec![nalgebra::Point3::origin(); normals.len()],
            colors: vec![[0.5; 3]; normals.len()],
            normals,
        }
    }

    #[test]
    fn a_box_with_a_round_post_has_the_faces_of_the_box() {
        let mut normals = Vec::new();
        for k in 0..600 {
            // Rough by a degree, without a pattern that adds up.
            let rough =
                Vector3::new((k as f64 * 0.7).sin(), (k as f64 * 1.3).sin(), (k as f64 * 2.1).sin()) * 0.015;
            let face = [Vector3::z(), -Vector3::z(), Vector3::x()][k % 3];
            normals.push((face + rough).normalize());
            let turn = 0.01 * k as f64;
            normals.push(Vector3::new(turn.cos(), turn.sin(), 0.0));
        }
        let faces = flat_faces(&surface(normals));
        assert_eq!(faces.len(), 2);
        assert!(
            faces[0].direction.cross(&Vector3::z()).norm() < 3e-3
                && faces[1].direction.cross(&Vector3::x()).norm() < 5e-3
        );
    }

    #[test]
    fn a_ball_has_no_faces() {
        let normals = (0..2000).map(|k| {
            let z = 1.0 - (k as f64 + 0.5) / 1000.0;
            let turn = 2.4 * k as f64;
            Vector3::new((1.0f64 - z * z).sqrt() * turn.cos(), (1.0f64 - z * z).sqrt() * turn.sin(), z)
        });
        assert!(flat_faces(&surface(normals.collect())).is_empty());
        assert!(flat_faces(&SurfaceSamples::default()).is_empty());
    }
}
