//! Score test: how much every candidate would explain of what a fitted model leaves, to first order, at every shape.

use nalgebra::{DMatrix, DVector};

use super::{
    drive::Drive,
    effect::{At, Effect, Place, Response, run_time_s},
    fit::{Fit, MAX_FIT_FREE, Whitening, predict},
    joint_model::{Catalogue, JointModel},
    log::Span,
    problem::Problem,
    rollout::{MAX_COLUMNS, Rollout, Row, efforts_at},
    whiten::{respond, whiten},
};

/// Most columns that one score tests together.
const MAX_TESTED: usize = 32;

/// A fitted model's whitened residuals with what its own unknowns could still take up.
pub struct Screen<'p, 'c> {
    problem: &'p Problem<'c>,
    /// Of the fitted model.
    pub whitening: Whitening,
    /// Per window and sample: residual, two start columns, parameter columns; residual and parameters are orthogonal
    /// to the start columns, and these to each other.
    windows: Vec<Vec<Row>>,
    /// Number of parameter columns.
    parameters: usize,
    /// Inverse of the parameters' normal matrix.
    inverse: DMatrix<f64>,
    /// Parameters' products with the residual; near zero at a minimum.
    gradient: DVector<f64>,
    /// Middle states of every log.
    middle: Vec<Middle>,
    /// Predicted positions of each window.
    predicted: Vec<Vec<f64>>,
}

/// States between samples.
#[derive(Clone, Debug, Default)]
pub struct Middle {
    /// Position.
    pub position: Vec<f64>,
    /// Velocity.
    pub velocity: Vec<f64>,
    /// Effort.
    pub effort: Vec<f64>,
    /// Acceleration of the model.
    pub acceleration: Vec<f64>,
}

/// What a set of columns would explain.
#[derive(Clone, Debug)]
pub struct Score {
    /// Twice the gain of log likelihood.
    pub gain: f64,
    /// Estimated amplitudes.
    pub amplitude: Vec<f64>,
    /// Squared normal scores of the single columns.
    pub single: Vec<f64>,
    /// Each window's products with the residual, for tests by sign flips.
    pub products: Vec<Vec<f64>>,
    /// Inverse of the columns' normal matrix.
    pub inverse: DMatrix<f64>,
}

/// An effect at a shape, with its score.
#[derive(Clone, Debug)]
pub struct Hit {
    /// Index in the catalogue.
    pub effect: usize,
    /// Start of a fit.
    pub p: Vec<f64>,
    /// Score.
    pub gain: f64,
}

impl<'p, 'c> Screen<'p, 'c> {
    /// Prepares the score test at a fit.
    #[must_use]
    pub fn new(problem: &'p Problem<'c>, fit: &Fit) -> Self {
        let whitening = Whitening::new(problem, &fit.model, fit.sigma_u);
        let drives = problem.drives(&fit.model);
        let free = fit.model.free().min(MAX_FIT_FREE);
        let mut windows = Vec::with_capacity(problem.windows.len());
        let mut predicted = Vec::with_capacity(problem.windows.len());
        let mut normal = DMatrix::zeros(free, free);
        let mut gradient = DVector::zeros(free);
        let mut rollout = Rollout::default();
        for (w, span) in problem.windows.iter().enumerate() {
            predict(problem, &fit.model, &drives, w, fit.starts[w], &mut rollout);
            whiten::<MAX_COLUMNS>(&mut rollout.rows, &whitening.locals[span.log][span.start..], &whitening.gains[w]);
            predicted.push(rollout.position.clone());
            let rows = orthogonal(&rollout.rows, free);
            for row in &rows {
                for i in 0..free {
                    gradient[i] += row[3 + i] * row[0];
                    for j in 0..free {
                        normal[(i, j)] += row[3 + i] * row[3 + j];
                    }
                }
            }
            windows.push(rows);
        }
        normal[(0, 0)] += 1.0 / (problem.lag_sigma_s * problem.lag_sigma_s);
        for i in 0..free {
            normal[(i, i)] = normal[(i, i)] * (1.0 + 1e-9) + 1e-12;
        }
        let inverse = normal.try_inverse().unwrap_or_else(|| DMatrix::zeros(free, free));
        let middle = middles(problem, &fit.model);
        Self { problem, whitening, windows, parameters: free, inverse, gradient, middle, predicted }
    }

    /// Middle states of every log.
    #[must_use]
    pub fn middle(&self) -> &[Middle] {
        &self.middle
    }

    /// Scores columns. `fill(window, column, effort, direct)` writes what a column of amplitude one puts on each sample
    /// of a window: an effort, and a change of the measurement. It gives false where both are zero.
    pub fn score(&self, count: usize, mut fill: impl FnMut(Span, usize, &mut [f64], &mut [f64]) -> bool) -> Option<Score> {
        let count = count.min(MAX_TESTED);
        let p = self.parameters;
        let mut normal = DMatrix::zeros(count, count);
        let mut with_parameters = DMatrix::zeros(count, p);
        let mut products = Vec::with_capacity(self.windows.len());
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); count];
        for (w, span) in self.problem.windows.iter().enumerate() {
            let mut window = vec![0.0; count];
            let mut starts = vec![[0.0; 2]; count];
            let mut active = vec![false; count];
            let locals = &self.whitening.locals[span.log][span.start..span.start + span.len];
            for c in 0..count {
                let (mut effort, mut direct) = (vec![0.0; span.len], vec![0.0; span.len]);
                active[c] = fill(*span, c, &mut effort, &mut direct);
                if !active[c] {
                    continue;
                }
                columns[c].resize(span.len, 0.0);
                respond(&effort, Some(&direct), locals, &self.whitening.gains[w], &mut columns[c]);
                let mut sums: Row = [0.0; MAX_COLUMNS];
                for (x, row) in columns[c].iter().zip(&self.windows[w]) {
                    for i in 0..3 + p {
                        sums[i] += x * row[i];
                    }
                }
                window[c] = sums[0];
                starts[c] = [sums[1], sums[2]];
                for i in 0..p {
                    with_parameters[(c, i)] += sums[3 + i];
                }
            }
            for i in (0..count).filter(|&i| active[i]) {
                for j in (0..=i).filter(|&j| active[j]) {
                    let dot: f64 = columns[i].iter().zip(&columns[j]).map(|(a, b)| a * b).sum();
                    let dot = dot - starts[i][0] * starts[j][0] - starts[i][1] * starts[j][1];
                    normal[(i, j)] += dot;
                    if i != j {
                        normal[(j, i)] += dot;
                    }
                }
            }
            products.push(window);
        }
        self.finish(normal, &with_parameters, products)
    }

    fn finish(&self, mut normal: DMatrix<f64>, with_parameters: &DMatrix<f64>, products: Vec<Vec<f64>>) -> Option<Score> {
        let count = normal.nrows();
        let raw: Vec<f64> = (0..count).map(|i| normal[(i, i)]).collect();
        normal -= with_parameters * &self.inverse * with_parameters.transpose();
        let taken = with_parameters * &self.inverse * &self.gradient;
        let gradient = DVector::from_fn(count, |i, _| products.iter().map(|w| w[i]).sum::<f64>() - taken[i]);
        // A column that the model's own parameters already span says nothing.
        let mut single = vec![0.0; count];
        for i in 0..count {
            if normal[(i, i)] > 1e-6 * raw[i] && raw[i] > 0.0 {
                single[i] = gradient[i] * gradient[i] / normal[(i, i)];
                normal[(i, i)] *= 1.0 + 1e-7;
            } else {
                normal.row_mut(i).fill(0.0);
                normal.column_mut(i).fill(0.0);
                normal[(i, i)] = f64::INFINITY;
            }
        }
        for i in 0..count {
            if normal[(i, i)].is_infinite() {
                normal[(i, i)] = 1e300;
            }
        }
        let inverse = normal.try_inverse()?;
        let amplitude = &inverse * &gradient;
        let gain = gradient.dot(&amplitude);
        gain.is_finite().then(|| Score { gain, amplitude: amplitude.iter().copied().collect(), single, products, inverse })
    }

    /// The best shapes of an effect, best first, `keep` at most.
    #[must_use]
    pub fn hits(&self, index: usize, keep: usize) -> Vec<Hit> {
        let effect = &self.problem.catalogue[index];
        let mut hits: Vec<Hit> =
            effect.shapes(&self.problem.coverage).into_iter().filter_map(|shape| self.hit(index, effect.as_ref(), &shape)).collect();
        hits.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        hits.truncate(keep);
        hits
    }

    fn hit(&self, index: usize, effect: &dyn Effect, shape: &[f64]) -> Option<Hit> {
        let problem = self.problem;
        let place = effect.place();
        let tested = effect.parameters().iter().filter(|p| p.neutral.is_some()).count();
        let late: Vec<Drive> = match place {
            Place::Delay => problem.logs.iter().map(|l| Drive::new(l, problem.hold, shape[0], problem.finer)).collect(),
            _ => Vec::new(),
        };
        let still = 0.01 * problem.coverage.speed.1;
        let score = self.score(tested, |span, column, effort, direct| match place {
            Place::Delay => {
                let d = &late[span.log];
                for i in 0..span.len.saturating_sub(1) {
                    let k = span.start + i;
                    let mean = d.effort[k * d.steps..(k + 1) * d.steps].iter().sum::<f64>() / d.steps as f64;
                    effort[i] = mean - problem.traces[span.log].effort[k];
                }
                true
            }
            Place::Play => {
                // The predicted motion, not the measured one: what is measured has gone through the play already.
                let Some(window) = problem.windows.iter().position(|w| *w == span) else { return false };
                let predicted = &self.predicted[window];
                let mut gauge = predicted[0] - problem.traces[span.log].direction[span.start] * shape[0];
                for i in 0..span.len {
                    let q = predicted[i];
                    gauge = gauge.clamp(q - shape[0], q + shape[0]);
                    direct[i] = gauge - q;
                }
                true
            }
            _ => self.fill_effort(effect, shape, span, column, still, effort),
        })?;
        let mut p = shape.to_vec();
        if !matches!(place, Place::Delay | Place::Play) {
            for (i, a) in score.amplitude.iter().enumerate() {
                let (low, high) = effect.bounds(i, &problem.coverage);
                p[i] = (shape[i] + a).clamp(low, high);
            }
        }
        Some(Hit { effect: index, p, gain: score.gain })
    }

    /// The effort of one amplitude of an effect over a window.
    fn fill_effort(&self, effect: &dyn Effect, shape: &[f64], span: Span, column: usize, still: f64, out: &mut [f64]) -> bool {
        let problem = self.problem;
        let (log, m) = (&problem.logs[span.log], &self.middle[span.log]);
        let mut now = [0.0; 8];
        let mut any = false;
        for i in 0..span.len.saturating_sub(1) {
            let k = span.start + i;
            let (q, v, u) = (m.position[k], m.velocity[k], m.effort[k]);
            out[i] = match effect.place() {
                Place::Effort | Place::Contact | Place::Friction => {
                    for (x, other) in now.iter_mut().zip(&log.others) {
                        *x = other[k];
                    }
                    let at = At {
                        q,
                        v,
                        u,
                        t: run_time_s(span.log, log, k),
                        direction: if v < 0.0 { -1.0 } else { 1.0 },
                        others: &now,
                        load: 0.0,
                        carried: log.carried.get(k),
                    };
                    let mut r = Response::default();
                    effect.respond(&at, shape, &mut r);
                    if effect.place() != Place::Friction { r.p[column] } else { -r.p[column] * v / (v * v + still * still).sqrt() }
                }
                Place::Inertia => -m.acceleration[k],
                Place::Gain => u,
                Place::Bias => problem.plant.load_at(log.carried.get(k), q).1,
                Place::Scale => {
                    let (load, slope) = problem.plant.load_at(log.carried.get(k), q);
                    u - load + slope * q
                }
                Place::Delay | Place::Play => 0.0,
            };
            any |= out[i] != 0.0;
        }
        any
    }
}

/// States between samples and the model's acceleration there.
fn middles(problem: &Problem, model: &JointModel) -> Vec<Middle> {
    let catalogue: &Catalogue = problem.catalogue;
    let added = model.scalar(catalogue, Place::Inertia).map_or(0.0, |(x, _)| x);
    let gain = model.scalar(catalogue, Place::Gain).map_or(1.0, |(x, _)| x);
    let one = |(index, trace): (usize, &super::smooth::Trace)| {
        let log = &problem.logs[index];
        let n = trace.position.len();
        let mut now = [0.0; 8];
        let mut m = Middle::default();
        for k in 0..n {
            let next = (k + 1).min(n - 1);
            for (x, other) in now.iter_mut().zip(&log.others) {
                *x = other[k];
            }
            let (q, v) = (0.5 * (trace.position[k] + trace.position[next]), 0.5 * (trace.velocity[k] + trace.velocity[next]));
            let u = gain * trace.effort[k];
            let at = At {
                q,
                v,
                u,
                t: run_time_s(index, log, k),
                direction: if v < 0.0 { -1.0 } else { 1.0 },
                others: &now,
                load: 0.0,
                carried: log.carried.get(k),
            };
            let sum = efforts_at(model, catalogue, &at);
            let free = u + sum.effort;
            let slow = 0.01 * problem.coverage.speed.1;
            let friction = if v.abs() > slow { sum.friction * v.signum() } else { free.clamp(-sum.friction, sum.friction) };
            m.position.push(q);
            m.velocity.push(v);
            m.effort.push(trace.effort[k]);
            m.acceleration.push((free - friction) / (problem.plant.inertia_at(log.carried.get(k)).0 + added));
        }
        m
    };
    problem.traces.iter().enumerate().map(one).collect()
}

/// Residual, two orthonormal start columns, and parameter columns without what the start columns span.
fn orthogonal(rows: &[Row], free: usize) -> Vec<Row> {
    let mut out: Vec<Row> = rows
        .iter()
        .map(|r| {
            let mut o = [0.0; MAX_COLUMNS];
            (o[0], o[1], o[2]) = (r[2 + free], r[0], r[1]);
            o[3..3 + free].copy_from_slice(&r[2..2 + free]);
            o
        })
        .collect();
    for basis in [1, 2] {
        let norm = out.iter().map(|r| r[basis] * r[basis]).sum::<f64>().sqrt();
        let scale = if norm > 1e-12 { 1.0 / norm } else { 0.0 };
        out.iter_mut().for_each(|r| r[basis] *= scale);
        let mut sums: Row = [0.0; MAX_COLUMNS];
        for r in &out {
            for c in 0..3 + free {
                sums[c] += r[c] * r[basis];
            }
        }
        for r in &mut out {
            let b = r[basis];
            for c in (0..3 + free).filter(|&c| c != basis && !(basis == 2 && c == 1)) {
                r[c] -= b * sums[c];
            }
        }
    }
    out
}
