//! How photos were lit: the gain of each relative to the others that show the same surface, and the
//! brightness of a surface as a function of its direction.

use nalgebra::{DMatrix, SVector, Vector3};
use rayon::prelude::*;

use super::light::{Light, TERMS, harmonics};

/// Standard deviation of the logarithm of a photo's exposure.
/// measured: hand-held recordings with automatic exposure
const EXPOSURE: f64 = 0.15;
/// Standard deviation of the logarithm of a color between photos of one exposure.
/// chosen: lamp light on a matt surface falls by a tenth at 25 degrees
const COLOR: f64 = 0.1;
/// Standard deviations of the terms of the light, of order 1 and 2.
/// derived: the series of a distant lamp, from any side, as bright as all other light together, in sRGB
const LIGHT: [f64; 2] = [0.06, 0.02];
/// Number of spots that share one error: a shadow covers a sixth of a mesh in each direction.
/// chosen: 3,000 spots of a mesh over 36
const TOGETHER: f64 = 80.0;
/// Range of levels proportional to the exposure: darker ones are noise, lighter ones are cut off.
/// chosen: three levels of noise, and a level above all others
const FOLLOWS: std::ops::Range<f32> = 10.0..250.0;
/// Rounds of reweighting: highlights and moved things count less in each.
const ROUNDS: usize = 4;

/// A spot of a surface as a photo shows it.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// Index of the photo.
    pub photo: usize,
    /// Weight of the photo for this spot.
    pub weight: f32,
    /// sRGB levels.
    pub color: Vector3<f32>,
    /// Outward unit normal in the world when the photo was taken.
    pub normal: Vector3<f64>,
}

/// How the photos of a recording were lit.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    /// Gain of every photo by channel, with geometric mean 1; 1 for a photo that shares no spot with others.
    pub gains: Vec<Vector3<f32>>,
    /// Light by the direction of a surface; zero where nothing turned between photos.
    pub light: Light,
}

impl Lighting {
    /// Estimates the lighting of `photos` photos; each element of `spots` holds the samples of one spot. Only
    /// surfaces turned between photos tell about the light: of two faces at rest, one may be brighter by its
    /// color. See docs/method.md (3.8).
    pub fn of_spots(spots: &[Vec<Shown>], photos: usize) -> Self {
        // Gains of the photos, then terms of the light; one column per channel.
        let mut logs = DMatrix::zeros(photos + TERMS, 3);
        for _ in 0..ROUNDS {
            // Summed in a fixed order, whatever the number of threads.
            let sums: Vec<Equations> =
                spots.par_chunks(CHUNK).map(|some| Equations::of_spots(some, &logs)).collect();
            let equations = sums.into_iter().fold(Equations::new(photos), Equations::plus);
            let Some(solver) = equations.normal.cholesky() else { break };
            logs = solver.solve(&equations.right);
        }
        let gains = (0..photos).map(|p| Vector3::from_fn(|k, _| logs[(p, k)].exp() as f32)).collect();
        let mut light =
            Light { terms: logs.fixed_view::<TERMS, 3>(photos, 0).into_owned(), ..Light::default() };
        let all = spots.iter().flatten();
        let (sum, count) =
            all.fold((Vector3::zeros(), 0), |(sum, n), s| (sum + light.ln_on(&harmonics(&s.normal)), n + 1));
        light.mean = sum / f64::from(count.max(1));
        Self { gains, light }
    }
}

/// Number of spots in one task.
const CHUNK: usize = 256;

/// Normal equations of the logarithms of gains and light.
struct Equations {
    normal: DMatrix<f64>,
    right: DMatrix<f64>,
}

/// A sample of a photo in logarithms.
struct LogSample {
    photo: usize,
    weight: f64,
    color: Vector3<f64>,
    harmonics: SVector<f64, TERMS>,
}

impl LogSample {
    fn of_sample(s: &Shown) -> Self {
        Self {
            photo: s.photo,
            weight: f64::from(s.weight),
            color: s.color.map(|c| f64::from(c).ln()),
            harmonics: harmonics(&s.normal),
        }
    }
}

impl Equations {
    /// Equations of the priors alone.
    fn new(photos: usize) -> Self {
        let mut equations = Self::all_zero(photos);
        for i in 0..photos + TERMS {
            let deviation = match i.checked_sub(photos) {
                None => EXPOSURE,
                Some(term) => LIGHT[usize::from(term >= 3)] / TOGETHER.sqrt(),
            };
            equations.normal[(i, i)] = (COLOR / deviation).powi(2);
        }
        equations
    }

    /// Equations of some spots; `logs` is the current estimate.
    fn of_spots(spots: &[Vec<Shown>], logs: &DMatrix<f64>) -> Self {
        let mut sums = Self::all_zero(logs.nrows() - TERMS);
        spots.iter().for_each(|spot| sums.add_spot(spot, logs));
        sums
    }

    /// All zero.
    fn all_zero(photos: usize) -> Self {
        let size = photos + TERMS;
        Self { normal: DMatrix::zeros(size, size), right: DMatrix::zeros(size, 3) }
    }

    fn plus(mut self, other: Self) -> Self {
        self.normal += other.normal;
        self.right += other.right;
        self
    }

    /// Adds a spot with its own color eliminated; `logs` is the current estimate.
    fn add_spot(&mut self, spot: &[Shown], logs: &DMatrix<f64>) {
        let usable = spot.iter().filter(|s| s.color.iter().all(|c| FOLLOWS.contains(c)));
        let mut seen: Vec<LogSample> = usable.map(LogSample::of_sample).collect();
        let total: f64 = seen.iter().map(|s| s.weight).sum();
        if seen.len() < 2 || !(total > 0.0) {
            return;
        }
        let photos = logs.nrows() - TERMS;
        let terms = logs.fixed_view::<TERMS, 3>(photos, 0);
        let mut own = Vec::with_capacity(seen.len());
        for s in &seen {
            let gain = Vector3::from_fn(|k, _| logs[(s.photo, k)]);
            own.push(s.color - gain - terms.tr_mul(&s.harmonics));
        }
        let middle = seen.iter().zip(&own).map(|(s, own)| own * s.weight).sum::<Vector3<f64>>() / total;
        // Cauchy's weights; the weights of a spot sum to 1.
        for (s, own) in seen.iter_mut().zip(&own) {
            s.weight /= total * (1.0 + (own - middle).norm_squared() / (3.0 * COLOR * COLOR));
        }
        let sum: f64 = seen.iter().map(|s| s.weight).sum();
        let color = seen.iter().map(|s| s.color * s.weight).sum::<Vector3<f64>>() / sum;
        let facing = seen.iter().map(|s| s.harmonics * s.weight).sum::<SVector<f64, TERMS>>() / sum;
        for s in &seen {
            let i = s.photo;
            let w = s.weight;
            self.normal[(i, i)] += w;
            for other in &seen {
                self.normal[(i, other.photo)] -= w * other.weight / sum;
            }
            let off = s.color - color;
            let turned = s.harmonics - facing;
            for k in 0..3 {
                self.right[(i, k)] += w * off[k];
            }
            for a in 0..TERMS {
                self.normal[(i, photos + a)] += w * turned[a];
                self.normal[(photos + a, i)] += w * turned[a];
                for b in 0..TERMS {
                    self.normal[(photos + a, photos + b)] += w * turned[a] * turned[b];
                }
                for k in 0..3 {
                    self.right[(photos + a, k)] += w * turned[a] * off[k];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::{random_direction, unit_uniform};
    use rand_core::SeedableRng as _;

    const GAINS: [[f32; 3]; 3] = [[1.2, 1.15, 1.18], [0.9, 0.92, 0.88], [1.0, 1.05, 1.02]];

    /// Spots of many colors, each shown by two photos or three, some with a highlight, that face another way
    /// in the last photo if `turned`; under a lamp above that is half as bright as all other light.
    fn spots(gains: &[[f32; 3]; 3], turned: bool) -> Vec<Vec<Shown>> {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(3);
        let spot = |n: usize| {
            let color = Vector3::from_fn(|_, _| 40.0 + 120.0 * unit_uniform(&mut rng) as f32);
            let normals = [0; 2].map(|_| random_direction(&mut rng).into_inner());
            let shown = |photo: usize| {
                let shine = if (n + photo) % 11 == 0 { 1.35 } else { 1.0 };
                let normal = normals[usize::from(turned && photo == 2)];
                let color = color.component_mul(&Vector3::from(gains[photo])) * shine * lamp(&normal) as f32;
                Shown { photo, weight: 1.0, color, normal }
            };
            (0..3).filter(|p| n % 4 != *p).map(shown).collect()
        };
        (0..3000).map(spot).collect()
    }

    /// sRGB brightness under the lamp.
    fn lamp(normal: &Vector3<f64>) -> f64 {
        (0.7 + 0.35 * normal.z.max(0.0)).powf(1.0 / 2.2)
    }

    #[test]
    fn gains_are_found_in_spite_of_highlights() {
        for turned in [false, true] {
            let found = Lighting::of_spots(&spots(&GAINS, turned), 4).gains;
            for k in 0..3 {
                let mean: f32 = (0..3).map(|p| GAINS[p][k].ln()).sum::<f32>() / 3.0;
                for p in 0..3 {
                    let off = found[p][k].ln() - (GAINS[p][k].ln() - mean);
                    assert!(off.abs() < 0.01, "photo {p}: {} is off by {off}", found[p][k]);
                }
            }
            assert_eq!(found[3], Vector3::repeat(1.0));
        }
    }

    #[test]
    fn photos_of_one_exposure_stay_as_they_are() {
        let found = Lighting::of_spots(&spots(&[[1.0; 3]; 3], false), 3);
        assert!(found.gains.iter().all(|g| (g - Vector3::repeat(1.0)).amax() < 0.01), "{found:?}");
    }

    #[test]
    fn light_is_known_from_what_turned_alone() {
        let still = Lighting::of_spots(&spots(&GAINS, false), 3);
        assert!(still.light.terms.amax() < 1e-12, "{still:?}");
        let found = Lighting::of_spots(&spots(&GAINS, true), 3).light;
        let [up, down] = [1.0, -1.0].map(|z| Vector3::new(0.0, 0.0, z));
        let [true_ratio, ratio] =
            [lamp(&up) / lamp(&down), f64::from(found.brightness_at(&up).x / found.brightness_at(&down).x)];
        // Less than all of it: the prior.
        assert!(ratio > 1.0 + 0.6 * (true_ratio - 1.0) && ratio < true_ratio, "{ratio}, {true_ratio}");
    }
}
