//! Random materials of an object.

use nalgebra::Vector3;
use rand_core::Rng;

use super::Material;
use numeric::random;

/// How the surfaces of an object look.
pub(super) struct Look {
    /// Whether surfaces are textured.
    pub textured: bool,
    /// Length scale of textures, meters.
    pub scale_m: f64,
}

impl Look {
    /// A material of random hue.
    pub(crate) fn drawn_material(&self, rng: &mut impl Rng) -> Material {
        let base = drawn_color(rng);
        if !self.textured {
            return Material::plain(base);
        }
        // Darker as well, since features are found in grayscale.
        let second = base.lerp(&drawn_color(rng), 0.35) * random::uniform_in(rng, 0.25, 0.5);
        let mut wavelength_m = Vector3::repeat(self.scale_m * random::uniform_in(rng, 0.1, 0.25));
        // Some textures are stretched along one axis, like wood.
        if random::is_chosen(rng, 0.4) {
            wavelength_m[random::index_below(rng, 3)] *= random::uniform_in(rng, 2.0, 4.0);
        }
        Material {
            base,
            second,
            wavelength_m: Some(wavelength_m),
            seed: random::index_below(rng, 1 << 30) as u32,
            lacquer: None,
            sheen: 0.0,
        }
    }

    /// The material of handles and fittings: gray.
    pub(crate) fn drawn_trim(&self, rng: &mut impl Rng) -> Material {
        Material::plain(Vector3::repeat(random::uniform_in(rng, 0.05, 0.5)))
    }
}

/// A linear color, neither black nor white.
fn drawn_color(rng: &mut impl Rng) -> Vector3<f64> {
    let tone = random::uniform_in(rng, 0.25, 0.8);
    Vector3::from_fn(|_, _| tone * random::uniform_in(rng, 0.35, 1.0))
}
