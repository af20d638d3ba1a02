//! Illumination of a scene.

use nalgebra::{Point3, Vector3};

/// Exponent of highlights (Blinn 1977): half height at 4 degrees.
/// chosen: a bulb mirrored by lacquer
const LOBE_EXPONENT: f64 = 300.0;

/// Illumination of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Unit direction towards a distant lamp.
    pub lamp: Vector3<f64>,
    /// Factor on red, green and blue.
    pub tint: Vector3<f64>,
    /// Positions of bulbs mirrored by the object.
    pub bulbs: Vec<Point3<f64>>,
    /// Linear brightness of their reflections; 0 for a matt object.
    pub shine: f64,
}

impl Light {
    /// White light from a distant lamp and from all around.
    pub fn from_lamp(lamp: Vector3<f64>) -> Self {
        Self { lamp, tint: Vector3::repeat(1.0), bulbs: Vec::new(), shine: 0.0 }
    }

    /// Light reflected by a matt surface of unit normal `normal`.
    pub(super) fn diffuse_light(&self, normal: &Vector3<f64>) -> Vector3<f64> {
        // The terms sum to at most 1, so white does not saturate.
        self.tint * (0.55 + 0.15 * normal.z + 0.3 * normal.dot(&self.lamp).max(0.0))
    }

    /// Strength of a bulb's reflection at a surface point as seen from `eye`, in `[0, 1]`.
    pub(super) fn gloss_at(&self, eye: &Point3<f64>, point: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
        let mut gloss = 0.0_f64;
        for bulb in &self.bulbs {
            let [to_eye, to_bulb] = [eye - point, bulb - point].map(|v| v.normalize());
            if normal.dot(&to_bulb) > 0.0 && normal.dot(&to_eye) > 0.0 {
                let cosine = (to_eye + to_bulb).normalize().dot(normal).max(0.0);
                gloss = gloss.max(cosine.powf(LOBE_EXPONENT));
            }
        }
        gloss
    }
}
