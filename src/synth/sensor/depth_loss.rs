//! Surfaces without depth: dark ones reflect too little of the projected pattern, glossy ones mirror lamps,
//! and grazing ones compress the pattern.
//!
//! Nguyen, Izadi and Lovell 2012 measured a structured-light camera up to 60 degrees, where its noise started
//! to grow steeply. No source gives shares for stereo cameras; those of glossy and grazing surfaces are
//! assumptions.

use rand_core::Rng;

use crate::View;
use numeric::random;

/// Largest reflectance of a surface that counts as dark. chosen: black plastic
const DARK: f64 = 0.1;
/// Share of readings lost on a dark surface. chosen: more than half
const DARK_SHARE: f64 = 0.6;
/// Share of readings lost where a bulb is mirrored exactly. chosen: nearly all
const GLOSSY_SHARE: f64 = 0.8;
/// Cosine between ray and normal at which losses begin: 75 degrees.
/// chosen: where stereo begins to fail
const GRAZING_COSINE: f64 = 0.26;
/// Share of readings lost at 90 degrees, beyond the camera's own losses.
/// chosen: nearly all
const GRAZING_SHARE: f64 = 0.8;

/// By pixel, whether its reading is lost.
pub(super) fn lost_pixels(level: f64, view: &View, rng: &mut impl Rng) -> Vec<bool> {
    let mut lost = Vec::with_capacity(view.depth_m.len());
    for i in 0..view.depth_m.len() {
        let dark = if view.reflectance[i] < DARK { DARK_SHARE } else { 0.0 };
        let glossy = GLOSSY_SHARE * view.gloss[i];
        let grazing = GRAZING_SHARE * (1.0 - view.cosine[i] / GRAZING_COSINE).max(0.0);
        // Three draws for every pixel, so that neither view nor level shifts later draws.
        let draws = [(); 3].map(|()| random::unit_uniform(rng));
        lost.push([dark, glossy, grazing].iter().zip(draws).any(|(share, draw)| draw < level * share));
    }
    lost
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::test_view::wall;
    use numeric::random::stage_rng;

    fn share(level: f64, reflectance: f64, gloss: f64, cosine: f64) -> f64 {
        let (mut view, _) = wall(1.0);
        view.reflectance.fill(reflectance);
        view.gloss.fill(gloss);
        view.cosine.fill(cosine);
        let lost = lost_pixels(level, &view, &mut stage_rng(2, "loss", 0));
        lost.iter().filter(|l| **l).count() as f64 / lost.len() as f64
    }

    #[test]
    fn dark_glossy_and_grazing_surfaces_lose_their_share() {
        let near = |share: f64, expected: f64| assert!((share - expected).abs() < 0.02, "{share} {expected}");
        for level in [0.5, 1.0] {
            near(share(level, 0.05, 0.0, 1.0), 0.6 * level);
            near(share(level, 0.5, 0.5, 1.0), 0.4 * level);
            near(share(level, 0.5, 0.0, 0.13), 0.4 * level);
        }
        assert_eq!([share(1.0, 0.11, 0.0, 0.3), share(0.0, 0.0, 1.0, 0.0)], [0.0, 0.0]);
    }
}
