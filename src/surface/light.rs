//! The light of a recording: the brightness of a matt surface as a function of its direction.

use nalgebra::{SMatrix, SVector, Vector3};

/// Terms of the series.
pub(crate) const TERMS: usize = 8;

/// Real spherical harmonics of order 1 and 2 at a unit direction, each with mean square 1: 99 % of a matt
/// surface's brightness under distant light (Ramamoorthi and Hanrahan 2001).
pub(crate) fn harmonics(n: &Vector3<f64>) -> SVector<f64, TERMS> {
    let [one, pair, zonal] = [3.0_f64, 15.0, 1.25].map(f64::sqrt);
    let mixed = 3.75_f64.sqrt();
    SVector::from([
        one * n.x,
        one * n.y,
        one * n.z,
        pair * n.x * n.y,
        pair * n.y * n.z,
        pair * n.z * n.x,
        zonal * (3.0 * n.z * n.z - 1.0),
        mixed * (n.x * n.x - n.y * n.y),
    ])
}

/// Logarithm of a surface's brightness as a function of its normal in the world: a series for each channel.
/// Its mean over the photos' samples is 0, so textures keep their overall brightness.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Light {
    /// Coefficients of `harmonics`, a column for each channel.
    pub terms: SMatrix<f64, TERMS, 3>,
    /// Mean of the series over the photos' samples.
    pub mean: Vector3<f64>,
}

impl Light {
    /// Ratio of the brightness of a surface with unit normal `normal` to the mean, by channel.
    pub fn brightness_at(&self, normal: &Vector3<f64>) -> Vector3<f32> {
        self.ln_on(&harmonics(normal)).map(|ln| ln.exp() as f32)
    }

    /// Logarithm of that ratio, from the harmonics of the normal.
    pub(super) fn ln_on(&self, harmonics: &SVector<f64, TERMS>) -> Vector3<f64> {
        self.terms.tr_mul(harmonics) - self.mean
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::SeedableRng as _;

    #[test]
    fn harmonics_are_orthonormal_over_the_sphere() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(5);
        let mut moments = SMatrix::<f64, TERMS, TERMS>::zeros();
        let count = 200_000;
        for _ in 0..count {
            let h = harmonics(&numeric::random::random_direction(&mut rng));
            moments += h * h.transpose() / f64::from(count);
        }
        assert!((moments - SMatrix::identity()).amax() < 0.02, "{moments:.3}");
    }

    #[test]
    fn without_terms_it_is_the_same_from_all_sides() {
        assert_eq!(Light::default().brightness_at(&Vector3::x()), Vector3::repeat(1.0));
    }
}
