//! A handheld camera and its effects on a recording.

use nalgebra::{Point3, Vector3};
use rand_pcg::Pcg64Mcg;

use super::{
    Effect, HandheldSensor, clutter, color_shift, depth_loss, depth_noise, depth_scale, depth_warp, exposure,
    flying_pixels, hand, highlights, lamp, motion_blur, pose_drift, pose_jitter, pose_lag, relocalization,
    vignetting,
};
use crate::{BoundingSphere, DepthErrors, Light, Scene, Solid, View};
use geometry::{Intrinsics, Pose};
use numeric::random::stage_rng;

/// A random camera with its systematic errors, the same in all of its recordings.
#[derive(Clone, Debug, PartialEq)]
pub struct HandheldCamera {
    /// Effects and their level.
    pub sensor: HandheldSensor,
    /// Relative error of its depth.
    pub depth_scale: f64,
    /// Further relative depth error of each pixel, row-major; empty for none.
    pub depth_warp: Vec<f64>,
    /// Offset of color against depth, pixels.
    pub color_shift_px: [f64; 2],
    /// Delay of the reported poses against the images, seconds.
    pub lag_s: f64,
    seed: u64,
}

/// Pose errors of one take.
#[derive(Clone, Debug, PartialEq)]
pub struct TakePoses {
    /// From the true world to the world of the take.
    pub relocalization: Pose,
    /// Drift of odometry at each view: from the true to the reported world.
    pub drift: Vec<Pose>,
    /// Further independent error of each reported pose, in the camera's frame.
    pub jitter: Vec<Pose>,
}

impl HandheldCamera {
    /// A random camera. Every effect draws from its own stream, so that switching one or changing the level
    /// does not change the others.
    pub fn drawn(sensor: HandheldSensor, k: &Intrinsics, seed: u64) -> Self {
        let rng = |effect| effect_stream(seed, "camera", effect, 0);
        let mut warp = Vec::new();
        // Skipped without the effect, since a field of zeros would cost as much.
        let warp_level = sensor.level_of(Effect::DepthWarp);
        if warp_level > 0.0 {
            warp = depth_warp::warp_field(warp_level, k.width, k.height, &mut rng(Effect::DepthWarp));
        }
        Self {
            sensor,
            depth_scale: depth_scale::drawn_scale_error(
                sensor.level_of(Effect::DepthScale),
                &mut rng(Effect::DepthScale),
            ),
            depth_warp: warp,
            color_shift_px: color_shift::drawn_shift_px(
                sensor.level_of(Effect::ColorShift),
                k.width,
                &mut rng(Effect::ColorShift),
            ),
            lag_s: pose_lag::drawn_lag_s(sensor.level_of(Effect::PoseLag), &mut rng(Effect::PoseLag)),
            seed,
        }
    }

    fn effect_level(&self, effect: Effect) -> f64 {
        self.sensor.level_of(effect)
    }

    fn effect_rng(&self, take: usize, effect: Effect, step: usize) -> Pcg64Mcg {
        effect_stream(self.seed, &format!("take{take}"), effect, step)
    }

    /// Objects on the floor around the box of an object, the same in all takes.
    pub fn clutter_solids(&self, room: &[Point3<f64>; 2], floor_z_m: f64) -> Vec<Solid> {
        if !self.sensor.has(Effect::Clutter) {
            return Vec::new();
        }
        clutter::drawn_things(room, floor_z_m, &mut effect_stream(self.seed, "room", Effect::Clutter, 0))
    }

    /// The hand in front of the object in a view; empty in most views.
    pub fn hand_solids(
        &self,
        take: usize,
        view: usize,
        world_from_camera: &Pose,
        sphere: &BoundingSphere,
    ) -> Vec<Solid> {
        let rng = &mut self.effect_rng(take, Effect::Hand, view);
        hand::drawn_hand(
            self.effect_level(Effect::Hand),
            world_from_camera,
            &sphere.center,
            sphere.radius_m,
            rng,
        )
    }

    /// The illumination of a view, for an object with a bounding sphere; `lamp` is the direction in take 0.
    pub fn light_of_view(
        &self,
        take: usize,
        i: usize,
        lamp: &Vector3<f64>,
        scene: &Scene,
        world_from_camera: &Pose,
        sphere: &BoundingSphere,
    ) -> Light {
        let mut light = Light::from_lamp(*lamp);
        if take > 0 {
            let rng = &mut self.effect_rng(take, Effect::Light, 0);
            (light.lamp, light.tint) = lamp::turned_lamp(self.effect_level(Effect::Light), lamp, rng);
        }
        if !self.has_bulbs() {
            return light;
        }
        // Reflections of bulbs lose depth even if the color does not show them.
        let rng = &mut self.effect_rng(take, Effect::Highlights, i);
        light.bulbs = highlights::drawn_bulb(scene, world_from_camera, sphere, rng).into_iter().collect();
        light.shine = highlights::bulb_brightness(self.effect_level(Effect::Highlights));
        light
    }

    fn has_bulbs(&self) -> bool {
        [Effect::Highlights, Effect::DepthLoss].iter().any(|e| self.effect_level(*e) > 0.0)
    }

    /// Errors of the poses of a take with true poses `cameras`.
    pub fn pose_errors(&self, take: usize, cameras: &[Pose]) -> TakePoses {
        let world = relocalization::drawn_relocalization(
            self.effect_level(Effect::Relocalization),
            &mut self.effect_rng(take, Effect::Relocalization, 0),
        );
        let level = self.effect_level(Effect::PoseJitter);
        let jitter = (0..cameras.len())
            .map(|i| pose_jitter::drawn_jitter(level, &mut self.effect_rng(take, Effect::PoseJitter, i)))
            .collect();
        TakePoses {
            // Take 0 defines the world; the others are displaced from it.
            relocalization: if take == 0 { Pose::identity() } else { world },
            drift: pose_drift::drift_walk(
                self.effect_level(Effect::PoseDrift),
                cameras,
                &mut self.effect_rng(take, Effect::PoseDrift, 0),
            ),
            jitter,
        }
    }

    /// Depth errors of a view.
    pub fn depth_errors(&self, take: usize, i: usize, view: &View, k: &Intrinsics) -> DepthErrors {
        let at = |effect: Effect| (self.effect_level(effect), self.effect_rng(take, effect, i));
        let mut errors = DepthErrors::default();
        if self.depth_scale != 0.0 || !self.depth_warp.is_empty() {
            errors.factor = (0..k.width * k.height)
                .map(|p| 1.0 + self.depth_scale + self.depth_warp.get(p).copied().unwrap_or(0.0))
                .collect();
        }
        let (level, mut rng) = at(Effect::DepthNoise);
        if level > 0.0 {
            errors.disparity_px = depth_noise::disparity_noise(level, k.width, k.height, &mut rng);
        }
        let (level, mut rng) = at(Effect::DepthLoss);
        if level > 0.0 {
            errors.lost = depth_loss::lost_pixels(level, view, &mut rng);
        }
        let (level, mut rng) = at(Effect::FlyingPixels);
        if level > 0.0 {
            errors.between_m = flying_pixels::between_m(level, view, k, &mut rng);
        }
        errors
    }

    /// Factor on linear red, green and blue for a view.
    pub fn color_gain(&self, take: usize, i: usize) -> Vector3<f64> {
        exposure::drawn_gain(
            self.effect_level(Effect::Exposure),
            &mut self.effect_rng(take, Effect::Exposure, i),
        )
    }

    /// Linear colors of a view at the imager; `velocity` is the camera's in its optical frame.
    pub fn colors_of_view(
        &self,
        take: usize,
        i: usize,
        view: &View,
        k: &Intrinsics,
        velocity: &[Vector3<f64>; 2],
    ) -> Vec<Vector3<f64>> {
        // On linear color, as blur and gain act on light before encoding.
        let mut colors = view.color.clone();
        if self.effect_level(Effect::MotionBlur) > 0.0 {
            colors = motion_blur::blurred_colors(
                self.effect_level(Effect::MotionBlur),
                &colors,
                view,
                k,
                velocity,
            );
        }
        if self.effect_level(Effect::ColorShift) > 0.0 {
            colors = color_shift::shifted_colors(&colors, k.width, self.color_shift_px);
        }
        let gain = self.color_gain(take, i);
        for (pixel, color) in colors.iter_mut().enumerate() {
            *color = color.component_mul(&gain)
                * vignetting::vignetting_factor(self.effect_level(Effect::Vignetting), k, pixel);
        }
        colors
    }
}

fn effect_stream(seed: u64, of: &str, effect: Effect, step: usize) -> Pcg64Mcg {
    // Streams are named by effect, so that a new effect does not change the others.
    stage_rng(seed, &format!("synth/sensor/{of}/{}", effect.name()), step as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Material, Object, Part, sensor::test_view::wall};

    fn box_on_floor() -> (Object, Material) {
        let material = Material::plain(Vector3::repeat(0.5));
        let solids = vec![Solid::box_between([-0.3, -0.3, 0.0], [0.3, 0.3, 0.5], &material)];
        let part = Part { name: "box".into(), joint: None, solids, handle: None };
        (Object { family: "box", parts: vec![part], world_from_rest: Pose::identity() }, material)
    }

    fn drawn(sensor: HandheldSensor) -> HandheldCamera {
        HandheldCamera::drawn(sensor, &wall(1.0).1, 11)
    }

    #[test]
    fn the_level_scales_what_a_seed_draws() {
        let [half, whole] = [0.5, 1.0].map(|level| drawn(HandheldSensor::new(level)));
        let is_half = |a: f64, b: f64| assert!((a - 0.5 * b).abs() < 1e-15 + 1e-9 * b.abs(), "{a} {b}");
        is_half(half.depth_scale, whole.depth_scale);
        is_half(half.lag_s, whole.lag_s);
        (0..2).for_each(|k| is_half(half.color_shift_px[k], whole.color_shift_px[k]));
        half.depth_warp.iter().zip(&whole.depth_warp).for_each(|(a, b)| is_half(*a, *b));
        let [a, b] = [&half, &whole].map(|c| c.pose_errors(1, &[Pose::identity(); 4]));
        is_half(a.relocalization.translation.vector.x, b.relocalization.translation.vector.x);
        is_half(a.jitter[2].translation.vector.y, b.jitter[2].translation.vector.y);
        is_half(a.drift[1].translation.vector.z, b.drift[1].translation.vector.z);
    }

    #[test]
    fn a_switch_leaves_what_the_others_draw_as_it_is() {
        let all = HandheldSensor::new(1.0);
        let (view, k) = wall(1.0);
        let room = [Point3::new(-1.0, -1.0, 0.0), Point3::new(1.0, 1.0, 1.0)];
        let cameras = [Pose::identity(); 5];
        let (object, floor) = box_on_floor();
        let scene = Scene::new(&object, 0, &floor, 1.0);
        let eye = Pose::face_towards(&Point3::new(2.0, 0.0, 1.0), &Point3::origin(), &-Vector3::z());
        let sphere = BoundingSphere { center: Point3::new(0.0, 0.0, 0.2), radius_m: 0.5 };
        // What each effect draws, by the effect.
        let draws = |camera: &HandheldCamera| {
            let errors = camera.depth_errors(1, 3, &view, &k);
            let poses = camera.pose_errors(1, &cameras);
            let light = camera.light_of_view(1, 3, &Vector3::x(), &scene, &eye, &sphere);
            [
                (Effect::DepthScale, format!("{}", camera.depth_scale)),
                (Effect::DepthWarp, format!("{:?}", camera.depth_warp)),
                (Effect::DepthNoise, format!("{:?}", errors.disparity_px)),
                (Effect::DepthLoss, format!("{:?}", errors.lost)),
                (Effect::FlyingPixels, format!("{:?}", errors.between_m)),
                (Effect::ColorShift, format!("{:?}", camera.color_shift_px)),
                (Effect::PoseLag, format!("{}", camera.lag_s)),
                (Effect::PoseDrift, format!("{:?}", poses.drift)),
                (Effect::PoseJitter, format!("{:?}", poses.jitter)),
                (Effect::Relocalization, format!("{:?}", poses.relocalization)),
                (Effect::Exposure, format!("{:?}", camera.color_gain(1, 3))),
                (Effect::Light, format!("{:?}", (light.lamp, light.tint))),
                (Effect::Highlights, format!("{:?}", (light.shine, light.bulbs))),
                (Effect::Clutter, format!("{:?}", camera.clutter_solids(&room, 0.0))),
                (
                    Effect::Hand,
                    format!(
                        "{:?}",
                        (0..40).map(|i| camera.hand_solids(1, i, &cameras[0], &sphere)).collect::<Vec<_>>()
                    ),
                ),
            ]
        };
        let with_all = draws(&drawn(all));
        for off in Effect::ALL {
            for ((effect, now), (_, before)) in draws(&drawn(all.without(&[off]))).iter().zip(&with_all) {
                assert!(*effect == off || now == before, "{} changes {}", off.name(), effect.name());
            }
            for ((effect, now), (_, before)) in draws(&drawn(all.only(&[off]))).iter().zip(&with_all) {
                assert!(*effect != off || now == before, "{} alone draws something else", off.name());
            }
        }
    }

    #[test]
    fn no_effect_leaves_a_view_as_it_is() {
        let camera = drawn(HandheldSensor::clean());
        let (view, k) = wall(1.0);
        assert_eq!(camera.depth_errors(1, 0, &view, &k), DepthErrors::default());
        assert_eq!(camera.colors_of_view(1, 0, &view, &k, &[Vector3::x(); 2]), view.color);
        let (object, floor) = box_on_floor();
        let scene = Scene::new(&object, 0, &floor, 1.0);
        let sphere = BoundingSphere { center: Point3::origin(), radius_m: 0.5 };
        let light = camera.light_of_view(1, 0, &Vector3::x(), &scene, &Pose::identity(), &sphere);
        assert_eq!(light, Light::from_lamp(Vector3::x()));
        let sphere = BoundingSphere { center: Point3::origin(), radius_m: 1.0 };
        assert!((0..200).all(|i| camera.hand_solids(0, i, &Pose::identity(), &sphere).is_empty()));
    }
}
