//! The measured effort as it acts on the joint over the small steps of a rollout.

use crate::gap::record::log::JointLog;

/// How the effort runs between samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Hold {
    /// It keeps its value until the next sample.
    #[default]
    Zero,
    /// It runs straight to the next sample.
    Linear,
}

/// Longest step of a rollout, seconds.
/// derived: one step an interval at 200 Hz, the rate of most logs, with 4 % for the stamps.
pub const MAX_STEP_S: f64 = 5.2e-3;

/// Mean effort of every step, and its derivative by the delay.
#[derive(Clone, Debug, Default)]
pub struct Drive {
    /// Steps between two samples.
    pub steps: usize,
    /// Mean effort of each step, `steps` an interval.
    pub effort: Vec<f64>,
    /// Derivative of it by the delay, 1/s.
    pub by_delay: Vec<f64>,
}

/// The effort at a time and its integral from the start of the log.
struct Signal<'a> {
    log: &'a JointLog,
    hold: Hold,
    at: usize,
    /// Integral up to sample `at`.
    sum: f64,
}

impl Signal<'_> {
    /// Value and integral at `t`; calls must not go back in time.
    fn at(&mut self, t: f64) -> (f64, f64) {
        let (time, effort) = (&self.log.time_s, &self.log.effort);
        while self.at + 1 < time.len() && time[self.at + 1] <= t {
            let width = time[self.at + 1] - time[self.at];
            self.sum += width
                * match self.hold {
                    Hold::Zero => effort[self.at],
                    Hold::Linear => 0.5 * (effort[self.at] + effort[self.at + 1]),
                };
            self.at += 1;
        }
        let (k, x) = (self.at, t - time[self.at]);
        let next = effort.get(k + 1).copied().unwrap_or(effort[k]);
        match self.hold {
            Hold::Linear if x > 0.0 && k + 1 < time.len() => {
                let slope = (next - effort[k]) / (time[k + 1] - time[k]);
                (effort[k] + slope * x, self.sum + x * (effort[k] + 0.5 * slope * x))
            }
            // Before the first sample the effort counts as the first one.
            _ => (effort[k], self.sum + x * effort[k]),
        }
    }
}

impl Drive {
    /// The effort of a log, acting `delay_s` late, with `finer` times the usual steps.
    #[must_use]
    pub fn new(log: &JointLog, hold: Hold, delay_s: f64, finer: usize) -> Self {
        Self::with_steps(log, hold, delay_s, Self::steps(log) * finer)
    }

    /// Usual steps between two samples of a log.
    #[must_use]
    pub fn steps(log: &JointLog) -> usize {
        log.interval_s().map_or(1, |dt| (dt / MAX_STEP_S).ceil().clamp(1.0, 64.0) as usize)
    }

    /// The same with a given number of steps between two samples.
    #[must_use]
    pub fn with_steps(log: &JointLog, hold: Hold, delay_s: f64, steps: usize) -> Self {
        let n = log.time_s.len();
        let mut drive =
            Self { steps, effort: Vec::with_capacity(n * steps), by_delay: Vec::with_capacity(n * steps) };
        if n < 2 {
            return drive;
        }
        let mut signal = Signal { log, hold, at: 0, sum: 0.0 };
        let mut last = signal.at(log.time_s[0] - delay_s);
        for k in 0..n - 1 {
            let width = log.time_s[k + 1] - log.time_s[k];
            for s in 0..steps {
                let h = width / steps as f64;
                let next = signal.at(log.time_s[k] + (s + 1) as f64 * h - delay_s);
                // Differences of the integral are exact also where a delay moves a sample into the step.
                drive.effort.push((next.1 - last.1) / h);
                drive.by_delay.push((last.0 - next.0) / h);
                last = next;
            }
        }
        drive
    }
}
