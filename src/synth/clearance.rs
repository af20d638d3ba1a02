//! Collision tests of parts with each other and the floor.

use nalgebra::Vector3;

use super::{Object, Solid};
use geometry::Pose;

/// Largest overlap that does not count as a collision, meters. chosen: less than any gap
const TOUCH_M: f64 = 0.0005;
/// Number of intermediate steps between the states.
const STEPS: usize = 6;

/// Whether no part collides with another or the floor in the states or between them, with all joints moving
/// evenly. Cylinders are tested as boxes. A part may overlap its parent: pins go through links, and caps hold
/// necks.
pub(super) fn is_free(object: &Object) -> bool {
    (0..=STEPS).all(|step| {
        let poses = object.rest_from_parts(step as f64 / STEPS as f64);
        (0..object.parts.len()).all(|a| {
            is_above_floor(object, &poses, a)
                && (0..a).all(|b| object.are_pinned(a, b) || are_apart(object, &poses, a, b))
        })
    })
}

fn is_above_floor(object: &Object, poses: &[Pose], part: usize) -> bool {
    object.parts[part].solids.iter().all(|s| lowest_height(&(poses[part] * s.part_from_solid), s) > -TOUCH_M)
}

fn are_apart(object: &Object, poses: &[Pose], a: usize, b: usize) -> bool {
    object.parts[a].solids.iter().all(|s| {
        let pose_a = poses[a] * s.part_from_solid;
        object.parts[b].solids.iter().all(|t| !do_overlap(&pose_a, s, &(poses[b] * t.part_from_solid), t))
    })
}

fn lowest_height(pose: &Pose, solid: &Solid) -> f64 {
    let half = solid.shape.half_sides();
    let up = pose.rotation.inverse() * Vector3::z();
    pose.translation.vector.z - up.abs().dot(&half)
}

/// Separating axis test of two boxes (Gottschalk, Lin and Manocha 1996), each shrunk by half the allowed
/// overlap.
fn do_overlap(pose_a: &Pose, a: &Solid, pose_b: &Pose, b: &Solid) -> bool {
    let [half_a, half_b] = [a, b].map(|s| s.shape.half_sides().map(|h| (h - 0.5 * TOUCH_M).max(0.0)));
    let between = pose_b.translation.vector - pose_a.translation.vector;
    // The bounding spheres decide most pairs.
    if between.norm() > half_a.norm() + half_b.norm() {
        return false;
    }
    let [axes_a, axes_b] =
        [pose_a, pose_b].map(|p| [Vector3::x(), Vector3::y(), Vector3::z()].map(|e| p.rotation * e));
    let crosses = axes_a.iter().flat_map(|u| axes_b.iter().map(move |v| u.cross(v)));
    for along in axes_a.iter().chain(&axes_b).copied().chain(crosses) {
        let reach = reach_along(&axes_a, &half_a, &along) + reach_along(&axes_b, &half_b, &along);
        // Parallel edges have no cross product; the face axes cover that case.
        if along.norm_squared() > 1e-12 && between.dot(&along).abs() > reach {
            return false;
        }
    }
    true
}

/// Half the extent of a box along a direction, meters.
fn reach_along(axes: &[Vector3<f64>; 3], half: &Vector3<f64>, along: &Vector3<f64>) -> f64 {
    (0..3).map(|k| half[k] * axes[k].dot(along).abs()).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Material;

    #[test]
    fn boxes_meet_or_not() {
        let material = Material::plain(Vector3::zeros());
        let cube = Solid::box_between([-0.1; 3], [0.1; 3], &material);
        let at = |x: f64, y: f64, yaw: f64| Pose::new(Vector3::new(x, y, 0.0), Vector3::z() * yaw);
        let meet = |p: Pose| do_overlap(&Pose::identity(), &cube, &p, &cube);
        assert!(meet(at(0.19, 0.0, 0.0)) && !meet(at(0.2, 0.0, 0.0)));
        // A cube on its edge reaches farther along x and less at the corner.
        assert!(
            meet(at(0.23, 0.0, std::f64::consts::FRAC_PI_4))
                && !meet(at(0.245, 0.0, std::f64::consts::FRAC_PI_4))
        );
        assert!(meet(at(0.19, 0.19, 0.0)) && !meet(at(0.19, 0.19, std::f64::consts::FRAC_PI_4)));
        assert!((lowest_height(&at(0.0, 0.0, 1.0), &cube) + 0.1).abs() < 1e-12);
    }
}
