//! Procedural color of surfaces: plain, or noise of several octaves in the part's frame.

use nalgebra::{Point3, Vector3};

use super::{Lacquer, lattice_noise::value_noise};

/// Color, lacquer and sheen of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Linear color, `[0, 1]`.
    pub base: Vector3<f64>,
    /// Second color of the texture; equal to `base` on a plain surface.
    pub second: Vector3<f64>,
    /// Longest wavelength of the texture along each axis of the part, meters; `None` is plain.
    pub wavelength_m: Option<Vector3<f64>>,
    /// Seed of the noise.
    pub seed: u32,
    /// Patches without depth; `None` for none.
    pub lacquer: Option<Lacquer>,
    /// Strength of the mirror-like reflection of a camera's own projector, in `[0, 1]`; 0 is matt.
    pub sheen: f64,
}

/// Octaves of the texture, each with half the previous wavelength.
const OCTAVES: u32 = 6;
/// Amplitude of each octave relative to the previous one. chosen: textures with much fine structure
const FALL: f64 = 0.8;

impl Material {
    /// A surface of one color.
    pub fn plain(base: Vector3<f64>) -> Self {
        Self { base, second: base, wavelength_m: None, seed: 0, lacquer: None, sheen: 0.0 }
    }

    /// Whether a point in the part's frame is lacquered.
    pub fn is_lacquered(&self, point: &Point3<f64>) -> bool {
        self.lacquer.is_some_and(|lacquer| lacquer.covers(point))
    }

    /// Linear color at a point in the part's frame; octaves too fine for a pixel of `footprint_m` are left
    /// out.
    pub fn color_at(&self, point: &Point3<f64>, footprint_m: f64) -> Vector3<f64> {
        let own = self.own_color(point, footprint_m);
        if self.is_lacquered(point) { Lacquer::darkened_color(own) } else { own }
    }

    fn own_color(&self, point: &Point3<f64>, footprint_m: f64) -> Vector3<f64> {
        let Some(wavelength_m) = self.wavelength_m else { return self.base };
        let mut sum = 0.0;
        let mut amplitude = 1.0;
        let mut scale = 1.0;
        for octave in 0..OCTAVES {
            // Waves shorter than two pixels would alias.
            if wavelength_m.min() * scale < 2.0 * footprint_m {
                break;
            }
            let p = Vector3::from_fn(|k, _| point[k] / (wavelength_m[k] * scale));
            // Each octave has its own noise; otherwise all would be equal at the origin.
            sum += amplitude * value_noise(&p, self.seed.wrapping_add(octave.wrapping_mul(0x9e37_79b9)));
            amplitude *= FALL;
            scale *= 0.5;
        }
        // The sum of octaves has a spread of about 0.45; a steep curve uses most of the range between the
        // colors.
        let share = 0.5 + 0.5 * (1.3 * sum).tanh();
        self.base.lerp(&self.second, share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texture_is_continuous_varied_and_loses_what_a_pixel_cannot_hold() {
        let material = Material {
            base: Vector3::zeros(),
            second: Vector3::repeat(1.0),
            wavelength_m: Some(Vector3::repeat(0.1)),
            seed: 7,
            lacquer: None,
            sheen: 0.0,
        };
        let at = |x: f64, footprint_m: f64| material.color_at(&Point3::new(x, -0.3, 0.2), footprint_m).x;
        let values: Vec<f64> = (0..4000).map(|i| at(f64::from(i) * 1e-3, 0.0)).collect();
        let mean = values.iter().sum::<f64>() / 4000.0;
        let spread = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 4000.0).sqrt();
        assert!((mean - 0.5).abs() < 0.1 && spread > 0.2, "{mean} {spread}");
        assert!(
            (0..1000)
                .all(|i| (at(f64::from(i) * 1e-3, 0.0) - at(f64::from(i) * 1e-3 + 1e-7, 0.0)).abs() < 1e-3)
        );
        assert!((at(0.123, 0.2) - 0.5).abs() < 1e-12);
        assert_eq!(Material::plain(Vector3::x()).color_at(&Point3::origin(), 0.0), Vector3::x());
    }
}
