//! White residuals: a Kalman filter for the linearized joint, driven by white effort noise, turns positions
//! into independent innovations of variance one. It is linear, so residuals and sensitivities pass through
//! the same filter. See docs/method.md (14.10).

use crate::gap::{
    fit::{
        acting::{Acting, Row},
        rollout::inverse_inertia,
        smooth::Trace,
    },
    model::{
        effect::{At, Place, run_time_s},
        joint_model::{Catalogue, JointModel, Settling},
    },
    record::log::{JointLog, Span},
};

/// Linearized joint between two samples: state transition (row-major) and effect of an effort.
#[derive(Clone, Copy, Debug)]
pub struct Local {
    /// Transition of (position, velocity).
    pub a: [f64; 4],
    /// Effect of a held effort.
    pub g: [f64; 2],
}

/// Linearizes a model along the smoothed motion of a log.
#[must_use]
pub fn linearize(
    model: &JointModel,
    catalogue: &Catalogue,
    log: &JointLog,
    index: usize,
    trace: &Trace,
) -> Vec<Local> {
    let n = log.time_s.len();
    let added = model.scalar(catalogue, Place::Inertia).map_or(0.0, |(x, _)| x);
    let gain = model.scalar(catalogue, Place::Gain).map_or(1.0, |(x, _)| x);
    let others: Vec<&[f64]> = log.others.iter().map(Vec::as_slice).collect();
    let mut now = [0.0; 8];
    // A smoothed velocity is never exactly zero: below this share of the top speed a joint may stick.
    let still = 0.003 * trace.velocity.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let acting = Acting::of(model, catalogue);
    let mut locals = Vec::with_capacity(n);
    for k in 0..n {
        let dt = if k + 1 < n { log.time_s[k + 1] - log.time_s[k] } else { 0.0 };
        for (x, other) in now.iter_mut().zip(&others) {
            *x = other[k];
        }
        let (q, v, u) = (trace.position[k], trace.velocity[k], gain * trace.effort[k]);
        let carried = log.carried.get(k);
        let inverse = inverse_inertia(model.plant.inertia_at(carried).0, added);
        let at = At {
            q,
            v,
            u,
            t: run_time_s(index, log, k),
            direction: if v < 0.0 { -1.0 } else { 1.0 },
            others: &now,
            load: 0.0,
            carried,
        };
        let sum = acting.at(&at);
        let settling = Settling::over(model.settle_s, dt);
        // Friction that settles must also brake the velocity within its settle time.
        let held = if settling.keep > 0.0 {
            v / (model.settle_s * inverse) + u + sum.effort
        } else {
            u + sum.effort
        };
        let slow = settling.keep > 0.0 || v.abs() <= still;
        // A joint that sticks forgets its velocity; noise of the effort moves it by the creep alone.
        if slow && held.abs() < sum.friction {
            let g = settling.creep * dt * inverse;
            locals
                .push(Local { a: [1.0, 0.5 * dt * settling.keep, 0.0, settling.keep], g: [0.5 * dt * g, g] });
            continue;
        }
        // The clamps keep the transition of a stiff or driving effect, and with it the variances, from
        // growing without bound.
        let spring = (-sum.q * inverse * dt * dt).clamp(-0.2, 1.0);
        let kept = 1.0 - (-sum.v * inverse * dt).clamp(-0.2, 0.9);
        let mean = 0.5 * (1.0 + kept);
        let per = if dt > 0.0 { spring / dt } else { 0.0 };
        locals.push(Local {
            a: [1.0 - 0.5 * spring, dt * mean, -per * mean, kept - 0.5 * spring],
            g: [0.5 * dt * dt * inverse, dt * inverse * mean],
        });
    }
    locals
}

/// Gain of one update.
#[derive(Clone, Copy, Debug)]
pub struct Gain {
    /// One over the standard deviation of the innovation.
    pub scale: f64,
    /// Gain of the position.
    pub kq: f64,
    /// Gain of the velocity.
    pub kv: f64,
}

/// Gains of a window whose start state is known (it is a column of its own), and the sum of the log
/// variances.
pub fn gains(locals: &[Local], span: Span, sigma_y: f64, sigma_u: f64, out: &mut Vec<Gain>) -> f64 {
    out.clear();
    let (r, w) = (sigma_y * sigma_y, sigma_u * sigma_u);
    let (mut qq, mut qv, mut vv) = (0.0, 0.0, 0.0);
    // Logarithms of products: variances of positions are far from the bounds of a double.
    let (mut log_variance, mut product) = (0.0, 1.0f64);
    for local in &locals[span.start..span.start + span.len] {
        // (14.10)
        let s = qq + r;
        product *= s;
        if !(1e-200..1e200).contains(&product) {
            log_variance += product.ln();
            product = 1.0;
        }
        let (kq, kv) = (qq / s, qv / s);
        out.push(Gain { scale: 1.0 / s.sqrt(), kq, kv });
        let (uqq, uqv, uvv) = (qq * (1.0 - kq), qv * (1.0 - kq), vv - kv * qv);
        let (a, g) = (&local.a, &local.g);
        let (m00, m01) = (a[0] * uqq + a[1] * uqv, a[0] * uqv + a[1] * uvv);
        let (m10, m11) = (a[2] * uqq + a[3] * uqv, a[2] * uqv + a[3] * uvv);
        qq = m00 * a[0] + m01 * a[1] + w * g[0] * g[0];
        qv = m00 * a[2] + m01 * a[3] + w * g[0] * g[1];
        vv = m10 * a[2] + m11 * a[3] + w * g[1] * g[1];
    }
    log_variance + product.ln()
}

/// The filter on its way through a window, for `W` columns.
pub struct Filter<const W: usize> {
    q: [f64; W],
    v: [f64; W],
}

impl<const W: usize> Default for Filter<W> {
    /// At the start of a window.
    fn default() -> Self {
        Self { q: [0.0; W], v: [0.0; W] }
    }
}

impl<const W: usize> Filter<W> {
    /// Whitens the first `W` columns of the next row.
    #[inline]
    pub fn pass(&mut self, row: &mut [f64], local: &Local, gain: &Gain) {
        let a = &local.a;
        for ((x, q), v) in row[..W].iter_mut().zip(&mut self.q).zip(&mut self.v) {
            let innovation = *x - *q;
            let (uq, uv) = (*q + gain.kq * innovation, *v + gain.kv * innovation);
            *x = innovation * gain.scale;
            *q = a[0] * uq + a[1] * uv;
            *v = a[2] * uq + a[3] * uv;
        }
    }
}

/// Passes the first `W` columns of rows through the filter.
pub fn whiten<const W: usize>(rows: &mut [Row], locals: &[Local], gains: &[Gain]) {
    let mut filter = Filter::<W>::default();
    for ((row, local), gain) in rows.iter_mut().zip(locals).zip(gains) {
        filter.pass(row, local, gain);
    }
}

/// Whitened response of the position to efforts (one a sample) and to a direct change of the measurement.
pub fn respond(effort: &[f64], direct: Option<&[f64]>, locals: &[Local], gains: &[Gain], out: &mut [f64]) {
    let (mut q, mut v) = (0.0, 0.0);
    for k in 0..gains.len() {
        // Difference between the true and the predicted state.
        let innovation = q + direct.map_or(0.0, |d| d[k]);
        out[k] = innovation * gains[k].scale;
        let (uq, uv) = (q - gains[k].kq * innovation, v - gains[k].kv * innovation);
        let (a, g) = (&locals[k].a, &locals[k].g);
        q = a[0] * uq + a[1] * uv + g[0] * effort[k];
        v = a[2] * uq + a[3] * uv + g[1] * effort[k];
    }
}
