//! Fits the parameters of all joints of a chain together, by shooting over windows.
//! See docs/method.md (14.11).
//!
//! Derivatives are difference quotients: windows are short, and models hold friction of any kind.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::{
    fit::{
        damping,
        multibody::{
            joints::Joints,
            normal::{MultibodyBlock, cluster_covariance, multibody_step},
        },
        problem::Problem,
        rollout::Start,
        shooting::{Free, moved_model},
    },
    model::{
        effect::{Coverage, Dimension},
        joint_model::JointModel,
    },
    record::drive::Drive,
};

/// Step of a difference quotient, as a share of the typical size of a parameter or state.
/// chosen: rounding errors divided by it, and its square, are both far below the resolution of a window.
const DIFFERENCE: f64 = 1e-4;
/// Limits on the length of a fit.
#[derive(Clone, Copy, Debug)]
pub struct MultibodyPace {
    /// Rounds; the size of the residuals is estimated anew between them.
    rounds: usize,
    /// Most steps per round.
    steps: usize,
}

impl MultibodyPace {
    /// Until the fit converges.
    pub const THOROUGH: Self = Self { rounds: 3, steps: 8 };
    /// From a start near the optimum, far enough to see the gain by an effect.
    pub const TRIAL: Self = Self { rounds: 1, steps: 3 };
}

/// Least gain of a step for another one to follow, as a share of the cost.
/// chosen: far below the cost of one deviation of a parameter, for some hundred independent measurements.
const ENOUGH: f64 = 1e-4;

/// Fitted models of the joints with start states and errors.
#[derive(Clone, Debug)]
pub struct MultibodyFit {
    /// Model of each joint.
    pub models: Vec<JointModel>,
    /// Start states: by window, by joint.
    pub starts: Vec<Vec<Start>>,
    /// Root mean square residual of each joint, rad or m.
    pub size: Vec<f64>,
    /// Twice the log likelihood, up to a constant.
    pub twice_likelihood: f64,
    /// Covariance of the free parameters of all joints, one joint after the other.
    pub covariance: DMatrix<f64>,
    /// Number of windows determining each free parameter.
    pub witnesses: Vec<f64>,
}

/// Fits the joints' models from given ones; `starts` come from a fit of similar models.
pub fn multibody_fit(
    joints: &Joints,
    models: &[JointModel],
    starts: Option<&[Vec<Start>]>,
    free: Free,
    pace: MultibodyPace,
) -> MultibodyFit {
    let starts = starts.map_or_else(|| joints.smoothed_starts(models), <[Vec<Start>]>::to_vec);
    let mut at = FitState { models: models.to_vec(), starts };
    let frozen: Vec<bool> = models
        .iter()
        // The lag is taken from the fits of the single joints.
        .flat_map(|m| (0..m.free_count()).map(|i| i == 0 || free == Free::Starts))
        .collect();
    let mut size = residual_sizes(joints, &at);
    for _ in 0..pace.rounds {
        iterate_steps(joints, &mut at, &size, &frozen, pace.steps);
        size = residual_sizes(joints, &at);
    }
    let blocks = window_blocks(joints, &at, &size, &frozen);
    let share = joints.problems[0].weighing.counting_share();
    let (covariance, witnesses) = cluster_covariance(&blocks, &frozen, share);
    // Two independent measurements of a window determine a start state.
    let free =
        joints.problems.iter().map(|p| (p.independent_count() - 2.0 * p.windows.len() as f64).max(1.0));
    let twice_likelihood = free.zip(&size).map(|(free, size)| -2.0 * free * size.ln()).sum();
    let FitState { models, starts } = at;
    MultibodyFit { models, starts, size, twice_likelihood, covariance, witnesses }
}

/// Root mean square residuals under models, by window and joint, with the best start states.
pub fn window_sizes(joints: &Joints, models: &[JointModel]) -> Vec<Vec<f64>> {
    let fitted = multibody_fit(joints, models, None, Free::Starts, MultibodyPace::THOROUGH);
    let drives = joints.joint_drives(models);
    let n = models.len();
    (0..joints.window_count())
        .into_par_iter()
        .map(|w| rms_by_joint(&joints.window_residuals(models, &drives, w, &fitted.starts[w]), n))
        .collect()
}

/// Root mean square residual of each of `n` joints; `residuals` holds all joints sample by sample.
fn rms_by_joint(residuals: &[f64], n: usize) -> Vec<f64> {
    let samples = (residuals.len() / n).max(1) as f64;
    let mut all = Vec::with_capacity(n);
    for i in 0..n {
        let square = residuals.iter().skip(i).step_by(n).map(|r| r * r).sum::<f64>();
        all.push((square / samples).sqrt());
    }
    all
}

/// Current models and start states of a fit.
#[derive(Clone)]
struct FitState {
    models: Vec<JointModel>,
    starts: Vec<Vec<Start>>,
}

/// Root mean square residual of each joint, at least its noise.
fn residual_sizes(joints: &Joints, at: &FitState) -> Vec<f64> {
    let drives = joints.joint_drives(&at.models);
    let n = at.models.len();
    let all: Vec<Vec<f64>> = (0..joints.window_count())
        .into_par_iter()
        .map(|w| joints.window_residuals(&at.models, &drives, w, &at.starts[w]))
        .collect();
    let mut sizes = Vec::with_capacity(n);
    for i in 0..n {
        let own = all.iter().flat_map(|r| r.iter().skip(i).step_by(n));
        let (sum, count) = own.fold((0.0, 0.0), |(sum, count), r| (sum + r * r, count + 1.0));
        sizes.push(f64::sqrt(sum / f64::max(count, 1.0)).max(joints.problems[i].noise_floor()));
    }
    sizes
}

fn iterate_steps(joints: &Joints, at: &mut FitState, size: &[f64], frozen: &[bool], steps: usize) {
    let mut damping = damping::LEAST_RISEN;
    let mut now = window_blocks(joints, at, size, frozen);
    for _ in 0..steps {
        let Some(step) = multibody_step(&now, frozen, damping) else {
            damping *= 10.0;
            continue;
        };
        let trial = moved_by(joints, at, &step.parameters, &step.states);
        let cost: f64 = now.iter().map(|b| b.cost).sum();
        let after = window_costs(joints, &trial, size).iter().sum::<f64>();
        if after < cost {
            *at = trial;
            damping = (damping * damping::FALL).max(damping::LEAST);
            if cost - after < ENOUGH * cost {
                break;
            }
            now = window_blocks(joints, at, size, frozen);
        } else {
            damping = (damping * damping::RISE).max(damping::LEAST_RISEN);
            if damping > 1e5 {
                break;
            }
        }
    }
}

/// Models and start states after a step, kept within their bounds.
fn moved_by(joints: &Joints, at: &FitState, parameters: &DVector<f64>, states: &[DVector<f64>]) -> FitState {
    let mut first = 0;
    let mut models = Vec::with_capacity(at.models.len());
    for (problem, model) in joints.problems.iter().zip(&at.models) {
        let own = parameters.rows(first, model.free_count()).into_owned();
        first += model.free_count();
        models.push(moved_model(problem, model, &own));
    }
    let mut starts = at.starts.clone();
    for (starts, step) in starts.iter_mut().zip(states) {
        for (i, start) in starts.iter_mut().enumerate() {
            start.position += step[2 * i];
            start.velocity += step[2 * i + 1];
        }
    }
    FitState { models, starts }
}

/// Residual of a diverged rollout, in units of the residuals' size.
/// chosen: larger than any other residual; its square summed over a recording is still finite.
const LOST: f64 = 1e100;

/// Residuals of a window in units of each joint's size.
fn scaled_residuals(
    joints: &Joints,
    models: &[JointModel],
    drives: &[Vec<Drive>],
    starts: &[Start],
    size: &[f64],
    window: usize,
) -> DVector<f64> {
    let mut residuals = joints.window_residuals(models, drives, window, starts);
    for (k, r) in residuals.iter_mut().enumerate() {
        let x = *r / size[k % size.len()];
        *r = if x.is_finite() { x.clamp(-LOST, LOST) } else { LOST };
    }
    DVector::from_vec(residuals)
}

fn window_costs(joints: &Joints, at: &FitState, size: &[f64]) -> Vec<f64> {
    let drives = joints.joint_drives(&at.models);
    (0..joints.window_count())
        .into_par_iter()
        .map(|w| scaled_residuals(joints, &at.models, &drives, &at.starts[w], size, w).norm_squared())
        .collect()
}

/// Models with one parameter changed, for a difference quotient.
struct MovedParameter {
    /// Index among the free parameters of all joints.
    column: usize,
    models: Vec<JointModel>,
    /// The drives of these models.
    drives: Vec<Vec<Drive>>,
    step: f64,
}

/// Normal equations of all windows; columns of `frozen` parameters are zero.
fn window_blocks(joints: &Joints, at: &FitState, size: &[f64], frozen: &[bool]) -> Vec<MultibodyBlock> {
    let drives = joints.joint_drives(&at.models);
    let free: usize = at.models.iter().map(JointModel::free_count).sum();
    let mut beside = Vec::with_capacity(free);
    let mut column = 0;
    for (i, model) in at.models.iter().enumerate() {
        let scales = typical_sizes(&joints.problems[i], model);
        let first = column;
        column += model.free_count();
        for (p, scale) in scales.iter().enumerate().filter(|(p, _)| !frozen[first + p]) {
            let mut parameters = model.free_parameters();
            let step = DIFFERENCE * scale.max(parameters[p].abs());
            parameters[p] += step;
            let mut models = at.models.clone();
            models[i] = model.with_parameters(&parameters);
            let drives = joints.joint_drives(&models);
            beside.push(MovedParameter { column: first + p, models, drives, step });
        }
    }
    (0..joints.window_count())
        .into_par_iter()
        .map(|w| window_block(joints, at, &drives, &beside, size, free, w))
        .collect()
}

/// Normal equations of a window; `free` is the number of free parameters of all joints.
fn window_block(
    joints: &Joints,
    at: &FitState,
    drives: &[Vec<Drive>],
    beside: &[MovedParameter],
    size: &[f64],
    free: usize,
    window: usize,
) -> MultibodyBlock {
    let n = at.models.len();
    let own_starts = &at.starts[window];
    let residual = scaled_residuals(joints, &at.models, drives, own_starts, size, window);
    let mut by = DMatrix::zeros(residual.len(), 2 * n + free);
    for i in 0..n {
        let coverage = &joints.problems[i].coverage;
        for (k, scale) in [coverage.travel, coverage.speed.1].into_iter().enumerate() {
            let step = DIFFERENCE * scale.max(1e-9);
            let mut starts = own_starts.clone();
            let state = if k == 0 { &mut starts[i].position } else { &mut starts[i].velocity };
            *state += step;
            let other = scaled_residuals(joints, &at.models, drives, &starts, size, window);
            by.set_column(2 * i + k, &((&residual - other) / step));
        }
    }
    for moved in beside {
        let other = scaled_residuals(joints, &moved.models, &moved.drives, own_starts, size, window);
        by.set_column(2 * n + moved.column, &((&residual - other) / moved.step));
    }
    MultibodyBlock::of_residuals(&residual, &by, 2 * n)
}

/// Typical size of each free parameter of a model.
fn typical_sizes(problem: &Problem, model: &JointModel) -> Vec<f64> {
    let coverage = &problem.coverage;
    let of_terms = model.terms.iter().flat_map(|t| {
        let parameters = problem.catalogue[t.effect].parameters();
        parameters.iter().take(t.p.len()).map(|p| typical_size(p.dimension, coverage))
    });
    let [gain, damping] = problem.plant.actuator.is_found;
    let of_actuator = [gain.then_some(1.0), damping.then(|| typical_size(Dimension::Damping, coverage))];
    std::iter::once(coverage.interval_s).chain(of_terms).chain(of_actuator.into_iter().flatten()).collect()
}

/// Typical size of a parameter, as a share of its size if it alone caused the motion.
/// chosen: several act together.
const TYPICAL: f64 = 0.1;

/// [`TYPICAL`] times the size of a parameter of this dimension, if it alone caused the motion.
fn typical_size(dimension: Dimension, coverage: &Coverage) -> f64 {
    let effort = coverage.effort_rms.max(1e-9);
    let way = coverage.travel.max(1e-9);
    let speed = coverage.speed.1.max(1e-9);
    TYPICAL
        * match dimension {
            Dimension::Position => way,
            Dimension::Velocity => speed,
            Dimension::Effort => effort,
            Dimension::Damping => effort / speed,
            Dimension::Drag => effort / speed.powi(2),
            Dimension::Stiffness => effort / way,
            Dimension::CubicStiffness => effort / way.powi(3),
            Dimension::Inertia => coverage.inertia,
            Dimension::Time => coverage.interval_s,
            Dimension::WaveNumber => 1.0 / way,
            Dimension::Ratio => 1.0,
        }
}
