//! Whitening of residuals. A Kalman filter for the linearized joint, driven by effort noise with a white and
//! a lasting part, turns positions into independent innovations of unit variance. The filter is linear, so
//! residuals and sensitivities pass through the same one. See docs/method.md (14.10).

use crate::{
    fit::{
        acting::{Acting, Row},
        noise::EffortNoise,
        rollout::inverse_inertia,
        smooth::Trace,
    },
    model::{
        effect::{At, Place, run_time_s},
        joint_model::{Catalogue, JointModel, Settling},
    },
    record::log::JointLog,
};

/// Share of the top speed below which a joint may stick: a smoothed velocity is never exactly zero.
/// chosen: only a small part of a motion is this slow.
const STILL: f64 = 0.003;
/// Largest relative growth of a state in one step by an effect driving the joint.
/// chosen: keeps variances bounded.
const GROWTH: f64 = 0.2;
/// Largest relative loss of velocity in one step by damping.
/// chosen: even a very stiff effect leaves some of it.
const DAMPED: f64 = 0.9;

/// The linearized joint between two samples: state transition (row-major) and response to an effort.
#[derive(Clone, Copy, Debug)]
pub struct Local {
    /// Transition of (position, velocity).
    pub a: [f64; 4],
    /// Response of (position, velocity) to a constant effort.
    pub g: [f64; 2],
    /// Time to the next sample, seconds.
    pub interval_s: f64,
}

impl Local {
    /// (Position, velocity, wander) at the next sample; `kept` is the share of the wander remaining there.
    #[inline]
    fn moved_by(&self, q: f64, v: f64, d: f64, kept: f64) -> [f64; 3] {
        let a = &self.a;
        let g = &self.g;
        [a[0] * q + a[1] * v + g[0] * d, a[2] * q + a[3] * v + g[1] * d, kept * d]
    }
}

/// Linearizes a model along the smoothed motion of a log.
pub fn linearized_joint(
    model: &JointModel,
    catalogue: &Catalogue,
    log: &JointLog,
    index: usize,
    trace: &Trace,
) -> Vec<Local> {
    let n = log.time_s.len();
    let added = model.scalar_of(catalogue, Place::Inertia).map_or(0.0, |(x, _)| x);
    let gain = model.scalar_of(catalogue, Place::Gain).map_or(1.0, |(x, _)| x);
    let others: Vec<&[f64]> = log.others.iter().map(Vec::as_slice).collect();
    let mut now = [0.0; 8];
    let still = STILL * trace.velocity.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let acting = Acting::of_model(model, catalogue);
    let mut locals = Vec::with_capacity(n);
    for k in 0..n {
        let dt = if k + 1 < n { log.time_s[k + 1] - log.time_s[k] } else { 0.0 };
        for (x, other) in now.iter_mut().zip(&others) {
            *x = other[k];
        }
        let q = trace.position[k];
        let v = trace.velocity[k];
        // A servo reads the recorded position.
        let acted = model.plant.actuator.effort_under(trace.signal[k], q, v, (1.0, 0.0));
        let u = gain * acted.effort;
        let carried = log.carried.get(k);
        let inverse = inverse_inertia(model.plant.inertia_at(carried).0, added);
        let at = At {
            q,
            v,
            u,
            feedback: [gain * acted.q, gain * acted.v],
            t: run_time_s(index, log, k),
            direction: if v < 0.0 { -1.0 } else { 1.0 },
            others: &now,
            load: 0.0,
            carried,
        };
        let sum = acting.efforts_at(&at);
        let settling = Settling::over_step(model.settle_s, dt);
        // Settling friction also brakes the velocity within its settle time.
        let held = if settling.keep > 0.0 {
            v / (model.settle_s * inverse) + u + sum.effort
        } else {
            u + sum.effort
        };
        let slow = settling.keep > 0.0 || v.abs() <= still;
        // A sticking joint loses its velocity; noise of the effort moves it only by the creep.
        if slow && held.abs() < sum.friction {
            let g = settling.creep * dt * inverse;
            locals.push(Local {
                a: [1.0, 0.5 * dt * settling.keep, 0.0, settling.keep],
                g: [0.5 * dt * g, g],
                interval_s: dt,
            });
            continue;
        }
        // The limits keep the transition of a very stiff or driving effect bounded, and so the variances.
        let spring = (-sum.q * inverse * dt * dt).clamp(-GROWTH, 1.0);
        let kept = 1.0 - (-sum.v * inverse * dt).clamp(-GROWTH, DAMPED);
        let mean = 0.5 * (1.0 + kept);
        let per = if dt > 0.0 { spring / dt } else { 0.0 };
        locals.push(Local {
            a: [1.0 - 0.5 * spring, dt * mean, -per * mean, kept - 0.5 * spring],
            g: [0.5 * dt * dt * inverse, dt * inverse * mean],
            interval_s: dt,
        });
    }
    locals
}

/// Gains of one update.
#[derive(Clone, Copy, Debug)]
pub struct Gain {
    /// Inverse standard deviation of the innovation.
    pub scale: f64,
    /// Gain of the position.
    pub kq: f64,
    /// Gain of the velocity.
    pub kv: f64,
    /// Gain of the wander.
    pub kd: f64,
    /// Share of the wander remaining at the next sample.
    pub kept: f64,
}

/// Covariance of (position, velocity, wander): the upper triangle.
#[derive(Clone, Copy, Default)]
struct StateCovariance {
    qq: f64,
    qv: f64,
    qd: f64,
    vv: f64,
    vd: f64,
    dd: f64,
}

impl StateCovariance {
    /// The covariance after a measurement with these gains.
    fn after_update(&self, gain: &Gain) -> Self {
        let Self { qq, qv, qd, vv, vd, dd } = *self;
        Self {
            qq: qq * (1.0 - gain.kq),
            qv: qv * (1.0 - gain.kq),
            qd: qd * (1.0 - gain.kq),
            vv: vv - gain.kv * qv,
            vd: vd - gain.kv * qd,
            dd: dd - gain.kd * qd,
        }
    }

    /// The covariance at the next sample; the wander acts as an effort.
    fn after_step(&self, local: &Local, noise: &EffortNoise, kept: f64) -> Self {
        let g = &local.g;
        let moved = |q: f64, v: f64, d: f64| local.moved_by(q, v, d, kept);
        // The transition applied to the columns of the covariance, then to its rows.
        let [qq, vq, dq] = moved(self.qq, self.qv, self.qd);
        let [qv, vv, dv] = moved(self.qv, self.vv, self.vd);
        let [qd, vd, dd] = moved(self.qd, self.vd, self.dd);
        let [qq, qv, qd] = moved(qq, qv, qd);
        let [_, vv, vd] = moved(vq, vv, vd);
        let [_, _, dd] = moved(dq, dv, dd);
        let white = noise.white * noise.white;
        let wander = noise.wander * noise.wander;
        Self {
            qq: qq + white * g[0] * g[0],
            qv: qv + white * g[0] * g[1],
            qd,
            vv: vv + white * g[1] * g[1],
            vd,
            dd: dd + wander * (1.0 - kept * kept),
        }
    }
}

/// Computes the gains through a window. Its start state has columns of its own and counts as known (14.10).
pub struct Gains<'a> {
    noise: &'a EffortNoise,
    /// Variance of the joint's deviation from its modelled position.
    deflection: f64,
    belief: StateCovariance,
    /// Sum of the log variances not in `product`.
    log_variance: f64,
    /// Product of the variances since the last logarithm, kept within the range of a double: logarithms are
    /// expensive.
    product: f64,
    interval_s: f64,
    kept: f64,
}

impl<'a> Gains<'a> {
    /// The gains at the start of a window.
    pub fn of_noise(noise: &'a EffortNoise) -> Self {
        Self {
            noise,
            deflection: noise.deflection * noise.deflection,
            belief: StateCovariance { dd: noise.wander * noise.wander, ..StateCovariance::default() },
            log_variance: 0.0,
            product: 1.0,
            interval_s: 0.0,
            kept: noise.wander_share_after(0.0),
        }
    }

    /// Gain of the next sample; `reading` is the variance of its reading.
    #[inline]
    pub fn next(&mut self, local: &Local, reading: f64) -> Gain {
        // Most intervals are equal, and exponentials are expensive.
        if local.interval_s != self.interval_s {
            (self.interval_s, self.kept) =
                (local.interval_s, self.noise.wander_share_after(local.interval_s));
        }
        let s = self.belief.qq + reading + self.deflection;
        self.product *= s;
        if !(1e-200..1e200).contains(&self.product) {
            self.log_variance += self.product.ln();
            self.product = 1.0;
        }
        let [kq, kv, kd] = [self.belief.qq, self.belief.qv, self.belief.qd].map(|x| x / s);
        let gain = Gain { scale: 1.0 / s.sqrt(), kq, kv, kd, kept: self.kept };
        self.belief = self.belief.after_update(&gain).after_step(local, self.noise, self.kept);
        gain
    }

    /// Sum of the log variances of the innovations so far.
    pub fn log_variance(&self) -> f64 {
        self.log_variance + self.product.ln()
    }
}

/// State of the filter within a window, for `W` columns.
pub struct Filter<const W: usize> {
    q: [f64; W],
    v: [f64; W],
    d: [f64; W],
}

impl<const W: usize> Default for Filter<W> {
    /// The filter at the start of a window.
    fn default() -> Self {
        Self { q: [0.0; W], v: [0.0; W], d: [0.0; W] }
    }
}

impl<const W: usize> Filter<W> {
    /// Whitens the first `W` columns of the next row.
    #[inline]
    pub fn pass_row(&mut self, row: &mut [f64], local: &Local, gain: &Gain) {
        let a = &local.a;
        let g = &local.g;
        for i in 0..W {
            let innovation = row[i] - self.q[i];
            let q = self.q[i] + gain.kq * innovation;
            let v = self.v[i] + gain.kv * innovation;
            let d = self.d[i] + gain.kd * innovation;
            row[i] = innovation * gain.scale;
            self.q[i] = a[0] * q + a[1] * v + g[0] * d;
            self.v[i] = a[2] * q + a[3] * v + g[1] * d;
            self.d[i] = gain.kept * d;
        }
    }
}

/// Whitens the first `W` columns of all rows.
pub fn whiten_rows<const W: usize>(rows: &mut [Row], locals: &[Local], gains: &[Gain]) {
    let mut filter = Filter::<W>::default();
    for ((row, local), gain) in rows.iter_mut().zip(locals).zip(gains) {
        filter.pass_row(row, local, gain);
    }
}

/// Whitened response of the position to efforts, one per sample, and to a direct change of the measurement.
pub fn effort_response(
    effort: &[f64],
    direct: Option<&[f64]>,
    locals: &[Local],
    gains: &[Gain],
    out: &mut [f64],
) {
    // Differences between the true and the predicted state; the true wander is zero.
    let mut q = 0.0;
    let mut v = 0.0;
    let mut d = 0.0;
    for (k, gain) in gains.iter().enumerate() {
        let innovation = q + direct.map_or(0.0, |d| d[k]);
        out[k] = innovation * gain.scale;
        let uq = q - gain.kq * innovation;
        let uv = v - gain.kv * innovation;
        let ud = d - gain.kd * innovation;
        let a = &locals[k].a;
        let g = &locals[k].g;
        let acting = effort[k] + ud;
        q = a[0] * uq + a[1] * uv + g[0] * acting;
        v = a[2] * uq + a[3] * uv + g[1] * acting;
        d = gain.kept * ud;
    }
}

#[cfg(test)]
#[path = "filter_tests.rs"]
mod filter_tests;

#[cfg(test)]
mod tests {
    use rand_core::SeedableRng;

    use super::*;
    use numeric::random::standard_normal;

    /// A free mass under an effort that lasts, read with noise: whitened residuals against the motion without
    /// that effort.
    fn whitened(noise: &EffortNoise) -> Vec<f64> {
        let h = 0.01;
        let count = 20_000;
        let truth = EffortNoise { white: 0.3, wander: 1.0, memory_s: 0.1, deflection: 0.0 };
        let a = [1.0, h, 0.0, 1.0];
        let g = [0.5 * h * h, h];
        let locals = vec![Local { a, g, interval_s: h }; count];
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(7);
        let mut q = 0.0;
        let mut v = 0.0;
        let mut d = standard_normal(&mut rng);
        let mut gains = Gains::of_noise(noise);
        let mut filter = Filter::<1>::default();
        let kept = truth.wander_share_after(h);
        let one = |k: usize| {
            let mut row = [q + 1e-4 * standard_normal(&mut rng)];
            filter.pass_row(&mut row, &locals[k], &gains.next(&locals[k], 1e-8));
            let effort = truth.wander * d + truth.white * standard_normal(&mut rng);
            (q, v) = (q + h * v + g[0] * effort, v + g[1] * effort);
            d = kept * d + (1.0 - kept * kept).sqrt() * standard_normal(&mut rng);
            row[0]
        };
        (0..count).map(one).collect()
    }

    #[test]
    fn residuals_of_an_effort_that_lasts_come_out_white() {
        let moments = |r: &[f64]| {
            let square = r.iter().map(|x| x * x).sum::<f64>() / r.len() as f64;
            (square, r.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / r.len() as f64 / square)
        };
        let (variance, next) =
            moments(&whitened(&EffortNoise { white: 0.3, wander: 1.0, memory_s: 0.1, deflection: 0.0 }));
        // Standard deviations of both over so many samples: 0.01 and 0.007.
        assert!((variance - 1.0).abs() < 0.04 && next.abs() < 0.03, "{variance} {next}");
        let (_, next) = moments(&whitened(&EffortNoise::white_noise(1.0)));
        assert!(next.abs() > 0.2, "{next}");
    }
}
