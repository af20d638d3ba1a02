//! Standard deviations of a joint's parameters from its covariance. A parameter known no better than by a
//! guess is not determined. See docs/method.md 8.7.

use nalgebra::{Matrix3, SMatrix, Unit, Vector3};

use super::{ArticulatedModel, AxisAlone};

/// Root mean square angle between a line and one drawn uniformly from all directions, radians. derived:
/// sqrt(pi - 2), from the mean of the squared angle over a hemisphere.
const GUESSED_DIRECTION_RAD: f64 = 1.068_453_1;
/// Root mean square error of a guessed angle, radians. derived: pi / sqrt 3, of a uniform distribution over a
/// whole turn.
const GUESSED_TURN_RAD: f64 = std::f64::consts::PI * INVERSE_SQRT_3;
/// Root mean square error of a guessed slide, as a share of the object's longest side. derived: 1 / sqrt 3,
/// of a uniform distribution over the side in both directions.
const GUESSED_SLIDE_SHARE: f64 = INVERSE_SQRT_3;
/// Root mean square error of a guessed line, as a share of the object's longest side. derived: 1 / sqrt 6, of
/// a uniform distribution over a square of that side perpendicular to the line.
const GUESSED_LINE_SHARE: f64 = INVERSE_SQRT_3 * std::f64::consts::FRAC_1_SQRT_2;
const INVERSE_SQRT_3: f64 = 0.577_350_269_189_625_8;

/// Standard deviations of a joint's parameters; `None` where a parameter is not determined: not finite, or no
/// better than a guess.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviations {
    /// Standard deviation of the axis direction, radians.
    pub axis_rad: Option<f64>,
    /// Standard deviation of the axis line's place, perpendicular to it, meters.
    pub origin_m: Option<f64>,
    /// Standard deviation of the motion, radians or meters.
    pub motion: Option<f64>,
}

impl Deviations {
    /// From the covariance of (direction 3, point 3, motion 1) of a joint about or along `axis`, for an
    /// object with longest side `extent_m`. Of direction and point only the components perpendicular to the
    /// axis count: a direction cannot change along itself, and a line has no place along itself.
    pub fn of_covariance(
        covariance: &SMatrix<f64, 7, 7>,
        axis: &Unit<Vector3<f64>>,
        turns: bool,
        extent_m: f64,
    ) -> Self {
        let across = Matrix3::identity() - axis.into_inner() * axis.transpose();
        // The variances perpendicular to the axis.
        let [direction, point] = [0, 3].map(|k| {
            let block: Matrix3<f64> = covariance.fixed_view::<3, 3>(k, k).into();
            (across * block * across).trace()
        });
        let motion = if turns { GUESSED_TURN_RAD } else { GUESSED_SLIDE_SHARE * extent_m };
        Self {
            axis_rad: determined_deviation(direction, GUESSED_DIRECTION_RAD),
            origin_m: determined_deviation(point, GUESSED_LINE_SHARE * extent_m),
            motion: determined_deviation(covariance[(6, 6)], motion),
        }
    }
}

impl AxisAlone {
    /// Standard deviation of the direction, radians; `None` where it is not determined.
    pub fn deviation_rad(&self) -> Option<f64> {
        determined_deviation(self.std_rad.powi(2), GUESSED_DIRECTION_RAD)
    }
}

/// The root of a variance if it is below a guess's; rounding may leave a slightly negative variance.
fn determined_deviation(variance: f64, guessed: f64) -> Option<f64> {
    let known = variance.is_finite() && variance < guessed * guessed;
    known.then(|| variance.max(0.0).sqrt())
}

impl ArticulatedModel {
    /// Longest side of the box around all links in state 0, meters; 0 without a surface.
    pub fn extent_m(&self) -> f64 {
        let rest = vec![0.0; self.joints.len()];
        let state0 = self.states.first().unwrap_or(&rest);
        let mut sides = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
        for (k, link) in self.links.iter().enumerate() {
            let world_from_link = self.world_from_link(k, state0);
            for vertex in &link.visual.vertices {
                let point = world_from_link * vertex.cast::<f64>();
                sides
                    .iter_mut()
                    .zip(point.iter())
                    .for_each(|([low, high], v)| (*low, *high) = (low.min(*v), high.max(*v)));
            }
        }
        sides.iter().map(|[low, high]| high - low).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use rand_core::{Rng as _, SeedableRng as _};

    #[test]
    fn what_no_guess_beats_is_not_determined() {
        let axis = Vector3::z_axis();
        let of = |scale: f64, turns: bool| {
            Deviations::of_covariance(&(SMatrix::identity() * scale), &axis, turns, 0.5)
        };
        let known = of(1e-4, true);
        assert_relative_eq!(known.axis_rad.unwrap(), 2f64.sqrt() * 1e-2, epsilon = 1e-12);
        assert_relative_eq!(known.motion.unwrap(), 1e-2);
        // 25 rad, as a run once said of an axis.
        let absurd = of(640.0, true);
        assert_eq!(absurd, Deviations { axis_rad: None, origin_m: None, motion: None });
        assert_eq!(of(f64::INFINITY, true), absurd);
        assert_eq!(of(f64::NAN, false), absurd);
        // 0.3 m is less than half a turn, but more than a guess of a slide of an object of 0.5 m.
        assert_eq!((of(0.09, true).motion, of(0.09, false).motion), (Some(0.3), None));
    }

    #[test]
    fn the_guesses_are_those_of_uniform_draws() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
        let mut draw = || rng.next_u64() as f64 / u64::MAX as f64;
        const N: usize = 200_000;
        let [mut angle, mut turn, mut line] = [0.0f64; 3];
        for _ in 0..N {
            // The cosine to the axis of an even direction is even.
            angle += draw().acos().powi(2);
            turn += (std::f64::consts::TAU * draw() - std::f64::consts::PI).powi(2);
            line += (draw() - 0.5).powi(2) + (draw() - 0.5).powi(2);
        }
        let rms = |sum: f64| (sum / N as f64).sqrt();
        assert_relative_eq!(rms(angle), GUESSED_DIRECTION_RAD, epsilon = 5e-3);
        assert_relative_eq!(rms(turn), GUESSED_TURN_RAD, epsilon = 1e-2);
        assert_relative_eq!(rms(line), GUESSED_LINE_SHARE, epsilon = 2e-3);
    }
}
