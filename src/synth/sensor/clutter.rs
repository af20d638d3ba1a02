//! Clutter: boxes and cans on the floor around the object, the same in every state; some are dark.

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector3};
use rand_core::Rng;

use crate::{Material, Solid};
use geometry::Pose;
use numeric::random;

/// Number of things.
const THINGS: usize = 5;
/// Range of half sides, relative to half the diagonal of the object's box; the highest stay below the camera
/// path. chosen: usual things around an object
const HALF_RADII: [f64; 2] = [0.08, 0.2];
/// Range of the gap to that box, in the same unit. chosen: near enough to be seen with it
const GAP_RADII: [f64; 2] = [0.05, 0.6];
/// Share of dark things, and their reflectance. chosen: most, as these cost depth
const DARK_SHARE: f64 = 0.6;
const DARK: f64 = 0.03;

/// Random things on the floor around a box.
pub(super) fn drawn_things(room: &[Point3<f64>; 2], floor_z_m: f64, rng: &mut impl Rng) -> Vec<Solid> {
    let [lower, upper] = room;
    let center = nalgebra::center(lower, upper);
    let half_m = (upper - lower) * 0.5;
    let radius_m = half_m.norm();
    let mut things = Vec::with_capacity(THINGS);
    for k in 0..THINGS {
        let half = Vector3::from_fn(|_, _| radius_m * random::uniform_in(rng, HALF_RADII[0], HALF_RADII[1]));
        // One thing per sector, so that none overlap.
        let azimuth = TAU * (k as f64 + random::uniform_in(rng, 0.1, 0.9)) / THINGS as f64;
        let gap_m = radius_m * random::uniform_in(rng, GAP_RADII[0], GAP_RADII[1]);
        let yaw = random::uniform_in(rng, 0.0, TAU);
        let is_dark = random::is_chosen(rng, DARK_SHARE);
        let tone = random::uniform_in(rng, 0.2, 0.7);
        let hue = Vector3::from_fn(|_, _| random::uniform_in(rng, 0.5, 1.0));
        let is_can = random::is_chosen(rng, 0.4);
        let seed = random::index_below(rng, 1 << 30) as u32;
        // From the box's border outward by the gap plus the thing's extent at any yaw.
        let out = Vector3::new(azimuth.cos(), azimuth.sin(), 0.0);
        let border_m = (half_m.x / out.x.abs()).min(half_m.y / out.y.abs());
        let at = center.coords + out * border_m + out.map(f64::signum) * (half.xy().norm() + gap_m);
        let base = if is_dark { Vector3::repeat(DARK) } else { hue * tone };
        let material = Material {
            base,
            second: if is_dark { base } else { base * 0.4 },
            wavelength_m: (!is_dark).then(|| Vector3::repeat(0.3 * radius_m)),
            seed,
            lacquer: None,
            sheen: 0.0,
        };
        let stands = Pose::new(Vector3::new(at.x, at.y, floor_z_m + half.z), Vector3::z() * yaw);
        things.push(if is_can {
            Solid::cylinder(half.x, half.z, stands, &material)
        } else {
            Solid { part_from_solid: stands, ..Solid::box_between((-half).into(), half.into(), &material) }
        });
    }
    things
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    #[test]
    fn things_stand_on_the_floor_outside_the_box() {
        let room = [Point3::new(-0.3, -0.5, 0.006), Point3::new(0.6, 0.2, 0.8)];
        for seed in 0..50 {
            let things = drawn_things(&room, 0.0, &mut stage_rng(seed, "clutter", 0));
            assert_eq!(things.len(), THINGS);
            for thing in things {
                let at = thing.part_from_solid.translation.vector;
                let half = thing.shape.half_sides();
                assert!((at.z - half.z).abs() < 1e-12);
                let gap = (0..2).map(|k| (room[0][k] - at[k]).max(at[k] - room[1][k]));
                assert!(gap.fold(f64::NEG_INFINITY, f64::max) > half.xy().norm(), "{at}");
            }
        }
    }
}
