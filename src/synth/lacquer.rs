//! Patches of dark lacquer on a part: color shows the paint below, but the projected pattern of a depth
//! camera is absorbed.

use nalgebra::{Point3, Vector3};
use rand_core::Rng;

use super::lattice_noise::value_noise;
use numeric::random;

/// Number of sampled points for finding the noise threshold.
const PLACES: usize = 4096;
/// Share of light reflected through lacquer. chosen: black lacquer
const DARKENING: f64 = 0.2;

/// Patches of lacquer on a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lacquer {
    /// Spacing of the noise that forms the patches, meters.
    patch_m: f64,
    /// Noise value above which there is lacquer.
    from: f64,
    seed: u32,
}

impl Lacquer {
    /// Patches that cover a share of the points.
    pub(super) fn covering(share: f64, patch_m: f64, rng: &mut impl Rng) -> Self {
        let seed = random::index_below(rng, 1 << 30) as u32;
        let mut noise: Vec<f64> = (0..PLACES)
            .map(|_| value_noise(&Vector3::from_fn(|_, _| random::uniform_in(rng, 0.0, 1e3)), seed))
            .collect();
        noise.sort_by(f64::total_cmp);
        let from = noise[(((1.0 - share) * PLACES as f64) as usize).min(PLACES - 1)];
        Self { patch_m, from, seed }
    }

    /// One patch over everything.
    pub(super) fn everywhere() -> Self {
        Self { patch_m: 1.0, from: f64::NEG_INFINITY, seed: 0 }
    }

    /// Whether a point in the part's frame is lacquered.
    pub fn covers(&self, point: &Point3<f64>) -> bool {
        value_noise(&(point.coords / self.patch_m), self.seed) >= self.from
    }

    /// Linear color of a surface under lacquer.
    pub fn darkened_color(color: Vector3<f64>) -> Vector3<f64> {
        DARKENING * color
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    #[test]
    fn patches_cover_their_share() {
        let rng = &mut stage_rng(3, "lacquer", 0);
        for share in [0.1, 0.4] {
            let lacquer = Lacquer::covering(share, 0.1, rng);
            let place =
                |_| lacquer.covers(&Point3::from_slice(&[(); 3].map(|()| random::uniform_in(rng, 0.0, 9.0))));
            let covered = (0..20_000).map(place).filter(|c| *c).count() as f64 / 20_000.0;
            assert!((covered - share).abs() < 0.03, "{covered} for {share}");
        }
    }
}
