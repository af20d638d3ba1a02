//! What matches of surface that stands still say of the world frames of two states.
//!
//! Surfaces that are compared along their normals leave open what lies along them: on a floor and a wall, how far
//! a state's world slid along both. Texture shows it. See docs/method.md (5.4).

use nalgebra::{Matrix6, Vector6};
use serde::{Deserialize, Serialize};

use crate::articulate::{
    observations::LiftedMatch,
    propose::ransac::{CHANCE, CellCounter, Gate, RansacConfig},
};
use crate::geometry::{Pose, exp_so3, shift_and_turn};

/// Rounds of Gauss-Newton with robust weights.
const ROUNDS: usize = 12;
/// Residuals beyond this many standard deviations lose their weight (Geman-McClure).
/// tuned: shared/bags, as in the refinement of a motion by matches (docs/method.md 6.4)
const SIGMAS: f64 = 2.0;
/// Cells of matches that stand still, at least.
///
/// derived: three fix a motion, beside those that wrong matches give by chance
const LEAST_CELLS: f64 = CHANCE + 3.0;
/// Parameters of a motion.
const PARAMETERS: usize = 6;

/// A small motion of a state's world that brings to rest what stands still.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Settled {
    /// To be applied to the state's poses from the left.
    pub corrected_from_reported: Pose,
    /// Covariance of a left perturbation of it (translation 3, rotation 3), square meters and radians.
    pub covariance: Matrix6<f64>,
    /// Cells of matches that it rests on.
    pub cells: f64,
}

/// Gauss-Newton equations of a left perturbation (translation, rotation).
struct Equations {
    information: Matrix6<f64>,
    gradient: Vector6<f64>,
    /// Gradients of the frames of either state.
    by_frame: [Vec<Vector6<f64>>; 2],
}

/// The motion of state 1's world by matches, where it is known to be none to the covariance `still`, by surfaces
/// that stand still. `frames` are those of each state, `extent_m` is the longest side of the object. `None` where
/// too few matches stand still, or too few frames have some.
#[must_use]
pub fn settle_world(
    matches: &[LiftedMatch],
    still: &Matrix6<f64>,
    frames: [usize; 2],
    extent_m: f64,
    config: &RansacConfig,
) -> Option<Settled> {
    let prior = still.cholesky()?.inverse();
    let mut moved = Pose::identity();
    for _ in 0..ROUNDS {
        let Equations { information, gradient, .. } = equations(matches, &moved, frames);
        let gradient = gradient + prior * shift_and_turn(&moved);
        let step = -(information + prior).cholesky()?.solve(&gradient);
        let turn = exp_so3(&step.fixed_rows::<3>(3).into_owned());
        moved = Pose::from_parts(step.fixed_rows::<3>(0).into_owned().into(), turn) * moved;
    }
    if std::env::var("DBG").is_ok() {
        let mut free = Pose::identity();
        for _ in 0..ROUNDS {
            let Equations { information, gradient, .. } = equations(matches, &free, frames);
            let step = -information.cholesky()?.solve(&gradient);
            let turn = exp_so3(&step.fixed_rows::<3>(3).into_owned());
            free = Pose::from_parts(step.fixed_rows::<3>(0).into_owned().into(), turn) * free;
        }
        let e = equations(matches, &free, frames);
        let i = e.information.cholesky()?.inverse();
        let mut spread = Matrix6::zeros();
        for g in e.by_frame.iter().flatten() { spread += g * g.transpose(); }
        eprintln!("DBG free {:?} sigma {:?} robust {:?} still {:?} moved {:?} of {}", shift_and_turn(&free).as_slice(), i.diagonal().map(f64::sqrt).as_slice(), (i * spread * i).diagonal().map(f64::sqrt).as_slice(), still.diagonal().map(f64::sqrt).as_slice(), shift_and_turn(&moved).as_slice(), matches.len());
    }
    let (gate, cell_m) = (Gate::new(config, extent_m), config.cell * extent_m);
    let back = moved.inverse();
    let own: Vec<LiftedMatch> = matches.iter().filter(|m| gate.supports(m, &back)).copied().collect();
    let cells = CellCounter::new(&own, gate, cell_m).support(&own, &back);
    if cells < LEAST_CELLS {
        return None;
    }
    // Errors of depth and pose run together over an image: each frame is one observer, as in (2.16).
    let Equations { information, by_frame, .. } = equations(matches, &moved, frames);
    let mut spread = prior;
    for gradients in by_frame {
        let seen: Vec<Vector6<f64>> = gradients.into_iter().filter(|g| *g != Vector6::zeros()).collect();
        let small_sample = seen.len() as f64 / seen.len().checked_sub(PARAMETERS).filter(|n| *n > 0)? as f64;
        spread += seen.iter().map(|g| g * g.transpose()).sum::<Matrix6<f64>>() * small_sample;
    }
    let inverse = (information + prior).cholesky()?.inverse();
    Some(Settled { corrected_from_reported: moved, covariance: inverse * spread * inverse, cells })
}

/// What the matches say about a further motion of state 1's world, which moved so far.
fn equations(matches: &[LiftedMatch], moved: &Pose, frames: [usize; 2]) -> Equations {
    let mut all = Equations {
        information: Matrix6::zeros(),
        gradient: Vector6::zeros(),
        by_frame: frames.map(|count| vec![Vector6::zeros(); count]),
    };
    for m in matches {
        let point = moved * m.point1;
        let residual = point - m.point0;
        // Geman and McClure's weight of docs/method.md (1.5).
        let z = residual.norm_squared() / (SIGMAS * m.sigma_m).powi(2);
        let weight = (m.sigma_m * (1.0 + z)).powi(-2);
        let lever = point.coords.cross_matrix();
        let mut slope = nalgebra::Matrix3x6::<f64>::identity();
        slope.fixed_view_mut::<3, 3>(0, 3).copy_from(&-lever);
        let gradient = slope.transpose() * residual * weight;
        all.information += slope.transpose() * slope * weight;
        all.gradient += gradient;
        for (of_state, frame) in all.by_frame.iter_mut().zip(m.frames) {
            if let Some(own) = of_state.get_mut(frame) {
                *own += gradient;
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};
    use rand_core::Rng;

    use super::*;
    use crate::random::{normal, stage_rng};

    const FRAMES: [usize; 2] = [20, 20];

    /// Matches on a floor of two meters whose world slid, and half as many on a door that turned.
    fn matches(slid: &Pose, sigma_m: f64, seed: u64) -> Vec<LiftedMatch> {
        let rng = &mut stage_rng(seed, "floor", 0);
        let door = Pose::new(Vector3::new(0.3, 0.1, 0.0), Vector3::new(0.0, 0.0, 0.6));
        (0..600)
            .map(|i| {
                let place = Vector3::from_fn(|_, _| 2.0 * (rng.next_u64() as f64 / u64::MAX as f64 - 0.5));
                let point0 =
                    Point3::from(if i % 3 == 0 { place } else { Vector3::new(place.x, place.y, 0.0) });
                let to = if i % 3 == 0 { door } else { Pose::identity() };
                let error = Vector3::from_fn(|_, _| sigma_m / 3f64.sqrt() * normal(rng));
                LiftedMatch {
                    point0,
                    point1: slid * to * point0 + error,
                    sigma_m,
                    frames: [i % FRAMES[0], i / FRAMES[0] % FRAMES[1]],
                    pixels: [[0.0; 2]; 2],
                }
            })
            .collect()
    }

    fn still() -> Matrix6<f64> {
        // Surfaces know height and tilt of a floor, and neither its place nor its turn.
        let sigmas = [5e-3, 5e-3, 2e-4, 2e-4, 2e-4, 5e-3];
        Matrix6::from_diagonal(&Vector6::from(sigmas.map(|s| s * s)))
    }

    #[test]
    fn a_floor_that_slid_is_found_with_a_fair_deviation() {
        let slid = Pose::new(Vector3::new(0.004, -0.003, 0.0), Vector3::new(0.0, 0.0, 0.004));
        let mut squared = 0.0;
        for seed in 0..20 {
            let all = matches(&slid, 0.004, seed);
            let found = settle_world(&all, &still(), FRAMES, 0.5, &RansacConfig::default()).unwrap();
            let left = shift_and_turn(&(found.corrected_from_reported * slid));
            assert!(left.amax() < 1.5e-3, "{left}");
            let inverse = found.covariance.try_inverse().unwrap();
            squared += left.dot(&(inverse * left)) / 6.0 / 20.0;
        }
        // Six of twenty values would be 1.
        assert!((0.4..2.0).contains(&squared), "{squared}");
    }

    #[test]
    fn few_matches_say_nothing() {
        let few: Vec<LiftedMatch> = matches(&Pose::identity(), 0.004, 1).into_iter().take(6).collect();
        assert!(settle_world(&few, &still(), FRAMES, 0.5, &RansacConfig::default()).is_none());
        assert!(settle_world(&[], &still(), FRAMES, 0.5, &RansacConfig::default()).is_none());
    }
}
