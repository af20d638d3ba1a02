//! Parameters as reported: fitted with small steps.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::{
    fit::{
        problem::Problem,
        shooting::{Fit, Free, Pace, shooting_fit},
    },
    judge::spread::{Spread, with_common},
    model::{
        actuator::GAIN_DEVIATION,
        effect::Place,
        joint_model::{JointModel, SETTLE_S},
    },
};

/// Least gain of log likelihood by a step for another one to follow.
/// chosen: half of the search's, as this is the last fit.
const ENOUGH: f64 = 0.1;
/// Settle times around the best one, as shares of it: the grid's ratio of two is too coarse for an average.
/// chosen: likely times are close to the best.
const NEAR: [f64; 4] = [0.7, 0.85, 1.2, 1.45];

/// The model fitted with small steps, averaged over the settle times of friction by their likelihood, and its
/// uncertainty. The covariance includes the moves of the parameters due to the step size, to the settle time,
/// and for a delay to the stamps. If something remains beyond noise, it also includes an error common to all
/// windows and the gain error of the effort sensor.
#[must_use]
pub fn refined_model(problem: &Problem, coarse: &Fit) -> (JointModel, Spread) {
    let problem = &problem.with_small_steps();
    let pace = Pace { rounds: 1, steps: 6, enough: ENOUGH, settles: false, searches: false, hears: false };
    let fine = fit_at(problem, coarse.model.settle_s, coarse, pace);
    let mut fits = vec![fine.clone()];
    if fine.model.has_friction(problem.catalogue) {
        let own = fine.model.settle_s;
        let between = SETTLE_S.iter().copied().filter(|s| *s != own);
        let near = NEAR.iter().map(|f| f * own).filter(|s| *s > 0.0);
        let more: Vec<Fit> = between
            .chain(near)
            .collect::<Vec<_>>()
            .par_iter()
            .map(|s| fit_at(problem, *s, &fine, Pace { steps: pace.steps / 2, ..pace }))
            .collect();
        fits.extend(more);
    }
    let best = fits.iter().map(|f| f.log_likelihood).fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = fits.iter().map(|f| (f.log_likelihood - best).exp()).collect();
    let total: f64 = weights.iter().sum();
    let mean =
        |of: &dyn Fn(&Fit) -> f64| fits.iter().zip(&weights).map(|(f, w)| w * of(f)).sum::<f64>() / total;
    let own: Vec<Vec<f64>> = fits.iter().map(|f| f.model.free_parameters()).collect();
    let parameters: Vec<f64> = (0..own[0].len())
        .map(|i| own.iter().zip(&weights).map(|(p, w)| w * p[i]).sum::<f64>() / total)
        .collect();
    let mut covariance = fits
        .iter()
        .zip(&weights)
        .fold(DMatrix::zeros(own[0].len(), own[0].len()), |c, (f, w)| c + &f.covariance * (*w / total));
    if fine.noise.has_remainder() {
        covariance = with_common(&covariance, &fine.witnesses);
        if let Some(moved) = by_gain(problem, &fine, pace) {
            covariance += &moved * moved.transpose();
        }
    }
    for (i, before) in coarse.model.free_parameters().into_iter().enumerate() {
        let spread: f64 =
            own.iter().zip(&weights).map(|(p, w)| w * (p[i] - parameters[i]).powi(2)).sum::<f64>() / total;
        // The error left by small steps, a third of their shift, and the spread over settle times.
        covariance[(i, i)] += (own[0][i] - before).powi(2) / STEP_RATIO + spread;
    }
    let model =
        JointModel { settle_s: mean(&|f| f.model.settle_s), ..fine.model.with_parameters(&parameters) };
    // With a delay in the model the lag was held at zero; its prior uncertainty is added.
    if let Some((_, at)) = model.scalar_of(problem.catalogue, Place::Delay) {
        covariance[(at, at)] += problem.lag_sigma_s * problem.lag_sigma_s;
    }
    (model, Spread { covariance, witnesses: fine.witnesses })
}

/// Refits with a given settle time, from another fit.
fn fit_at(problem: &Problem, settle_s: f64, from: &Fit, pace: Pace) -> Fit {
    let model = JointModel { settle_s, ..from.model.clone() };
    shooting_fit(problem, &model, Some(&from.starts), from.noise, Free::All, pace)
}

/// Change of the parameters if the measured effort is larger by one standard deviation of its sensor's gain.
fn by_gain(problem: &Problem, fitted: &Fit, pace: Pace) -> Option<DVector<f64>> {
    let mut model = fitted.model.clone();
    if !model.plant.actuator.is_measured() {
        return None;
    }
    model.plant.actuator.gain *= 1.0 + GAIN_DEVIATION;
    let other = shooting_fit(problem, &model, Some(&fitted.starts), fitted.noise, Free::All, pace).model;
    Some(DVector::from_vec(other.free_parameters()) - DVector::from_vec(fitted.model.free_parameters()))
}

/// Ratio of the squared shift between the steps of the search and of the last fit to the squared error still
/// left: the error is of first order in the step at worst, and the last step is a quarter.
/// derived: `((1 - 1/4) / (1/4))^2`.
const STEP_RATIO: f64 = 9.0;

#[cfg(test)]
mod tests {
    use rand_core::SeedableRng;

    use super::*;
    use crate::{
        fit::noise::EffortNoise,
        judge::simulated::{pendulum, simulated, with},
        model::effects::catalogue,
        record::drive::Hold,
    };

    #[test]
    fn an_inertia_is_known_no_better_than_the_gain_of_the_effort() {
        let effects = catalogue(0);
        let mut plant = pendulum(0.0);
        plant.damping = 0.0;
        let truth = with(&effects, &plant, &[("inertia", &[0.02])]);
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(4);
        let logs = vec![simulated(&effects, &truth, 0, &mut rng)];
        let problem = Problem::new(&effects, &plant, true, logs, Hold::Zero);
        let noise = EffortNoise::white_noise(1e-3);
        let fitted = shooting_fit(&problem, &truth, None, noise, Free::All, Pace::thorough(1));
        let moved = by_gain(&problem, &fitted, Pace::thorough(1)).unwrap();
        // Without damping, friction and load the whole inertia goes with the gain.
        let wanted = GAIN_DEVIATION * (0.05 + 0.02);
        assert!((moved[1] / wanted - 1.0).abs() < 0.02, "{} {wanted}", moved[1]);
        // A gain that is found already is in the covariance.
        let mut found = fitted.clone();
        found.model.plant.actuator.is_found[0] = true;
        assert!(by_gain(&problem, &found, Pace::WARM).is_none());
    }
}
