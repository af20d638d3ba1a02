//! Most probable position and velocity over a log: a Kalman smoother on the twin with white effort noise.

use crate::{
    model::plant::Plant,
    record::{
        carried::Carried,
        drive::{Drive, Hold},
        log::{JointLog, Span},
    },
};

/// Smallest tried effort noise, as a share of the effort, and ratio of neighboring values.
/// chosen: up to six times the effort (docs/method.md 14.3).
const LEAST_NOISE: f64 = 0.003;
const NOISE_RATIO: f64 = 2.6;
/// Share of the top speed from which the sign of a smoothed velocity is reliable.
/// chosen: near rest it is noise.
const CLEAR_SPEED: f64 = 0.02;

/// Smoothed motion of a log, sample by sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    /// Position, rad or m.
    pub position: Vec<f64>,
    /// Velocity, rad/s or m/s.
    pub velocity: Vec<f64>,
    /// Mean effort until the next sample, N m or N; for a servo, its effort computed from the readings.
    pub effort: Vec<f64>,
    /// Mean signal until the next sample: the effort, or a servo's commanded position.
    pub signal: Vec<f64>,
    /// Acceleration of the twin at this state under this effort; no second differences of measurements enter.
    pub acceleration: Vec<f64>,
    /// Sign of the last reliable velocity; 0 before the first.
    pub direction: Vec<f64>,
}

impl Trace {
    /// Range of its positions, rad or m.
    pub(super) fn position_range(&self) -> f64 {
        let ends = [f64::INFINITY, f64::NEG_INFINITY];
        let [low, high] = self.position.iter().fold(ends, |[low, high], p| [low.min(*p), high.max(*p)]);
        high - low
    }
}

#[derive(Clone, Copy, Default)]
struct FilterEstimate {
    q: f64,
    v: f64,
    qq: f64,
    qv: f64,
    vv: f64,
}

/// Prediction by the twin over one interval.
struct Predict<'a> {
    plant: &'a Plant,
    noise: f64,
}

impl Predict<'_> {
    /// Transition matrix, and response to an effort, over `dt` seconds at a position.
    fn transition_and_input(&self, carried: Option<&Carried>, q: f64, dt: f64) -> ([f64; 4], [f64; 2]) {
        let (inertia, rate) = self.plant.inertia_at(carried);
        let i = 1.0 / inertia;
        let k = self.plant.load_at(carried, q).1 * i;
        let b = (self.plant.damping + rate) * i;
        // Exact in the damping, which may be strong over an interval; first order in the load's slope.
        let lost = 1.0 - (-b * dt).exp();
        ([1.0 - 0.5 * k * dt * dt, dt * (1.0 - 0.5 * lost), -k * dt, 1.0 - lost], [0.5 * dt * dt * i, dt * i])
    }

    fn predicted_after(
        &self,
        carried: Option<&Carried>,
        s: &FilterEstimate,
        effort: f64,
        dt: f64,
    ) -> (FilterEstimate, [f64; 4]) {
        let (a, g) = self.transition_and_input(carried, s.q, dt);
        let (load, slope) = self.plant.load_at(carried, s.q);
        // The transition holds the load's linear part about this position; `push` holds the rest.
        let push = effort - load + slope * s.q;
        let w = self.noise * self.noise;
        let m00 = a[0] * s.qq + a[1] * s.qv;
        let m01 = a[0] * s.qv + a[1] * s.vv;
        let m10 = a[2] * s.qq + a[3] * s.qv;
        let m11 = a[2] * s.qv + a[3] * s.vv;
        let next = FilterEstimate {
            q: a[0] * s.q + a[1] * s.v + g[0] * push,
            v: a[2] * s.q + a[3] * s.v + g[1] * push,
            qq: m00 * a[0] + m01 * a[1] + w * g[0] * g[0],
            qv: m00 * a[2] + m01 * a[3] + w * g[0] * g[1],
            vv: m10 * a[2] + m11 * a[3] + w * g[1] * g[1],
        };
        (next, a)
    }
}

/// Smooths logs with the most probable effort noise of the grid; `readings` is the variance of each position.
pub fn smoothed_traces(logs: &[JointLog], hold: Hold, plant: &Plant, readings: &[Vec<f64>]) -> Vec<Trace> {
    let effort: Vec<Vec<f64>> = logs.iter().map(|l| interval_means(l, &l.effort, hold)).collect();
    let count: usize = effort.iter().map(Vec::len).sum();
    let rms = (effort.iter().flatten().map(|u| u * u).sum::<f64>() / count.max(1) as f64).sqrt();
    // A released joint has no effort; then the load sets the scale.
    let scale = rms.max(plant.load.amplitude()).max(1e-9);
    let mut trials: Vec<(f64, f64)> = Vec::new();
    for i in 0..9 {
        let noise = scale * LEAST_NOISE * NOISE_RATIO.powi(i);
        let predict = Predict { plant, noise };
        let each = logs.iter().enumerate();
        let likelihood =
            each.map(|(i, log)| filter_forward(log, i, &effort[i], &predict, &readings[i]).1).sum();
        trials.push((likelihood, noise));
    }
    let best = trials.into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
    let noise = best.map_or(scale, |(_, n)| n);
    let predict = Predict { plant, noise };
    let mut traces = Vec::with_capacity(logs.len());
    for (i, log) in logs.iter().enumerate() {
        let mut trace = smooth_backward(log, i, &effort[i], &predict, &readings[i]);
        if !log.commanded.is_empty() {
            trace.signal = interval_means(log, &log.commanded, hold);
        }
        traces.push(trace);
    }
    traces
}

/// Mean of a signal from each sample of a log to the next.
fn interval_means(log: &JointLog, values: &[f64], hold: Hold) -> Vec<f64> {
    Drive::of_signal(&log.time_s, values, hold, 0.0, Drive::usual_steps(log))
        .means_by_sample(values.last().copied())
}

type Passed = (FilterEstimate, FilterEstimate, [f64; 4]);

/// Forward filter; returns (predicted, updated, transition to this sample) for each sample, and the log
/// likelihood.
fn filter_forward(
    log: &JointLog,
    index: usize,
    effort: &[f64],
    predict: &Predict,
    readings: &[f64],
) -> (Vec<(Span, Vec<Passed>)>, f64) {
    let mut all = Vec::new();
    let mut likelihood = 0.0;
    for span in log.gapless_segments(index) {
        let first = log.position[span.start];
        // Nothing is known of the motion within a gap, so each segment starts anew.
        let mut belief =
            FilterEstimate { q: first, v: 0.0, qq: readings[span.start] * 1e4, qv: 0.0, vv: 1e4 };
        let mut transition = [1.0, 0.0, 0.0, 1.0];
        let mut passed = Vec::with_capacity(span.len);
        for k in span.start..span.start + span.len {
            if k > span.start {
                (belief, transition) = predict.predicted_after(
                    log.carried.get(k - 1),
                    &belief,
                    effort[k - 1],
                    log.time_s[k] - log.time_s[k - 1],
                );
            }
            let predicted = belief;
            let s = predicted.qq + readings[k];
            let innovation = log.position[k] - predicted.q;
            // The first innovations only reflect the wide prior.
            if k > span.start + 2 {
                likelihood -= 0.5 * (innovation * innovation / s + s.ln());
            }
            let kq = predicted.qq / s;
            let kv = predicted.qv / s;
            belief = FilterEstimate {
                q: predicted.q + kq * innovation,
                v: predicted.v + kv * innovation,
                qq: predicted.qq * (1.0 - kq),
                qv: predicted.qv * (1.0 - kq),
                vv: predicted.vv - kv * predicted.qv,
            };
            passed.push((predicted, belief, transition));
        }
        all.push((span, passed));
    }
    (all, likelihood)
}

fn smooth_backward(
    log: &JointLog,
    index: usize,
    effort: &[f64],
    predict: &Predict,
    readings: &[f64],
) -> Trace {
    let n = log.time_s.len();
    let mut trace = Trace {
        position: log.position.clone(),
        velocity: vec![0.0; n],
        effort: effort.to_vec(),
        signal: effort.to_vec(),
        acceleration: vec![0.0; n],
        direction: vec![0.0; n],
    };
    for (span, passed) in filter_forward(log, index, effort, predict, readings).0 {
        let mut later: Option<(f64, f64)> = None;
        for k in (0..span.len).rev() {
            let (_, updated, _) = passed[k];
            let mut state = (updated.q, updated.v);
            if let (Some((q, v)), Some((next, _, a))) = (later, passed.get(k + 1)) {
                // Smoother gain P A' (predicted P)^-1.
                let c = [
                    updated.qq * a[0] + updated.qv * a[1],
                    updated.qq * a[2] + updated.qv * a[3],
                    updated.qv * a[0] + updated.vv * a[1],
                    updated.qv * a[2] + updated.vv * a[3],
                ];
                let det = next.qq * next.vv - next.qv * next.qv;
                // If rounding makes the predicted covariance singular, the filtered state is kept.
                if det > 0.0 {
                    let x = q - next.q;
                    let y = v - next.v;
                    let ix = (next.vv * x - next.qv * y) / det;
                    let iy = (next.qq * y - next.qv * x) / det;
                    state = (updated.q + c[0] * ix + c[1] * iy, updated.v + c[2] * ix + c[3] * iy);
                }
            }
            later = Some(state);
            (trace.position[span.start + k], trace.velocity[span.start + k]) = state;
        }
    }
    let plant = predict.plant;
    let top = trace.velocity.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let mut last = 0.0;
    for k in 0..n {
        let q = trace.position[k];
        let v = trace.velocity[k];
        let carried = log.carried.get(k);
        trace.acceleration[k] = plant.net_effort(carried, q, v, effort[k]) / plant.inertia_at(carried).0;
        // Near rest the last reliable sign is kept.
        if v.abs() > CLEAR_SPEED * top {
            last = v.signum();
        }
        trace.direction[k] = last;
    }
    trace
}
