//! Score test: how much of a fitted model's residuals each candidate effect would explain, to first order,
//! for each of its shapes. See docs/method.md (14.14).

use nalgebra::{DMatrix, DVector};

use crate::{
    fit::{
        acting::{Acting, MAX_COLUMNS, Row},
        problem::{Problem, Weighing},
        rollout::Rollout,
        shooting::{Fit, MAX_FIT_FREE},
        whiten::{effort_response, whiten_rows},
        whitening::{Whitening, predict_window},
    },
    judge::{columns::Columns, locate::STILL, orthogonal::orthogonal_columns},
    model::{
        effect::{At, Effect, Extent, Place, Response, run_time_s},
        joint_model::{Catalogue, JointModel},
    },
    record::log::Span,
};

/// Least share of a column's information outside the span of the model's own parameters, and the relative
/// increase of the rest for a finite inverse.
/// chosen: above rounding, below any visible effect.
const SPANNED: [f64; 2] = [1e-6, 1e-7];
/// Most columns in one score test.
const MAX_TESTED: usize = 32;

/// A fitted model's whitened residuals and the columns of its own unknowns.
pub struct Screen<'p, 'c> {
    problem: &'p Problem<'c>,
    /// Whitening filter of the fitted model.
    pub whitening: Whitening,
    /// For each window and sample: residual, two start columns, parameter columns. The start columns are
    /// orthonormal, the others orthogonal to them.
    windows: Vec<Vec<Row>>,
    /// Number of parameter columns.
    parameters: usize,
    /// Inverse of the parameters' normal matrix.
    inverse: DMatrix<f64>,
    /// Products of the parameter columns with the residual; near zero at a minimum.
    gradient: DVector<f64>,
    /// States halfway between the samples of every log.
    middle: Vec<Middle>,
    /// Predicted positions of each window.
    predicted: Vec<Vec<f64>>,
    /// Ranges of position and time of each window.
    extents: Vec<Extent>,
}

/// States halfway between samples.
#[derive(Clone, Debug, Default)]
pub struct Middle {
    /// Position.
    pub position: Vec<f64>,
    /// Velocity, rad/s or m/s.
    pub velocity: Vec<f64>,
    /// Effort of the actuator.
    pub effort: Vec<f64>,
    /// Derivative of this effort with respect to the recorded signal.
    pub by_signal: Vec<f64>,
    /// Acceleration of the model.
    pub acceleration: Vec<f64>,
    /// Acceleration of the smoothed motion.
    pub measured: Vec<f64>,
    /// Signed share of the friction bound acting against the motion: 1 while moving up, about 0 at rest.
    pub grip: Vec<f64>,
    /// Positions of the other joints.
    pub others: Vec<[f64; 8]>,
}

/// Result of a score test for a set of columns.
#[derive(Clone, Debug)]
pub struct Score {
    /// Twice the gain of log likelihood, to first order.
    pub gain: f64,
    /// Estimated amplitude of each column.
    pub amplitude: Vec<f64>,
    /// Squared normal score of each column alone.
    pub single: Vec<f64>,
    /// Products of each window's columns with its residual, for tests by sign flips.
    pub products: Vec<Vec<f64>>,
    /// Inverse of the columns' normal matrix.
    pub inverse: DMatrix<f64>,
}

/// An effect with a shape, and its score.
#[derive(Clone, Debug)]
pub struct Hit {
    /// Index in the catalogue.
    pub effect: usize,
    /// Parameters for the start of a fit.
    pub p: Vec<f64>,
    /// Twice the gain of log likelihood, to first order.
    pub gain: f64,
}

impl<'p, 'c> Screen<'p, 'c> {
    /// Prepares score tests for a fit.
    #[must_use]
    pub fn new(problem: &'p Problem<'c>, fit: &Fit) -> Self {
        let whitening = Whitening::new(problem, &fit.model, &fit.noise);
        let drives = problem.model_drives(&fit.model);
        let free = fit.model.free_count().min(MAX_FIT_FREE);
        let mut windows = Vec::with_capacity(problem.windows.len());
        let mut predicted = Vec::with_capacity(problem.windows.len());
        let mut normal = DMatrix::zeros(free, free);
        let mut gradient = DVector::zeros(free);
        let mut rollout = Rollout::default();
        for (w, span) in problem.windows.iter().enumerate() {
            predict_window(problem, &fit.model, &drives, w, fit.starts[w], &mut rollout);
            whiten_rows::<MAX_COLUMNS>(
                &mut rollout.rows,
                &whitening.locals[span.log][span.start..],
                &whitening.gains[w],
            );
            predicted.push(rollout.position.clone());
            let rows = orthogonal_columns(&rollout.rows, free);
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
            // An undetermined parameter must not prevent the inversion.
            normal[(i, i)] = normal[(i, i)] * (1.0 + 1e-9) + 1e-12;
        }
        let inverse = normal.try_inverse().unwrap_or_else(|| DMatrix::zeros(free, free));
        let middle = middles_of_logs(problem, &fit.model);
        let extents = window_extents(problem, &middle);
        Self { problem, whitening, windows, parameters: free, inverse, gradient, middle, predicted, extents }
    }

    /// States halfway between the samples of every log.
    #[must_use]
    pub fn middle_states(&self) -> &[Middle] {
        &self.middle
    }

    /// Scores `count` columns. `fill(window, span, columns)` writes each column's effort for an amplitude of
    /// one at each sample of a window, and marks the nonzero columns as active.
    pub fn score_columns(&self, count: usize, fill: impl FnMut(usize, Span, &mut Columns)) -> Option<Score> {
        match (3 + self.parameters).next_multiple_of(4) {
            4 => self.score_width::<4>(count, fill),
            8 => self.score_width::<8>(count, fill),
            12 => self.score_width::<12>(count, fill),
            _ => self.score_width::<MAX_COLUMNS>(count, fill),
        }
    }

    fn score_width<const W: usize>(
        &self,
        count: usize,
        mut fill: impl FnMut(usize, Span, &mut Columns),
    ) -> Option<Score> {
        let count = count.min(MAX_TESTED);
        let p = self.parameters;
        let mut normal = DMatrix::zeros(count, count);
        let mut with_parameters = DMatrix::zeros(count, p);
        let mut products = Vec::with_capacity(self.windows.len());
        let mut columns = Columns::new(count);
        let mut seen: Vec<Vec<f64>> = vec![Vec::new(); count];
        for (w, span) in self.problem.windows.iter().enumerate() {
            let mut window = vec![0.0; count];
            let mut starts = [[0.0; 2]; MAX_TESTED];
            let locals = &self.whitening.locals[span.log][span.start..span.start + span.len];
            columns.clear(span.len);
            fill(w, *span, &mut columns);
            for c in (0..count).filter(|&c| columns.active[c]) {
                seen[c].resize(span.len, 0.0);
                let direct = columns.direct.get(c).map(Vec::as_slice);
                effort_response(&columns.effort[c], direct, locals, &self.whitening.gains[w], &mut seen[c]);
                let mut sums = [0.0; W];
                for (x, row) in seen[c].iter().zip(&self.windows[w]) {
                    for i in 0..W {
                        sums[i] += x * row[i];
                    }
                }
                // In the order of a row: residual, start columns, parameters.
                window[c] = sums[0];
                starts[c] = [sums[1], sums[2]];
                for i in 0..p {
                    with_parameters[(c, i)] += sums[3 + i];
                }
            }
            for i in (0..count).filter(|&i| columns.active[i]) {
                for j in (0..=i).filter(|&j| columns.active[j]) {
                    let dot: f64 = seen[i].iter().zip(&seen[j]).map(|(a, b)| a * b).sum();
                    // The start columns are orthonormal: two products remove their part from the product of
                    // two columns.
                    let dot = dot - starts[i][0] * starts[j][0] - starts[i][1] * starts[j][1];
                    normal[(i, j)] += dot;
                    if i != j {
                        normal[(j, i)] += dot;
                    }
                }
            }
            products.push(window);
        }
        self.finished_score(normal, &with_parameters, products)
    }

    fn finished_score(
        &self,
        mut normal: DMatrix<f64>,
        with_parameters: &DMatrix<f64>,
        products: Vec<Vec<f64>>,
    ) -> Option<Score> {
        let count = normal.nrows();
        let raw: Vec<f64> = (0..count).map(|i| normal[(i, i)]).collect();
        // (14.14): remove the part explained by the model's own parameters.
        normal -= with_parameters * &self.inverse * with_parameters.transpose();
        let taken = with_parameters * &self.inverse * &self.gradient;
        let gradient = DVector::from_fn(count, |i, _| products.iter().map(|w| w[i]).sum::<f64>() - taken[i]);
        let mut single = vec![0.0; count];
        for i in 0..count {
            if normal[(i, i)] > SPANNED[0] * raw[i] && raw[i] > 0.0 {
                single[i] = gradient[i] * gradient[i] / normal[(i, i)];
                normal[(i, i)] *= 1.0 + SPANNED[1];
            } else {
                normal.row_mut(i).fill(0.0);
                normal.column_mut(i).fill(0.0);
                normal[(i, i)] = f64::INFINITY;
            }
        }
        for i in 0..count {
            // A huge diagonal sets this amplitude to zero and keeps the inverse finite.
            if normal[(i, i)].is_infinite() {
                normal[(i, i)] = 1e300;
            }
        }
        let inverse = normal.try_inverse()?;
        let amplitude = &inverse * &gradient;
        let gain = gradient.dot(&amplitude);
        gain.is_finite().then(|| Score {
            gain,
            amplitude: amplitude.iter().copied().collect(),
            single,
            products,
            inverse,
        })
    }

    /// The best shapes of an effect, best first, at most `keep`.
    #[must_use]
    pub fn best_hits(&self, index: usize, keep: usize) -> Vec<Hit> {
        let effect = self.problem.catalogue[index].as_ref();
        let states = self.all_states();
        let shapes = effect.start_shapes(&self.problem.coverage);
        let mut hits: Vec<Hit> = shapes
            .into_iter()
            .filter_map(|shape| self.hit_at_shape(index, effect, &shape, &states))
            .collect();
        hits.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        hits.truncate(keep);
        hits
    }

    /// The intermediate states of every log, as needed by effects.
    #[must_use]
    pub fn all_states(&self) -> Vec<Vec<At<'_>>> {
        (0..self.problem.logs.len()).map(|log| self.states_of_log(log)).collect()
    }

    /// The intermediate states of one log.
    fn states_of_log(&self, index: usize) -> Vec<At<'_>> {
        let log = &self.problem.logs[index];
        let m = &self.middle[index];
        let mut states = Vec::with_capacity(m.position.len());
        for k in 0..m.position.len() {
            states.push(At {
                q: m.position[k],
                v: m.velocity[k],
                u: m.effort[k],
                feedback: [0.0; 2],
                t: run_time_s(index, log, k),
                direction: if m.velocity[k] < 0.0 { -1.0 } else { 1.0 },
                others: &m.others[k],
                load: 0.0,
                carried: log.carried.get(k),
            });
        }
        states
    }

    fn hit_at_shape(
        &self,
        index: usize,
        effect: &dyn Effect,
        shape: &[f64],
        states: &[Vec<At>],
    ) -> Option<Hit> {
        let score = self.score_columns(amplitude_count(effect), self.column_filler(effect, shape, states))?;
        let mut p = shape.to_vec();
        // Delay and play are tested at their full size, so the shape is already the start.
        if !matches!(effect.place(), Place::Delay | Place::Play) {
            for (i, a) in score.amplitude.iter().enumerate() {
                let (low, high) = effect.parameter_bounds(i, &self.problem.coverage);
                p[i] = (shape[i] + a).clamp(low, high);
            }
        }
        Some(Hit { effect: index, p, gain: score.gain })
    }

    /// Returns a function filling the columns of an effect's amplitudes; `states` holds the states of every
    /// log.
    pub fn column_filler<'s>(
        &'s self,
        effect: &'s dyn Effect,
        shape: &'s [f64],
        states: &'s [Vec<At>],
    ) -> Box<dyn FnMut(usize, Span, &mut Columns) + 's> {
        let problem = self.problem;
        let place = effect.place();
        match place {
            Place::Effort | Place::Contact | Place::Friction => Box::new(move |window, span, columns| {
                let states = &states[span.log][span.start..span.start + span.len - 1];
                if effect.reaches_extent(shape, &self.extents[window]) {
                    self.fill_responses(effect, shape, span, states, columns);
                }
            }),
            Place::Delay => {
                // The effort is not linear in the delay, so each delay of the grid is tested separately.
                let late = problem.drives_late(shape[0]);
                Box::new(move |_, span, columns| {
                    let d = &late[span.log];
                    columns.active[0] = true;
                    for i in 0..span.len - 1 {
                        let k = span.start + i;
                        let later = d.mean_after(k) - problem.traces[span.log].signal[k];
                        columns.effort[0][i] = self.middle[span.log].by_signal[k] * later;
                    }
                })
            }
            // Uses the predicted motion: the measured position has already passed through the play.
            Place::Play => Box::new(move |window, span, columns| {
                let half_gap = shape[0];
                let predicted = &self.predicted[window];
                let mut gauge = predicted[0] - problem.traces[span.log].direction[span.start] * half_gap;
                let mut play = Vec::with_capacity(predicted.len());
                for q in predicted {
                    gauge = gauge.clamp(q - half_gap, q + half_gap);
                    play.push(gauge - q);
                }
                columns.active[0] = true;
                columns.direct = vec![play];
            }),
            Place::Inertia | Place::Gain | Place::Bias | Place::Scale => Box::new(move |_, span, columns| {
                columns.active[0] = true;
                for i in 0..span.len - 1 {
                    columns.effort[0][i] = self.scalar_effort(place, span.log, span.start + i);
                }
            }),
        }
    }

    /// Writes the efforts of all amplitudes of an effect over a window.
    fn fill_responses(
        &self,
        effect: &dyn Effect,
        shape: &[f64],
        span: Span,
        states: &[At],
        columns: &mut Columns,
    ) {
        let is_friction = effect.place() == Place::Friction;
        let grip = &self.middle[span.log].grip[span.start..];
        for (i, at) in states.iter().enumerate() {
            let mut r = Response::default();
            effect.write_response(at, shape, &mut r);
            // Near rest friction balances the acting effort, so a larger bound changes little.
            let factor = if is_friction { -grip[i] } else { 1.0 };
            for ((effort, active), by) in columns.effort.iter_mut().zip(&mut columns.active).zip(&r.p) {
                effort[i] = factor * by;
                *active |= effort[i] != 0.0;
            }
        }
    }

    /// The effort at a sample equivalent to amplitude one of an effect not itself an effort.
    fn scalar_effort(&self, place: Place, log: usize, k: usize) -> f64 {
        let m = &self.middle[log];
        let load = || self.problem.plant.load_at(self.problem.logs[log].carried.get(k), m.position[k]);
        // First-order changes of (14.3) for a recorded position y = s q + o.
        match place {
            // The measured acceleration, for a model far from the machine.
            Place::Inertia if self.problem.weighing != Weighing::Innovations => -m.measured[k],
            Place::Inertia => -m.acceleration[k],
            Place::Gain => m.effort[k],
            Place::Bias => load().1,
            Place::Scale => {
                let (load, slope) = load();
                m.effort[k] - load + slope * m.position[k]
            }
            _ => 0.0,
        }
    }
}

/// Number of an effect's amplitudes; they are its first parameters.
#[must_use]
pub fn amplitude_count(effect: &dyn Effect) -> usize {
    effect.parameters().iter().filter(|p| p.neutral.is_some()).count()
}

/// Ranges of position and time of all windows.
fn window_extents(problem: &Problem, middle: &[Middle]) -> Vec<Extent> {
    let mut extents = Vec::with_capacity(problem.windows.len());
    for span in &problem.windows {
        let log = &problem.logs[span.log];
        let position = &middle[span.log].position[span.start..span.start + span.len];
        let low = position.iter().copied().fold(f64::INFINITY, f64::min);
        let high = position.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let first_s = run_time_s(span.log, log, span.start);
        let last_s = run_time_s(span.log, log, span.start + span.len - 1);
        extents.push(Extent { position: (low, high), time_s: (first_s, last_s) });
    }
    extents
}

/// States halfway between samples, with the model's acceleration there.
fn middles_of_logs(problem: &Problem, model: &JointModel) -> Vec<Middle> {
    let catalogue: &Catalogue = problem.catalogue;
    let added = model.scalar_of(catalogue, Place::Inertia).map_or(0.0, |(x, _)| x);
    let gain = model.scalar_of(catalogue, Place::Gain).map_or(1.0, |(x, _)| x);
    let acting = Acting::of_model(model, catalogue);
    let mut middles = Vec::with_capacity(problem.traces.len());
    for (index, trace) in problem.traces.iter().enumerate() {
        let log = &problem.logs[index];
        let n = trace.position.len();
        let mut now = [0.0; 8];
        let mut m = Middle::default();
        for k in 0..n {
            let next = (k + 1).min(n - 1);
            for (x, other) in now.iter_mut().zip(&log.others) {
                *x = other[k];
            }
            let q = 0.5 * (trace.position[k] + trace.position[next]);
            let v = 0.5 * (trace.velocity[k] + trace.velocity[next]);
            // A servo reads the recorded position.
            let acted = model.plant.actuator.effort_under(trace.signal[k], q, v, (1.0, 0.0));
            let u = gain * acted.effort;
            let at = At {
                q,
                v,
                u,
                feedback: [gain * acted.q, gain * acted.v],
                t: run_time_s(index, log, k),
                direction: if v < 0.0 { -1.0 } else { 1.0 },
                others: &now,
                load: 0.0,
                carried: log.carried.get(k),
            };
            let sum = acting.efforts_at(&at);
            let free = u + sum.effort;
            let slow = STILL * problem.coverage.speed.1;
            // At rest friction balances the acting effort, up to its bound.
            let friction = if v.abs() > slow {
                sum.friction * v.signum()
            } else {
                free.clamp(-sum.friction, sum.friction)
            };
            m.position.push(q);
            m.velocity.push(v);
            m.grip.push(v / (v * v + slow * slow).sqrt());
            m.others.push(now);
            m.effort.push(acted.effort);
            m.by_signal.push(acted.signal);
            m.acceleration.push((free - friction) / (problem.plant.inertia_at(log.carried.get(k)).0 + added));
            m.measured.push(
                (trace.velocity[next] - trace.velocity[k]) / (log.time_s[next] - log.time_s[k]).max(1e-12),
            );
        }
        middles.push(m);
    }
    middles
}
