//! Highlights: reflections of bulbs on the object, in half of the views.
//!
//! A room has more bright things than a model of it: lamps, windows, screens. So in each view a point on the
//! object is drawn, and the bulb is placed in its mirror direction.

use nalgebra::{Point3, Vector3};
use rand_core::Rng;

use crate::{BoundingSphere, Scene};
use geometry::Pose;
use numeric::random;

/// Share of the views with a reflection. chosen: half
const SHARE: f64 = 0.5;
/// Range of a bulb's distance, in radii of the object. chosen: within a room
const DISTANCE_RADII: [f64; 2] = [1.5, 4.0];
/// Brightness of a bulb's reflection relative to a white surface. chosen: near white
const SHINE: f64 = 0.7;
/// Most rays tried to find a point on the object.
const TRIES: usize = 20;

/// Position of a bulb mirrored by the object in a view; `None` in views without one.
pub(super) fn drawn_bulb(
    scene: &Scene,
    world_from_camera: &Pose,
    &BoundingSphere { center, radius_m }: &BoundingSphere,
    rng: &mut impl Rng,
) -> Option<Point3<f64>> {
    if !random::is_chosen(rng, SHARE) {
        return None;
    }
    let eye = Point3::from(world_from_camera.translation.vector);
    let distance_m = radius_m * random::uniform_in(rng, DISTANCE_RADII[0], DISTANCE_RADII[1]);
    (0..TRIES).find_map(|_| {
        let aim = center
            + random::random_direction(rng).into_inner() * (0.8 * radius_m * random::unit_uniform(rng));
        let ray = (aim - eye).normalize();
        let sight = scene.first_sight(&eye, &ray, f64::INFINITY).filter(|s| s.part.is_some())?;
        // A bulb along the mirrored ray is seen at this point.
        let mirrored: Vector3<f64> = ray - sight.normal * (2.0 * ray.dot(&sight.normal));
        Some(eye + ray * sight.at + mirrored * distance_m)
    })
}

/// Linear brightness of a reflection.
pub(super) fn bulb_brightness(level: f64) -> f64 {
    level * SHINE
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Light, Material, SynthConfig, generate};
    use numeric::random::stage_rng;

    #[test]
    fn half_of_the_views_mirror_a_bulb_in_the_object() {
        let object = generate(&SynthConfig::default()).unwrap();
        let floor = Material::plain(Vector3::repeat(0.3));
        let scene = Scene::new(&object, 0, &floor, 3.0);
        let sphere = object.bounding_sphere();
        let BoundingSphere { center, radius_m } = sphere;
        let eye = center + Vector3::new(2.0, 1.0, 1.2) * radius_m;
        let camera = Pose::face_towards(&eye, &center, &-Vector3::z());
        let mut views = 0;
        for seed in 0..400 {
            let rng = &mut stage_rng(seed, "bulb", 0);
            let Some(bulb) = drawn_bulb(&scene, &camera, &sphere, rng) else { continue };
            views += 1;
            // Some ray to the object meets the middle of the highlight.
            let light = Light { bulbs: vec![bulb], ..Light::from_lamp(Vector3::z()) };
            let brightest = (0..4000).map(|_| {
                let aim = center
                    + random::random_direction(rng).into_inner()
                        * (0.8 * radius_m * random::unit_uniform(rng));
                let ray = (aim - eye).normalize();
                let sight = scene.first_sight(&eye, &ray, f64::INFINITY).filter(|s| s.part.is_some());
                sight.map_or(0.0, |s| light.gloss_at(&eye, &(eye + ray * s.at), &s.normal))
            });
            let brightest = brightest.fold(0.0, f64::max);
            assert!(brightest > 0.8, "{brightest}");
        }
        assert!((170..230).contains(&views), "{views}");
    }
}
