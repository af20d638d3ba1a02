//! A stereo camera with its projector: depth images of a scene.

use rand_core::Rng;

use super::{
    StereoRig,
    aligned::aligned_depth_mm,
    infrared::{Projector, exposure_of, gray_image, radiance_image},
    matcher::matched_disparities,
    pattern::DotPattern,
};
use crate::{Light, Scene};
use geometry::{Intrinsics, Pose};

/// An active stereo camera beside a color camera.
#[derive(Clone, Debug)]
pub struct StereoCamera {
    /// Its geometry.
    pub rig: StereoRig,
    level: f64,
    pattern: DotPattern,
}

impl StereoCamera {
    /// The camera of a seed; `level` is a factor on its noise and on the errors of its geometry.
    pub fn drawn(level: f64, color: &Intrinsics, seed: u64) -> Self {
        let rig = StereoRig::drawn(level, color, seed);
        Self { rig, level, pattern: DotPattern::drawn(rig.intrinsics.fx, seed) }
    }

    /// Infrared images of both imagers for a pose of the left one, row-major.
    pub fn infrared_pair(
        &self,
        scene: &Scene,
        light: &Light,
        world_from_left: &Pose,
        rng: &mut impl Rng,
    ) -> [Vec<u8>; 2] {
        let projector = Projector {
            pattern: &self.pattern,
            world_from_projector: world_from_left * self.rig.left_from_projector,
        };
        let world_from_imagers = [*world_from_left, world_from_left * self.rig.true_left_from_right];
        let k = &self.rig.intrinsics;
        let radiances = world_from_imagers.map(|pose| radiance_image(scene, light, k, &pose, &projector));
        let exposure = exposure_of(&radiances[0]);
        radiances.map(|radiance| gray_image(&radiance, exposure, self.level, rng))
    }

    /// Disparities of the left image for a pose of the left imager, pixels, row-major; `NAN` for none.
    pub fn disparity_px(
        &self,
        scene: &Scene,
        light: &Light,
        world_from_left: &Pose,
        rng: &mut impl Rng,
    ) -> Vec<f32> {
        let [left, right] = self.infrared_pair(scene, light, world_from_left, rng);
        matched_disparities(&left, &right, self.rig.intrinsics.width)
    }

    /// Depth aligned to the color camera, millimeters, row-major, 0 = none.
    pub fn depth_mm(
        &self,
        scene: &Scene,
        light: &Light,
        color: &Intrinsics,
        world_from_color: &Pose,
        rng: &mut impl Rng,
    ) -> Vec<u16> {
        let world_from_left = world_from_color * self.rig.true_color_from_left;
        aligned_depth_mm(&self.disparity_px(scene, light, &world_from_left, rng), &self.rig, color)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::{Material, Object, Part, Solid};
    use numeric::random::stage_rng;

    /// Radius of the made world's floor, meters: none, so that boxes are all that is seen.
    const NO_FLOOR_M: f64 = 0.0;

    fn color() -> Intrinsics {
        Intrinsics { width: 320, height: 240, fx: 289.0, fy: 289.0, cx: 161.0, cy: 118.0 }
    }

    /// Boxes in the frame of the left imager, lower and upper corners.
    fn boxes(corners: &[[[f64; 3]; 2]], material: &Material) -> Object {
        let solids = corners.iter().map(|[low, high]| Solid::box_between(*low, *high, material)).collect();
        let part = Part { name: "box".into(), joint: None, solids, handle: None };
        Object { family: "box", parts: vec![part], world_from_rest: Pose::identity() }
    }

    fn plane_at(depth_m: f64) -> Object {
        let corners = [[-5.0, -5.0, depth_m], [5.0, 5.0, depth_m + 0.1]];
        boxes(&[corners], &Material::plain(Vector3::repeat(0.6)))
    }

    /// Disparities of an object by a camera that stands at the origin.
    fn disparities(object: &Object, camera: &StereoCamera, seed: u64) -> Vec<f32> {
        let floor = Material::plain(Vector3::repeat(0.5));
        let scene = Scene::new(object, 0, &floor, NO_FLOOR_M);
        let light = Light::from_lamp(Vector3::new(0.0, -0.6, -0.8));
        camera.disparity_px(&scene, &light, &Pose::identity(), &mut stage_rng(seed, "test", 0))
    }

    /// Mean and root mean square of disparities less the true one, pixels, and the share that was found, away
    /// from the border.
    fn errors(disparity: &[f32], rig: &StereoRig, true_px: impl Fn(f64, f64) -> f64) -> [f64; 3] {
        let k = &rig.intrinsics;
        let mut sums = [0.0; 4];
        for y in 10..k.height - 10 {
            for x in (k.width / 5)..k.width - 10 {
                let off = f64::from(disparity[y * k.width + x]) - true_px(x as f64, y as f64);
                sums[3] += 1.0;
                if off.is_finite() {
                    sums = [sums[0] + off, sums[1] + off * off, sums[2] + 1.0, sums[3]];
                }
            }
        }
        [sums[0] / sums[2], (sums[1] / sums[2]).sqrt(), sums[2] / sums[3]]
    }

    #[test]
    fn planes_are_measured_to_a_tenth_of_a_pixel() {
        for depth_m in [0.45, 0.83, 1.37] {
            let ideal = StereoCamera::drawn(0.0, &color(), 3);
            let true_px = ideal.rig.intrinsics.fx * ideal.rig.baseline_m / depth_m;
            let [bias, rms, share] =
                errors(&disparities(&plane_at(depth_m), &ideal, 1), &ideal.rig, |_, _| true_px);
            assert!(bias.abs() < 0.05 && rms < 0.15 && share > 0.99, "{depth_m}: {bias} {rms} {share}");
        }
    }

    #[test]
    fn a_camera_with_noise_measures_plain_paint_to_an_eighth_of_a_pixel() {
        let mut noisy = StereoCamera::drawn(1.0, &color(), 3);
        // Noise alone: the rig is as its calibration says.
        noisy.rig = StereoRig::drawn(0.0, &color(), 3);
        let true_px = noisy.rig.intrinsics.fx * noisy.rig.baseline_m / 0.7;
        let [bias, rms, share] = errors(&disparities(&plane_at(0.7), &noisy, 1), &noisy.rig, |_, _| true_px);
        assert!(bias.abs() < 0.05 && rms > 0.04 && rms < 0.16 && share > 0.95, "{bias} {rms} {share}");
    }

    #[test]
    fn a_turned_imager_shifts_disparities_and_a_longer_baseline_stretches_them() {
        let mut camera = StereoCamera::drawn(0.0, &color(), 3);
        let k = camera.rig.intrinsics;
        let yaw_rad = 0.05f64.to_radians();
        camera.rig.true_left_from_right = Pose::new(Vector3::x() * 0.0505, Vector3::y() * yaw_rad);
        // Turned to the right, the imager sees a point farther left: at a larger disparity.
        let true_px = |u: f64, _: f64| {
            let slope = (u - k.cx) / k.fx - 0.0505 / 0.8;
            u - (k.cx + k.fx * (slope - yaw_rad * (1.0 + slope * slope)))
        };
        let [bias, rms, share] = errors(&disparities(&plane_at(0.8), &camera, 1), &camera.rig, true_px);
        assert!(bias.abs() < 0.05 && rms < 0.15 && share > 0.98, "{bias} {rms} {share}");
    }

    #[test]
    fn there_is_no_disparity_where_one_imager_does_not_see() {
        // A board before a wall hides a strip left of it from the right imager.
        let [wall_m, board_m, edge_m] = [1.2, 0.6, -0.05];
        let wall = [[-3.0, -3.0, wall_m], [3.0, 3.0, wall_m + 0.1]];
        let board = [[edge_m, -3.0, board_m], [3.0, 3.0, board_m + 0.01]];
        let object = boxes(&[wall, board], &Material::plain(Vector3::repeat(0.6)));
        let camera = StereoCamera::drawn(0.0, &color(), 3);
        let disparity = disparities(&object, &camera, 1);
        let k = &camera.rig.intrinsics;
        let edge_px = k.cx + k.fx * edge_m / board_m;
        let hidden_px = k.fx * camera.rig.baseline_m * (1.0 / board_m - 1.0 / wall_m);
        let wall_px = (k.fx * camera.rig.baseline_m / wall_m) as f32;
        let of_wall = |x: f64| {
            let rows = 20..k.height - 20;
            let found = rows.clone().filter(|y| (disparity[y * k.width + x as usize] - wall_px).abs() < 0.5);
            found.count() as f64 / rows.len() as f64
        };
        assert!(hidden_px > 11.0);
        assert!(of_wall(edge_px - 0.5 * hidden_px) < 0.1, "{}", of_wall(edge_px - 0.5 * hidden_px));
        assert!(of_wall(edge_px - hidden_px - 8.0) > 0.95, "{}", of_wall(edge_px - hidden_px - 8.0));
    }

    #[test]
    fn the_number_of_threads_does_not_matter() {
        let object = plane_at(0.7);
        let camera = StereoCamera::drawn(1.0, &color(), 3);
        let many = disparities(&object, &camera, 1);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let one = pool.install(|| disparities(&object, &camera, 1));
        assert!(many.iter().zip(&one).all(|(a, b)| a.to_bits() == b.to_bits()));
    }

    #[test]
    fn aligned_depth_stands_where_the_color_camera_sees_it() {
        let camera = StereoCamera::drawn(0.0, &color(), 3);
        let corners = [[-0.1, -0.08, 0.6], [0.12, 0.1, 0.7]];
        let object = boxes(&[corners], &Material::plain(Vector3::repeat(0.6)));
        let floor = Material::plain(Vector3::repeat(0.5));
        let scene = Scene::new(&object, 0, &floor, NO_FLOOR_M);
        let light = Light::from_lamp(Vector3::new(0.0, -0.6, -0.8));
        let k = color();
        let rng = &mut stage_rng(1, "test", 0);
        let depth_mm = camera.depth_mm(&scene, &light, &k, &Pose::identity(), rng);
        for [x, y] in [[0.0, 0.0], [-0.09, -0.07], [0.11, 0.09]] {
            let pixel = k.pixel_of(&nalgebra::Point3::new(x, y, 0.6)).unwrap();
            assert!(depth_mm[pixel].abs_diff(600) < 6, "{x} {y} {}", depth_mm[pixel]);
        }
        // A pixel or two beyond the edges, as windows and the splat reach over them.
        let beyond_m = 8.0 * 0.6 / k.fx;
        for [x, y] in [[-0.1 - beyond_m, 0.0], [0.12 + beyond_m, 0.0], [0.0, -0.08 - beyond_m]] {
            let pixel = k.pixel_of(&nalgebra::Point3::new(x, y, 0.6)).unwrap();
            assert!(depth_mm[pixel].abs_diff(600) > 50, "{x} {y} {}", depth_mm[pixel]);
        }
    }
}
