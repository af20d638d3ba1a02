//! Gap before and after on runs unseen by any fit. See docs/method.md 14.12.

use crate::{
    fit::{
        noise::EffortNoise,
        problem::Problem,
        rollout::{Rollout, Start, roll_window},
        shooting::{Free, Pace, shooting_fit},
    },
    model::joint_model::JointModel,
    record::log::{JointLog, Span, rms},
};

/// Root mean square residuals of one held-out run, rad or m.
#[derive(Clone, Debug, PartialEq)]
pub struct RunGap {
    /// Name of the run.
    pub run: String,
    /// Over windows, for the twin, with fitted start states.
    pub before: f64,
    /// Over windows, for the updated twin.
    pub after: f64,
    /// For the twin simulated over each whole segment, without correction.
    pub full_before: f64,
    /// The same for the updated twin.
    pub full_after: f64,
}

/// Root mean square residuals over all held-out runs, rad or m.
#[derive(Clone, Debug, PartialEq)]
pub struct Gap {
    /// Over windows, for the twin.
    pub before: f64,
    /// Over windows, for the updated twin.
    pub after: f64,
    /// Standard deviation of the measured positions.
    pub noise_floor: f64,
    /// Each run.
    pub runs: Vec<RunGap>,
    /// Each window.
    pub windows: Vec<WindowGap>,
}

/// Root mean square residuals of one window, rad or m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindowGap {
    /// For the twin.
    pub before: f64,
    /// For the updated twin.
    pub after: f64,
}

/// Share of the gap left after the update. See docs/method.md (14.19).
#[must_use]
pub fn left_of(before: f64, after: f64, noise_floor: f64) -> f64 {
    ((after - noise_floor) / (before - noise_floor).max(1e-300)).max(0.0)
}

/// Measured position and residuals of stretches of a held-out log, sample by sample, before and after the
/// update; for plots.
#[derive(Clone, Debug, Default)]
pub struct ResidualSeries {
    /// Seconds.
    pub time_s: Vec<f64>,
    /// Measured position, rad or m.
    pub position: Vec<f64>,
    /// Residual of the twin, rad or m.
    pub before: Vec<f64>,
    /// Residual of the updated twin, rad or m.
    pub after: Vec<f64>,
    /// Index of the first sample of each stretch.
    pub starts: Vec<usize>,
}

/// Residuals of a held-out run, for plots.
#[derive(Clone, Debug, Default)]
pub struct RunSeries {
    /// Over its windows, each with its own start state.
    pub windows: ResidualSeries,
    /// Over its whole segments, each from its first state.
    pub whole: ResidualSeries,
}

/// Residuals of stretches of a log under two models.
fn series_of(log: &JointLog, index: usize, both: [&[(Span, Vec<f64>)]; 2]) -> ResidualSeries {
    let [before, after] = both.map(|all| all.iter().filter(|(s, _)| s.log == index));
    let mut series = ResidualSeries::default();
    for (span, residual) in before {
        let samples = span.start..span.start + span.len;
        series.starts.push(series.time_s.len());
        series.time_s.extend(&log.time_s[samples.clone()]);
        series.position.extend(&log.position[samples]);
        series.before.extend(residual);
    }
    series.after = after.flat_map(|(_, r)| r.clone()).collect();
    series
}

/// A model without the nuisance lag, and its start state in each window by plain least squares.
#[must_use]
pub fn started_model(problem: &Problem, model: &JointModel) -> (JointModel, Vec<Start>) {
    // The lag belongs to the stamps of the fitted runs and is dropped; the lag of a servo belongs to the
    // servo.
    let lag_s = if model.plant.actuator.is_late { model.lag_s } else { 0.0 };
    let model = JointModel { lag_s, ..model.clone() };
    let least = EffortNoise::white_noise(problem.min_sigma_u);
    // With almost no effort noise, whitened residuals equal the residuals up to a factor.
    let starts = shooting_fit(problem, &model, None, least, Free::Starts, Pace::thorough(1)).starts;
    (model, starts)
}

/// Root mean square residual of a model on held-out runs, window by window, rad or m.
#[must_use]
pub fn windowed_rmse(held_out: &Problem, model: &JointModel) -> f64 {
    let (model, starts) = started_model(held_out, model);
    rms(&window_residuals(held_out, &model, &starts).into_iter().flat_map(|(_, r)| r).collect::<Vec<_>>())
}

/// Compares two models on held-out runs. Start states are fitted for each model by plain least squares; those
/// of the second are returned.
#[must_use]
pub fn proven_gap(
    held_out: &Problem,
    before: &JointModel,
    after: &JointModel,
) -> (Gap, Vec<RunSeries>, Vec<Start>) {
    // Each model starts where it fits best, or one would suffer from the start states of the other.
    let [(before, before_starts), (after, after_starts)] =
        [before, after].map(|m| started_model(held_out, m));
    let one = window_residuals(held_out, &before, &before_starts);
    let other = window_residuals(held_out, &after, &after_starts);
    let full_one = full_residuals(held_out, &before, &before_starts);
    let full_other = full_residuals(held_out, &after, &after_starts);
    let mut runs = Vec::new();
    let mut series = Vec::new();
    for (index, log) in held_out.logs.iter().enumerate() {
        runs.push(RunGap {
            run: log.run.clone(),
            before: rms_of_log(&one, index),
            after: rms_of_log(&other, index),
            full_before: rms_of_log(&full_one, index),
            full_after: rms_of_log(&full_other, index),
        });
        series.push(RunSeries {
            windows: series_of(log, index, [&one, &other]),
            whole: series_of(log, index, [&full_one, &full_other]),
        });
    }
    let windows =
        one.iter().zip(&other).map(|((_, b), (_, a))| WindowGap { before: rms(b), after: rms(a) }).collect();
    let all = |of: &[(Span, Vec<f64>)]| rms(&of.iter().flat_map(|(_, r)| r.clone()).collect::<Vec<_>>());
    (
        Gap { before: all(&one), after: all(&other), noise_floor: held_out.noise_floor(), runs, windows },
        series,
        after_starts,
    )
}

/// Root mean square of the residuals of one log, rad or m.
fn rms_of_log(all: &[(Span, Vec<f64>)], index: usize) -> f64 {
    let own = all.iter().filter(|(s, _)| s.log == index).flat_map(|(_, r)| r.clone());
    rms(&own.collect::<Vec<f64>>())
}

/// Residuals of each window simulated from its start state.
#[must_use]
pub fn window_residuals(problem: &Problem, model: &JointModel, starts: &[Start]) -> Vec<(Span, Vec<f64>)> {
    let drives = problem.model_drives(model);
    let mut rollout = Rollout::default();
    let windows = problem.windows.iter().enumerate();
    windows
        .map(|(w, span)| {
            let log = &problem.logs[span.log];
            roll_window(model, problem.catalogue, log, &drives[span.log], *span, starts[w], &mut rollout);
            (
                *span,
                rollout.position.iter().enumerate().map(|(k, y)| log.position[span.start + k] - y).collect(),
            )
        })
        .collect()
}

/// Residuals of whole segments, each simulated from the start state of its first window.
fn full_residuals(problem: &Problem, model: &JointModel, starts: &[Start]) -> Vec<(Span, Vec<f64>)> {
    let drives = problem.model_drives(model);
    let mut rollout = Rollout::default();
    let mut all = Vec::new();
    for (w, window) in problem.windows.iter().enumerate() {
        let log = &problem.logs[window.log];
        let segments = log.gapless_segments(window.log);
        if let Some(segment) = segments.into_iter().find(|s| s.start == window.start) {
            roll_window(
                model,
                problem.catalogue,
                log,
                &drives[segment.log],
                segment,
                starts[w],
                &mut rollout,
            );
            all.push((
                segment,
                rollout
                    .position
                    .iter()
                    .enumerate()
                    .map(|(k, y)| log.position[segment.start + k] - y)
                    .collect(),
            ));
        }
    }
    all
}
