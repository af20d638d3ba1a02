//! Whether the world of recorded poses has z up, as a twin's has (REP 103), by what the object stands on
//! and by how the images were held.

use nalgebra::{Unit, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::gravity::{SupportPlane, images_up, support_plane, surface_patches};
use crate::{NoiseConfig, RgbdFrame, poses::surfels::Surfels};
use common::stop::{Stop, Stopped};
use geometry::Pose;

/// Least angle between z and a support that contradicts it, radians.
/// chosen: 30 deg, more than a table or a ramp slopes
const TILTED_RAD: f64 = 0.52;
/// A support this near to an axis of the world is taken to be level there, radians.
/// chosen: 10 deg; worlds of motion capture and graphics are level, those of a first image are not
const LEVEL_RAD: f64 = 0.17;
/// Least difference of the cosines between the images' up and the two directions. chosen: about 6 deg
const CLEARLY: f64 = 0.1;
/// Most frames that are looked at. chosen: planes are as clear by these
const FRAMES: usize = 16;

/// A world with another direction up than z.
#[derive(Clone, Copy, Debug)]
pub struct WorldUp {
    /// The direction that is up, in the world of the poses.
    pub up: Vector3<f64>,
    /// The normal of what the object stands on.
    pub normal: Vector3<f64>,
    /// Rotation that turns the world upright.
    pub upright_from_world: UnitQuaternion<f64>,
}

/// The direction that is up in the world of frames, where it is clearly not z; `None` where z is up or
/// nothing shows it.
///
/// # Errors
/// [`Stopped`].
pub fn world_up(frames: &[&RgbdFrame], noise: &NoiseConfig, stop: &Stop) -> Result<Option<WorldUp>, Stopped> {
    let some: Vec<&RgbdFrame> =
        frames.iter().step_by(frames.len().div_ceil(FRAMES).max(1)).copied().collect();
    let poses: Vec<Pose> = some.iter().map(|f| f.world_from_camera).collect();
    let Some(images) = images_up(&poses) else { return Ok(None) };
    let surfels: Vec<Surfels> = some
        .par_iter()
        .map(|f| stop.check().map(|()| Surfels::of_frame(f, noise, |_| true)))
        .collect::<Result<_, Stopped>>()?;
    let patches = surface_patches(&surfels.iter().collect::<Vec<_>>(), &poses);
    let z = Vector3::z_axis();
    let Some(support) = support_plane(&patches, &images) else { return Ok(None) };
    let is_level = support.normal.angle(&z) < TILTED_RAD;
    let images_prefer = images.dot(&support.normal) - images.dot(&z);
    if is_level || images_prefer < CLEARLY {
        return Ok(None);
    }
    // With the camera held sideways, a wall faces up in the images; the floor shows more surface then.
    let is_floor = |p: &SupportPlane| p.normal.angle(&z) < TILTED_RAD && p.share >= support.share;
    if support_plane(&patches, &z).is_some_and(|p| is_floor(&p)) {
        return Ok(None);
    }
    let up = nearest_axis(&support.normal).unwrap_or(support.normal);
    // Straight down: any level axis turns it.
    let turn = UnitQuaternion::rotation_between_axis(&up, &z)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    Ok(Some(WorldUp { up: up.into_inner(), normal: support.normal.into_inner(), upright_from_world: turn }))
}

/// The axis of the world that a direction nearly has.
fn nearest_axis(direction: &Unit<Vector3<f64>>) -> Option<Unit<Vector3<f64>>> {
    let axes = [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()];
    axes.into_iter().flat_map(|a| [a, -a]).find(|a| a.angle(direction) < LEVEL_RAD)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Rotation3};

    use super::*;
    use geometry::Intrinsics;

    /// Views of a floor with a step on it from 0.8 m, turned by `world_from_upright`.
    fn frames(world_from_upright: &UnitQuaternion<f64>) -> Vec<RgbdFrame> {
        let k = Intrinsics { width: 96, height: 72, fx: 80.0, fy: 80.0, cx: 48.0, cy: 36.0 };
        let view = |i: usize| {
            let a = 0.15 * i as f64;
            let eye = Point3::new(a.cos(), a.sin(), 0.8);
            let pose = Pose::face_towards(&eye, &Point3::origin(), &-Vector3::z());
            let depth = |p: usize| {
                let ray = pose.rotation * k.ray_at((p % 96) as f64, (p / 96) as f64);
                let on = |height: f64| (height - eye.z) / ray.z;
                let step = eye + ray * on(0.1);
                (if step.x.abs() < 0.1 && step.y.abs() < 0.1 { on(0.1) } else { on(0.0) }) as f32
            };
            let depth_m: Vec<f32> =
                (0..96 * 72).map(depth).map(|d| if d > 0.0 && d < 4.0 { d } else { 0.0 }).collect();
            RgbdFrame {
                id: String::new(),
                stamp_nanos: 0,
                intrinsics: k,
                world_from_camera: world_from_upright * pose,
                rgb: vec![[0; 3]; 96 * 72],
                depth_m,
                mask: None,
                readings: Vec::new(),
            }
        };
        (0..6).map(view).collect()
    }

    fn found(world_from_upright: &UnitQuaternion<f64>) -> Option<WorldUp> {
        let frames = frames(world_from_upright);
        world_up(&frames.iter().collect::<Vec<_>>(), &NoiseConfig::default(), &Stop::never()).unwrap()
    }

    #[test]
    fn worlds_with_another_direction_up_are_told_and_turned() {
        assert!(found(&UnitQuaternion::identity()).is_none());
        for axis in [Vector3::y_axis(), -Vector3::y_axis(), Vector3::x_axis(), -Vector3::z_axis()] {
            let turn =
                UnitQuaternion::rotation_between_axis(&Vector3::z_axis(), &axis).unwrap_or_else(|| {
                    Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI).into()
                });
            let up = found(&turn).unwrap();
            assert_eq!(up.up, axis.into_inner());
            assert!((up.upright_from_world * axis.into_inner() - Vector3::z()).norm() < 1e-9);
        }
        // The world of a first image that looked down by 40 deg: its y points down in the image.
        let tilted = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 2.3);
        let up = found(&tilted).unwrap();
        assert!((tilted * Vector3::z()).angle(&up.up) < 0.02, "{up:?}");
    }
}
