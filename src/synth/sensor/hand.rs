//! A hand in front of the object in some views: fingers, palm and forearm.

use std::f64::consts::PI;

use nalgebra::{Point3, Vector3};
use rand_core::Rng;

use crate::{Material, Solid};
use geometry::Pose;
use numeric::random;

/// Share of the views with a hand. chosen: few
const SHARE: f64 = 0.1;
/// Range of the finger tips' depth, share of the distance to the object's center.
/// chosen: well in front of the object
const DEPTH_SHARE: [f64; 2] = [0.5, 0.7];
/// Range of the finger tips' offset from the object's center in the image, share of its radius.
/// chosen: from the middle to the rim
const ASIDE_SHARE: [f64; 2] = [0.3, 0.9];
/// Slope of the arm towards the camera, from the fingers on. chosen: 20 degrees
const TOWARDS: f64 = 0.35;
/// Dimensions of a hand, meters, about those of an adult. chosen: usual ones
const FINGER_M: f64 = 0.075;
const FINGER_RADIUS_M: f64 = 0.008;
const FINGER_GAP_M: f64 = 0.021;
const PALM_M: f64 = 0.095;
const PALM_RADIUS_M: f64 = 0.014;
const FOREARM_M: f64 = 0.3;
const FOREARM_RADIUS_M: f64 = 0.032;
/// Fingers beside the thumb.
const FINGERS: usize = 4;
/// Linear color of skin. chosen: light skin in lamp light
const SKIN: Vector3<f64> = Vector3::new(0.55, 0.30, 0.21);

/// The hand of a view, in the world frame; empty in most views. The arm enters from below or from a side.
pub(super) fn drawn_hand(
    level: f64,
    world_from_camera: &Pose,
    center: &Point3<f64>,
    radius_m: f64,
    rng: &mut impl Rng,
) -> Vec<Solid> {
    // Drawn first: the level decides only whether there is a hand, not where.
    let is_there = random::unit_uniform(rng) < level * SHARE;
    let share = random::uniform_in(rng, DEPTH_SHARE[0], DEPTH_SHARE[1]);
    let aside = random::uniform_in(rng, ASIDE_SHARE[0], ASIDE_SHARE[1]);
    let (down, right) = random::uniform_in(rng, 0.0, PI).sin_cos();
    if !is_there {
        return Vec::new();
    }
    let seen = world_from_camera.inverse() * center;
    // The image's y axis points down.
    let out = Vector3::new(right, down, 0.0);
    let tip = Point3::from(seen.coords * share + out * (aside * radius_m * share));
    let back = (out - Vector3::z() * TOWARDS).normalize();
    let across = Vector3::z().cross(&back).normalize();
    let skin = Material::plain(SKIN);
    // Radius, meters, and both ends, in the camera's frame.
    let mut capsules = Vec::new();
    for finger in 0..FINGERS {
        let beside = across * (FINGER_GAP_M * (finger as f64 - 0.5 * (FINGERS - 1) as f64));
        let knuckle = tip + back * FINGER_M + beside;
        // Fingers are bent at the middle joint, with tips away from the camera.
        let bent = tip + back * (0.5 * FINGER_M) + beside - Vector3::z() * (0.15 * FINGER_M);
        capsules.push((FINGER_RADIUS_M, tip + beside * 0.8, bent));
        capsules.push((FINGER_RADIUS_M, bent, knuckle));
        capsules.push((PALM_RADIUS_M, knuckle, tip + back * (FINGER_M + PALM_M) + beside * 0.7));
    }
    let thumb = tip + back * (0.9 * FINGER_M) - across * (2.6 * FINGER_GAP_M);
    capsules.push((1.2 * FINGER_RADIUS_M, thumb, tip + back * (FINGER_M + 0.7 * PALM_M)));
    let wrist = tip + back * (FINGER_M + PALM_M);
    capsules.push((FOREARM_RADIUS_M, wrist + back * (0.5 * FOREARM_RADIUS_M), wrist + back * FOREARM_M));
    capsules
        .into_iter()
        .map(|(radius_m, from, to)| {
            Solid::capsule(radius_m, world_from_camera * from, world_from_camera * to, &skin)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    #[test]
    fn a_share_of_the_views_has_a_hand_between_camera_and_object() {
        let center = Point3::new(0.1, 0.2, 0.3);
        let camera = Pose::face_towards(&Point3::new(1.4, 0.3, 0.9), &center, &-Vector3::z());
        for level in [0.0, 1.0, 2.0] {
            let mut views = 0;
            for seed in 0..2000 {
                let solids = drawn_hand(level, &camera, &center, 0.4, &mut stage_rng(seed, "hand", 0));
                let Some(finger) = solids.first() else { continue };
                views += 1;
                let tip = camera.inverse() * Point3::from(finger.part_from_solid.translation.vector);
                assert!(tip.z > 0.3 && tip.z < 1.1, "{tip}");
            }
            assert!((f64::from(views) / 2000.0 - 0.1 * level).abs() < 0.02, "{views}");
        }
    }
}
