//! Whitening of windows against each window by itself.

use rand_core::SeedableRng;

use super::*;
use crate::{
    fit::problem::Weighing,
    judge::simulated::{pendulum, simulated, with},
    model::{effects::catalogue, joint_model::Catalogue},
    record::drive::Hold,
};

/// Two runs of a joint with friction.
fn problem(effects: &Catalogue) -> Problem<'_> {
    let plant = pendulum(0.6);
    let truth = with(effects, &plant, &[("coulomb_friction", &[0.05])]);
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(2);
    let logs = (0..2).map(|run| simulated(effects, &truth, run, &mut rng)).collect();
    Problem::new(effects, &plant, true, logs, Hold::Zero)
}

#[test]
fn windows_side_by_side_are_filtered_as_one_by_one() {
    let effects = catalogue(0);
    let mut problem = problem(&effects);
    // Readings that differ, and windows that do in length.
    for (log, readings) in problem.readings.iter_mut().enumerate() {
        readings.iter_mut().enumerate().for_each(|(k, r)| *r *= 1.0 + 0.1 * (k % 7 + log) as f64);
    }
    problem.windows[1].len -= 9;
    problem.windows[5].start += 20;
    problem.windows[5].len -= 20;
    assert!(problem.windows.len() > SIDE_BY_SIDE && problem.windows.len() % SIDE_BY_SIDE != 1);
    let model = with(&effects, &problem.plant, &[("coulomb_friction", &[0.05])]);
    let noise = EffortNoise { white: 0.02, wander: 0.03, memory_s: 0.1, deflection: 1e-4 };
    let whole = Whitening::new(&problem, &model, &noise);
    assert_eq!(whole.locals.iter().map(Vec::len).collect::<Vec<_>>(), [800, 800]);
    assert_eq!(whole.gains.len(), problem.windows.len());
    let mut log_variance = 0.0;
    for (window, found) in problem.windows.iter().zip(&whole.gains) {
        let locals = linearized_joint(
            &model,
            &effects,
            &problem.logs[window.log],
            window.log,
            &problem.traces[window.log],
        );
        let mut gains = Gains::of_noise(&noise);
        assert_eq!(found.len(), window.len);
        for (k, gain) in found.iter().enumerate() {
            let at = window.start + k;
            let alone = gains.next(&locals[at], problem.readings[window.log][at]);
            assert!(alone.scale == gain.scale && alone.kq == gain.kq && alone.kd == gain.kd, "{k}");
        }
        log_variance += gains.log_variance();
    }
    assert!((whole.log_variance / log_variance - 1.0).abs() < 1e-12);
    // Where a share of the samples counts, so does that share of their variances.
    problem.weighing = Weighing::Predictions { independent: 0.25 };
    let share = Whitening::new(&problem, &model, &noise).log_variance;
    assert!((share / (0.25 * log_variance) - 1.0).abs() < 1e-12);
}

#[test]
fn residuals_stand_behind_the_sensitivities() {
    let effects = catalogue(0);
    let problem = problem(&effects);
    let model = with(&effects, &problem.plant, &[("coulomb_friction", &[0.05])]);
    let starts = problem.smoothed_starts(&model);
    let drives = problem.model_drives(&model);
    let mut rolled = Rollout::default();
    for (w, window) in problem.windows.iter().enumerate() {
        predict_window(&problem, &model, &drives, w, starts[w], &mut rolled);
        assert_eq!(rolled.rows.len(), window.len);
        // Start position, start velocity, lag, friction; then the residual.
        assert_eq!(residual_column(model.free_count()), 4);
        for (k, row) in rolled.rows.iter().enumerate() {
            let measured = problem.logs[window.log].position[window.start + k];
            assert_eq!(row[4], measured - rolled.position[k]);
        }
        let first = &rolled.rows[0];
        assert!(first[0] == 1.0 && first[1] == 0.0 && first[4].abs() < 1e-3, "{first:?}");
    }
}

#[test]
fn start_states_have_a_prior_of_ten_times_what_the_motion_covers() {
    let effects = catalogue(0);
    let mut problem = problem(&effects);
    (problem.coverage.position, problem.coverage.speed) = ((-0.5, 1.5), (1.0, 4.0));
    problem.noise.at_rest = 0.5;
    let ridge = start_ridge(&problem);
    assert!((ridge[(0, 0)] - 1.0 / (25.0 * 25.0)).abs() < 1e-15, "{ridge}");
    assert!((ridge[(1, 1)] - 1.0 / (40.0 * 40.0)).abs() < 1e-15, "{ridge}");
    assert_eq!((ridge[(0, 1)], ridge[(1, 0)]), (0.0, 0.0));
    // A joint that hardly moved may be as fast as it is far.
    problem.coverage.speed.1 = 0.1;
    assert!((start_ridge(&problem)[(1, 1)] - 1.0 / (20.0 * 20.0)).abs() < 1e-15);
}
