//! The recorded signal, an effort or a commanded position, over the short steps of a rollout.

use serde::Serialize;

use crate::record::log::JointLog;

/// How a signal is interpolated between samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Hold {
    /// Constant until the next sample.
    #[default]
    Zero,
    /// Sampled from a smooth signal.
    Sampled,
}

/// What a signal is between two of its samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// The value before.
    Held,
    /// The line between both.
    Linear,
    /// The cubic between both with the slopes of parabolas through three samples.
    Cubic,
}

impl From<Hold> for Interpolation {
    fn from(hold: Hold) -> Self {
        match hold {
            Hold::Zero => Self::Held,
            Hold::Sampled => Self::Cubic,
        }
    }
}

/// Most steps of a rollout between two samples.
/// chosen: enough for logs at 3 Hz; slower ones show no dynamics.
const MOST_STEPS: f64 = 64.0;
/// Longest step of a rollout, seconds.
/// chosen: one step per interval at 200 Hz, the rate of most logs, with 4 % tolerance for the stamps.
pub const MAX_STEP_S: f64 = 5.2e-3;

/// Mean signal of every step, and its derivative with respect to the delay.
#[derive(Clone, Debug, Default)]
pub struct Drive {
    /// Number of steps between two samples.
    pub steps: usize,
    /// Mean signal of each step, `steps` per interval.
    pub signal: Vec<f64>,
    /// Derivative of this signal with respect to the delay, per second.
    pub by_delay: Vec<f64>,
}

/// Evaluates a signal and its integral from the start of the log.
pub struct Signal<'a> {
    time_s: &'a [f64],
    values: &'a [f64],
    between: Interpolation,
    at: usize,
    /// Integral up to sample `at`.
    sum: f64,
}

impl<'a> Signal<'a> {
    /// A signal of values at increasing stamps, at least one.
    #[must_use]
    pub fn new(time_s: &'a [f64], values: &'a [f64], between: Interpolation) -> Self {
        Self { time_s, values, between, at: 0, sum: 0.0 }
    }

    /// Value and integral at time `t`; successive calls must not go back in time.
    pub fn value_and_integral(&mut self, t: f64) -> (f64, f64) {
        let time = self.time_s;
        let effort = self.values;
        while self.at + 1 < time.len() && time[self.at + 1] <= t {
            let width = time[self.at + 1] - time[self.at];
            self.sum += match self.between {
                Interpolation::Held => width * effort[self.at],
                Interpolation::Linear => 0.5 * width * (effort[self.at] + effort[self.at + 1]),
                Interpolation::Cubic => self.cubic_to_next(self.at, 1.0).1,
            };
            self.at += 1;
        }
        let k = self.at;
        let x = t - time[k];
        if x <= 0.0 || k + 1 == time.len() {
            // Before the first sample the signal has the value of the first one.
            return (effort[k], self.sum + x * effort[k]);
        }
        match self.between {
            Interpolation::Held => (effort[k], self.sum + x * effort[k]),
            Interpolation::Linear => {
                let slope = (effort[k + 1] - effort[k]) / (time[k + 1] - time[k]);
                (effort[k] + slope * x, self.sum + x * (effort[k] + 0.5 * slope * x))
            }
            Interpolation::Cubic => {
                let (value, integral) = self.cubic_to_next(k, x / (time[k + 1] - time[k]));
                (value, self.sum + integral)
            }
        }
    }

    /// Value, and integral from sample `k`, at a share `u` of the interval after it (cubic Hermite
    /// interpolation).
    fn cubic_to_next(&self, k: usize, u: f64) -> (f64, f64) {
        let width = self.time_s[k + 1] - self.time_s[k];
        let rise = self.values[k + 1] - self.values[k];
        let begin = width * self.slope_at(k);
        let end = width * self.slope_at(k + 1);
        // derived: the cubic a + b u + c u^2 + d u^3 with these values and slopes at both ends
        let c = 3.0 * rise - 2.0 * begin - end;
        let d = begin + end - 2.0 * rise;
        let value = self.values[k] + u * (begin + u * (c + u * d));
        let integral = u * (self.values[k] + u * (begin / 2.0 + u * (c / 3.0 + u * d / 4.0)));
        (value, width * integral)
    }

    /// Slope at a sample of the parabola through it and its neighbors, per second; at the ends, that of the
    /// line to the only neighbor.
    fn slope_at(&self, k: usize) -> f64 {
        let slope_after =
            |k: usize| (self.values[k + 1] - self.values[k]) / (self.time_s[k + 1] - self.time_s[k]);
        if k == 0 {
            return slope_after(0);
        }
        if k + 1 == self.values.len() {
            return slope_after(k - 1);
        }
        let before = self.time_s[k] - self.time_s[k - 1];
        let after = self.time_s[k + 1] - self.time_s[k];
        (slope_after(k - 1) * after + slope_after(k) * before) / (before + after)
    }
}

impl Drive {
    /// Usual number of steps between two samples of a log.
    #[must_use]
    pub fn usual_steps(log: &JointLog) -> usize {
        log.interval_s().map_or(1, |dt| (dt / MAX_STEP_S).ceil().clamp(1.0, MOST_STEPS) as usize)
    }

    /// The signal of a log acting `delay_s` seconds late, with `steps` steps between two samples.
    #[must_use]
    pub fn with_steps(log: &JointLog, hold: Hold, delay_s: f64, steps: usize) -> Self {
        Self::of_signal(&log.time_s, log.driving_signal(), hold, delay_s, steps)
    }

    /// The same for any signal with its stamps.
    #[must_use]
    pub fn of_signal(time_s: &[f64], values: &[f64], hold: Hold, delay_s: f64, steps: usize) -> Self {
        let n = time_s.len();
        let mut drive =
            Self { steps, signal: Vec::with_capacity(n * steps), by_delay: Vec::with_capacity(n * steps) };
        if n < 2 {
            return drive;
        }
        let mut signal = Signal::new(time_s, values, hold.into());
        let mut last = signal.value_and_integral(time_s[0] - delay_s);
        for k in 0..n - 1 {
            let width = time_s[k + 1] - time_s[k];
            for s in 0..steps {
                let h = width / steps as f64;
                let next = signal.value_and_integral(time_s[k] + (s + 1) as f64 * h - delay_s);
                // Differences of the integral are exact even if a delay moves a sample into the step.
                drive.signal.push((next.1 - last.1) / h);
                drive.by_delay.push((last.0 - next.0) / h);
                last = next;
            }
        }
        drive
    }

    /// Mean signal from a sample to the next.
    #[must_use]
    pub fn mean_after(&self, sample: usize) -> f64 {
        let steps = sample * self.steps..(sample + 1) * self.steps;
        self.signal[steps].iter().sum::<f64>() / self.steps as f64
    }

    /// Mean signal from each sample to the next; the last sample has no interval and gets `last`.
    #[must_use]
    pub fn means_by_sample(&self, last: Option<f64>) -> Vec<f64> {
        (0..self.signal.len() / self.steps.max(1)).map(|k| self.mean_after(k)).chain(last).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_of_a_smooth_signal_keep_its_amplitude() {
        // 3.2 Hz at 100 Hz, with stamps that jitter.
        let omega = 20.0;
        let time_s: Vec<f64> = (0..400).map(|k| 0.01 * f64::from(k) + 0.001 * f64::from(k % 3)).collect();
        let values: Vec<f64> = time_s.iter().map(|t| (omega * t).sin()).collect();
        let worst_of = |between| {
            let mut signal = Signal::new(&time_s, &values, between);
            let mut worst = 0.0f64;
            for k in 10..3900 {
                let t = 0.001 * f64::from(k);
                let (value, integral) = signal.value_and_integral(t);
                // The integral's error is scaled by the frequency.
                let exact = (1.0 - (omega * t).cos()) / omega;
                worst = worst.max((value - (omega * t).sin()).abs()).max(omega * (integral - exact).abs());
            }
            worst
        };
        let worst = [Interpolation::Cubic, Interpolation::Linear, Interpolation::Held].map(worst_of);
        assert!(worst[0] < 3e-4, "{worst:?}");
        assert!(worst[1] > 10.0 * worst[0] && worst[2] > 10.0 * worst[1], "{worst:?}");
    }
}
