//! The frozen reconstruction of one state, as input of the search for parts and motions.

use nalgebra::{Point3, Vector3};

use geometry::{Grid3, Intrinsics, Pose, SceneBox};
use surface::ColorField;

/// A ray to the object, in the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceRay {
    /// Camera center, meters.
    pub origin: Point3<f64>,
    /// Direction with unit z in the camera, so that `origin + direction * depth_m` is the point at a z-depth.
    pub direction: Vector3<f64>,
    /// Measured z-depth, meters.
    pub depth_m: f64,
    /// Index of the frame.
    pub frame: usize,
    /// Observed color in `[0, 1]`.
    pub rgb: [f32; 3],
}

/// The data of one state. The search for parts and motions does not change it.
#[derive(Clone, Copy)]
pub struct StateModel<'a> {
    /// Signed distance in meters (negative inside), not truncated, node-aligned in the world frame.
    pub sdf: &'a Grid3<f32>,
    /// Whether some view saw as far as a node or beyond (docs/method.md 3.5); the nearest node counts.
    pub visible: &'a Grid3<bool>,
    /// Color field.
    pub color: &'a dyn ColorField,
    /// Rays to the object.
    pub rays: &'a [SurfaceRay],
    /// Camera and pose (`world_from_camera`) of every frame.
    pub cameras: &'a [(Intrinsics, Pose)],
}

/// A state in normalised coordinates and truncation distances.
#[derive(Clone, Copy)]
pub(crate) struct Volume<'a> {
    pub model: StateModel<'a>,
    pub scene: SceneBox,
    pub truncation_m: f64,
    /// Width over which occupancy falls from 1 to 0, meters.
    pub ramp_m: f64,
}

impl Volume<'_> {
    /// Signed distance in truncation distances, and its gradient per normalised unit.
    pub(crate) fn sdf(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let (d, g) = self.sdf_m(point);
        (d / self.truncation_m, g / self.truncation_m)
    }

    /// Occupancy (docs/method.md 12.7: 1 inside, 0 outside, a ramp of width `ramp_m` between), and its
    /// gradient per normalised unit.
    pub(crate) fn occupancy(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let (d, g) = self.sdf_m(point);
        // docs/method.md (12.13).
        let value = 0.5 - d / self.ramp_m;
        if value <= 0.0 {
            (0.0, Vector3::zeros())
        } else if value >= 1.0 {
            (1.0, Vector3::zeros())
        } else {
            (value, -g / self.ramp_m)
        }
    }

    /// Whether the point was seen in this state.
    pub(crate) fn is_visible(&self, point: &Point3<f64>) -> bool {
        self.model
            .visible
            .nearest_node(&self.scene.to_world(point))
            .is_some_and(|i| self.model.visible.values[i])
    }

    fn sdf_m(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let grid = self.model.sdf;
        let (d, g) = grid.sample_with_gradient(&self.scene.to_world(point));
        // Converts the gradient from meters to normalized units.
        (f64::from(d), g.cast::<f64>() * (1.0 / self.scene.scale))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neural::test_scene::two_blocks;

    #[test]
    fn occupancy_falls_over_the_ramp() {
        let scene = two_blocks(Pose::translation(0.1, 0.0, 0.0), 41);
        let volume = Volume { ramp_m: 0.02, ..scene.volume(0) };
        // Below the middle of the base's lower face, which lies at -0.1 m.
        let at = |height_m: f64| volume.scene.normalise(&Point3::new(-0.04, 0.0, -0.1 + height_m));
        assert_eq!(volume.occupancy(&at(0.02)), (1.0, Vector3::zeros()));
        assert_eq!(volume.occupancy(&at(-0.02)), (0.0, Vector3::zeros()));
        let (value, gradient) = volume.occupancy(&at(-0.004));
        assert!((value - 0.3).abs() < 0.02, "{value}");
        assert!(
            (gradient.z - 1.0 / (0.02 * volume.scene.scale)).abs() < 0.1 * gradient.z
                && gradient.xy().norm() < 1e-3
        );
        let above = volume.scene.normalise(&Point3::new(-0.2, 0.0, 0.0));
        assert!(volume.is_visible(&above) && !volume.is_visible(&Point3::new(3.0, 0.0, 0.0)));
    }
}
