//! One exposure for all photos: how much brighter each is than the others where both show the same surface.

use nalgebra::{DMatrix, Vector3};

/// Standard deviation of the logarithm of a photo's exposure.
/// measured: hand-held recordings with automatic exposure
const EXPOSURE: f64 = 0.15;
/// Standard deviation of the logarithm of a color between photos of one exposure.
/// derived: lamp light on a matt surface falls by a tenth at 25 degrees
const COLOR: f64 = 0.1;
/// Levels of a channel that follow the exposure: darker ones are noise, lighter ones are cut off.
/// derived: three levels of noise, and a level above all others
const FOLLOWS: std::ops::Range<f32> = 10.0..250.0;
/// Rounds of reweighting: highlights and what moved count less in each.
const ROUNDS: usize = 4;

/// A spot of a surface as a photo shows it.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// Index of the photo.
    pub photo: usize,
    /// How well it shows the spot.
    pub weight: f32,
    /// sRGB levels.
    pub color: Vector3<f32>,
}

/// Gain of every photo by channel, 1 in the mean of the logarithms: what its colors are divided by. Each
/// element of `spots` holds what the photos show of one spot; a photo that shares none has gain 1. See
/// docs/method.md 3.8.
#[must_use]
pub fn exposures(spots: &[Vec<Shown>], photos: usize) -> Vec<Vector3<f32>> {
    let mut logs = DMatrix::<f64>::zeros(photos, 3);
    for _ in 0..ROUNDS {
        let mut normal = DMatrix::identity(photos, photos) * (COLOR / EXPOSURE).powi(2);
        let mut right = DMatrix::zeros(photos, 3);
        for spot in spots {
            add(spot, &logs, &mut normal, &mut right);
        }
        let Some(solver) = normal.cholesky() else { break };
        logs = solver.solve(&right);
    }
    (0..photos).map(|p| Vector3::from_fn(|k, _| logs[(p, k)].exp() as f32)).collect()
}

/// Adds a spot to the normal equations, its own color eliminated.
fn add(spot: &[Shown], logs: &DMatrix<f64>, normal: &mut DMatrix<f64>, right: &mut DMatrix<f64>) {
    let usable = spot.iter().filter(|s| s.color.iter().all(|c| FOLLOWS.contains(c)));
    let seen: Vec<(usize, f64, Vector3<f64>)> =
        usable.map(|s| (s.photo, f64::from(s.weight), s.color.map(|c| f64::from(c).ln()))).collect();
    let total: f64 = seen.iter().map(|s| s.1).sum();
    if seen.len() < 2 || !(total > 0.0) {
        return;
    }
    let gain = |photo: usize| Vector3::from_fn(|k, _| logs[(photo, k)]);
    let middle = seen.iter().map(|(p, w, y)| (y - gain(*p)) * *w).sum::<Vector3<f64>>() / total;
    // Cauchy's weights; a spot weighs 1 in all.
    let weight = |(p, w, y): &(usize, f64, Vector3<f64>)| {
        w / total / (1.0 + (y - gain(*p) - middle).norm_squared() / (3.0 * COLOR * COLOR))
    };
    let weights: Vec<f64> = seen.iter().map(weight).collect();
    let sum: f64 = weights.iter().sum();
    let mean = seen.iter().zip(&weights).map(|(s, w)| s.2 * *w).sum::<Vector3<f64>>() / sum;
    for ((i, _, y), w) in seen.iter().zip(&weights) {
        normal[(*i, *i)] += w;
        for ((j, ..), v) in seen.iter().zip(&weights) {
            normal[(*i, *j)] -= w * v / sum;
        }
        for k in 0..3 {
            right[(*i, k)] += w * (y[k] - mean[k]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng as _, SeedableRng as _};

    const GAINS: [[f32; 3]; 3] = [[1.2, 1.15, 1.18], [0.9, 0.92, 0.88], [1.0, 1.05, 1.02]];

    /// Spots of many colors, each shown by two photos or three; some with a highlight.
    fn spots(gains: &[[f32; 3]; 3]) -> Vec<Vec<Shown>> {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(3);
        let mut draw = move || rng.next_u64() as f32 / u64::MAX as f32;
        let spot = |n: usize| {
            let color = Vector3::from_fn(|_, _| 40.0 + 120.0 * draw());
            let shown = |photo: usize| {
                let shine = if (n + photo) % 11 == 0 { 1.35 } else { 1.0 };
                let color = color.component_mul(&Vector3::from(gains[photo])) * shine;
                Shown { photo, weight: 1.0, color }
            };
            (0..3).filter(|p| n % 4 != *p).map(shown).collect()
        };
        (0..400).map(spot).collect()
    }

    #[test]
    fn gains_are_found_in_spite_of_highlights() {
        let found = exposures(&spots(&GAINS), 4);
        for k in 0..3 {
            let mean: f32 = (0..3).map(|p| GAINS[p][k].ln()).sum::<f32>() / 3.0;
            for p in 0..3 {
                let off = found[p][k].ln() - (GAINS[p][k].ln() - mean);
                assert!(off.abs() < 0.01, "photo {p}: {} is off by {off}", found[p][k]);
            }
        }
        assert_eq!(found[3], Vector3::repeat(1.0));
    }

    #[test]
    fn photos_of_one_exposure_stay_as_they_are() {
        let found = exposures(&spots(&[[1.0; 3]; 3]), 3);
        assert!(found.iter().all(|g| (g - Vector3::repeat(1.0)).amax() < 0.01), "{found:?}");
    }
}
