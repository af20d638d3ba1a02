//! Input of a fit: logs of one joint, windows, smoothed motion, noise and the catalogue.

use crate::{
    fit::{
        noise::EffortNoise,
        rollout::Start,
        smooth::{Trace, smoothed_traces},
    },
    model::{
        effect::{Coverage, Place},
        joint_model::{Catalogue, JointModel},
        plant::Plant,
    },
    record::{
        drive::{Drive, Hold, MAX_STEP_S},
        jitter::reading_noise,
        log::{JointLog, Span, shooting_windows},
        motion::SmoothMotion,
        reading_noise::ReadingNoise,
    },
};

/// Unreported offset between the stamps of effort and position, as a share of a sample interval.
/// tuned: tests/python/gap/generate.py.
const LAG_SHARE: f64 = 0.06;
/// The same where efforts are sampled with the positions: a driver reads them at any time of its cycle.
/// derived: the standard deviation of a uniform distribution over an interval, 1/sqrt(12).
const SAMPLED_LAG_SHARE: f64 = 0.288_675_134_594_812_9;
/// Deviation of a servo's delay from the regressed one, seconds.
/// derived: the spacing of the tried delays.
const SERVO_LAG_S: f64 = 0.01;
/// Least noise of the effort, relative to its size.
/// derived: rounding to a 32-bit float, the type of efforts in drivers, 2^-24.
pub(super) const MIN_EFFORT_NOISE: f64 = 1.0 / 16_777_216.0;

/// Largest phase angle of a servo's oscillation in one step, rad.
/// chosen: the frequency error of a leapfrog is the square over 24: a ten-thousandth, as low as the noise of
/// a good encoder over an oscillation.
const MAX_TURN: f64 = 0.05;
/// Most steps between two samples for a servo.
/// chosen: a servo oscillating faster holds the joint, however many steps are made.
const MAX_SERVO_STEPS: f64 = 64.0;

/// Most parts of a cross-validation.
const FOLDS: usize = 6;

/// Steps of the last fit and of the proof per step of the search.
const FINER: usize = 4;

/// How residuals are weighted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Weighing {
    /// By the noise of effort and readings: each sample counts by its innovation.
    Innovations,
    /// By the size of the residuals of whole windows, for a machine with more effects than any model:
    /// neighboring samples are correlated, and only a share counts as independent.
    Predictions {
        /// Independent share of the samples.
        independent: f64,
    },
}

impl Weighing {
    /// Share of the samples counted as independent.
    pub fn counting_share(self) -> f64 {
        match self {
            Self::Innovations => 1.0,
            Self::Predictions { independent } => independent,
        }
    }

    /// Noise at the start of a fit, before there are residuals.
    pub fn first_noise(self, noise: EffortNoise, problem: &Problem) -> EffortNoise {
        match self {
            Self::Innovations => noise.at_least(problem.min_sigma_u),
            Self::Predictions { .. } if noise.deflection > 0.0 => noise,
            Self::Predictions { .. } => EffortNoise {
                deflection: problem.coverage.travel.max(problem.noise_floor()),
                ..EffortNoise::white_noise(problem.min_sigma_u)
            },
        }
    }
}

/// Samples of a window if it is predicted as a whole.
/// chosen: oscillations shorter than a 32nd of a window are not of interest.
const SAMPLES_OF_PREDICTION: f64 = 64.0;
/// Independent measurements in the predicted positions of a window: its start state, and two more.
/// chosen: a missing effort is integrated twice; beyond position and velocity two smooth curves hold most of
/// its result.
const FREEDOM_OF_WINDOW: f64 = 4.0;

/// The logs of one joint, prepared for a fit.
#[derive(Clone)]
pub struct Problem<'c> {
    /// Catalogue of effects.
    pub catalogue: &'c Catalogue,
    /// The joint as modelled by the twin.
    pub plant: Plant,
    /// Whether the joint is revolute.
    pub turns: bool,
    /// Log of each run.
    pub logs: Vec<JointLog>,
    /// How the effort is interpolated between samples.
    pub hold: Hold,
    /// Windows for the shooting.
    pub windows: Vec<Span>,
    /// Smoothed motion of each log.
    pub traces: Vec<Trace>,
    /// Range of the motion: positions, speeds, efforts.
    pub coverage: Coverage,
    /// Noise of the position readings.
    pub noise: ReadingNoise,
    /// Variance of each reading, for each log.
    pub readings: Vec<Vec<f64>>,
    /// Standard deviation of the lag's prior, seconds.
    pub lag_sigma_s: f64,
    /// Least standard deviation of the effort.
    pub min_sigma_u: f64,
    /// Steps between two samples of each log, in the search.
    pub steps: Vec<usize>,
    /// Steps of a rollout per step of the search.
    pub finer: usize,
    /// How the residuals are weighted.
    pub weighing: Weighing,
}

/// Length of a window in time constants of the damping.
/// chosen: beyond this, little is left of a start velocity.
const DAMPING_TIMES: f64 = 2.5;
/// Least and largest length of a window, seconds.
/// chosen: enough samples for a fit, yet not so long that the start state dominates.
const WINDOW_S: [f64; 2] = [0.25, 1.0];
/// Quantiles of the speed for its middle and its top. Effects' start shapes are scaled by the top, and a
/// single bad sample would shift them all.
/// chosen: one sample of two hundred may be bad.
const SPEED_QUANTILES: [f64; 2] = [0.6, 0.995];
/// Least slope of the load over the position, N m/rad or N/m; a smaller one counts as zero.
/// chosen: above rounding, below any load of practical size.
const LEAST_SLOPE: f64 = 1e-6;

/// Window length for a joint, seconds: two and a half time constants of its damping, and three of its load
/// where this drives it away from rest, between a quarter of a second and a second. The start states would
/// dominate longer windows. See docs/method.md (14.6).
pub fn window_length_s(plant: &Plant) -> f64 {
    let slope = plant.load.sine.hypot(plant.load.cosine);
    let damped =
        if plant.damping > 0.0 { DAMPING_TIMES * plant.inertia / plant.damping } else { f64::INFINITY };
    let driven = if slope > 0.0 { 3.0 * (plant.inertia / slope).sqrt() } else { f64::INFINITY };
    damped.min(driven).clamp(WINDOW_S[0], WINDOW_S[1])
}

impl<'c> Problem<'c> {
    /// Prepares logs.
    pub fn new(
        catalogue: &'c Catalogue,
        plant: &Plant,
        turns: bool,
        logs: Vec<JointLog>,
        hold: Hold,
    ) -> Self {
        let noise = reading_noise(&logs);
        Self::with_noise(catalogue, plant, turns, logs, hold, noise)
    }

    /// Prepares logs with known noise.
    fn with_noise(
        catalogue: &'c Catalogue,
        plant: &Plant,
        turns: bool,
        logs: Vec<JointLog>,
        hold: Hold,
        noise: ReadingNoise,
    ) -> Self {
        let readings: Vec<Vec<f64>> = logs.iter().map(|l| reading_variances(l, &noise)).collect();
        let steps = logs.iter().map(|l| rollout_steps(l, plant)).collect();
        let traces = smoothed_traces(&logs, hold, plant, &readings);
        let windows = shooting_windows(&logs, window_length_s(plant));
        let coverage = motion_coverage(plant, turns, &logs, &traces, noise.at_rest);
        let interval = coverage.interval_s;
        let min_sigma_u = MIN_EFFORT_NOISE * coverage.effort_rms.max(plant.load.amplitude()).max(1e-12);
        Self {
            catalogue,
            plant: plant.clone(),
            turns,
            logs,
            hold,
            windows,
            traces,
            coverage,
            noise,
            readings,
            lag_sigma_s: match hold {
                _ if plant.actuator.is_late => SERVO_LAG_S,
                Hold::Zero => LAG_SHARE * interval,
                Hold::Sampled => SAMPLED_LAG_SHARE * interval,
            },
            min_sigma_u,
            steps,
            finer: 1,
            weighing: Weighing::Innovations,
        }
    }

    /// Other logs of the same joint; the sensor's noise is taken from the present logs.
    #[must_use]
    pub fn of_logs(&self, logs: Vec<JointLog>) -> Self {
        let same = Self::with_noise(self.catalogue, &self.plant, self.turns, logs, self.hold, self.noise);
        Self { weighing: self.weighing, ..same.with_lag_of(self) }
    }

    /// The same logs for predictions of whole windows, resampled no finer than these need.
    #[must_use]
    pub fn for_prediction(&self) -> Self {
        self.predicting_over(window_length_s(&self.plant))
    }

    /// The same for windows of another length.
    #[must_use]
    pub fn predicting_over(&self, length_s: f64) -> Self {
        let coarse = self.with_interval(length_s / SAMPLES_OF_PREDICTION);
        let windows = coarse.windows.len() as f64;
        let independent = FREEDOM_OF_WINDOW * windows / coarse.sample_count().max(1) as f64;
        Self { weighing: Weighing::Predictions { independent: independent.min(1.0) }, ..coarse }
    }

    /// The same logs, resampled no finer than the steps of a rollout.
    #[must_use]
    pub fn at_steps(self) -> Self {
        if self.logs.iter().any(|l| l.samples_in(MAX_STEP_S) > 1) {
            self.with_interval(MAX_STEP_S)
        } else {
            self
        }
    }

    /// The same logs with samples about `interval_s` apart, where the recorded ones are closer.
    fn with_interval(&self, interval_s: f64) -> Self {
        let logs = self.logs.iter().map(|l| l.with_interval(interval_s, self.hold)).collect();
        // The resampled efforts are means, held from sample to sample.
        Self::with_noise(self.catalogue, &self.plant, self.turns, logs, Hold::Zero, self.noise)
            .with_lag_of(self)
    }

    /// The same with a lag as uncertain as that of the problem from which its logs were taken.
    fn with_lag_of(self, recorded: &Self) -> Self {
        Self { lag_sigma_s: self.lag_sigma_s.max(recorded.lag_sigma_s), ..self }
    }

    /// Held-out logs, with the small steps of the proof.
    pub fn held_out(fitted: &Self, logs: Vec<JointLog>) -> Self {
        Self { finer: FINER, ..fitted.of_logs(logs) }
    }

    /// Folds of a cross-validation, each as the fitted problem and the tested one: one run, or one of `FOLDS`
    /// groups of runs, is tested; a single run is halved.
    pub fn cross_validation_folds(&self) -> Vec<[Self; 2]> {
        if let [log] = self.logs.as_slice() {
            let n = log.time_s.len();
            let first = self.of_logs(vec![log.part_between(0, n / 2)]);
            let second = self.of_logs(vec![log.part_between(n / 2, n)]);
            return vec![[first.clone(), second.clone()], [second, first]];
        }
        let count = self.logs.len().min(FOLDS);
        (0..count).map(|k| [self.of_runs(|i| i % count != k), self.of_runs(|i| i % count == k)]).collect()
    }

    /// The logs whose index `is_kept` accepts.
    fn of_runs(&self, is_kept: impl Fn(usize) -> bool) -> Self {
        let kept = self.logs.iter().enumerate().filter(|(i, _)| is_kept(*i));
        self.of_logs(kept.map(|(_, log)| log.clone()).collect())
    }

    /// The same with windows shortened to a share of their length.
    #[must_use]
    pub fn with_windows(&self, share: f64) -> Self {
        Self { windows: shooting_windows(&self.logs, share * window_length_s(&self.plant)), ..self.clone() }
    }

    /// The same with the small steps used for reported parameters.
    #[must_use]
    pub fn with_small_steps(&self) -> Self {
        Self { finer: FINER, ..self.clone() }
    }

    /// Start states of all windows from the smoothed motion, as seen by the model's sensor.
    pub fn smoothed_starts(&self, model: &JointModel) -> Vec<Start> {
        let sensor = model.position_sensor(self.catalogue);
        let mut starts = Vec::with_capacity(self.windows.len());
        for w in &self.windows {
            let trace = &self.traces[w.log];
            // A joint moving up drags its sensor along at the lower end of the gap.
            let play = -trace.direction[w.start];
            let position = (trace.position[w.start] - sensor.bias) / sensor.scale - play * sensor.half_gap;
            starts.push(Start { position, velocity: trace.velocity[w.start] / sensor.scale, play });
        }
        starts
    }

    /// The effort of every log with the model's delay.
    pub fn model_drives(&self, model: &JointModel) -> Vec<Drive> {
        let delay = model.delay_s(self.catalogue);
        self.drives_late(delay)
    }

    /// The effort of every log with a delay, seconds.
    pub fn drives_late(&self, delay_s: f64) -> Vec<Drive> {
        let logs = self.logs.iter().zip(&self.steps);
        logs.map(|(l, steps)| Drive::with_steps(l, self.hold, delay_s, steps * self.finer)).collect()
    }

    /// Indices of the effects to be sought, without those already fitted with the actuator.
    pub fn sought_effects(&self) -> Vec<usize> {
        (0..self.catalogue.len()).filter(|e| self.is_sought(*e)).collect()
    }

    /// Whether an effect is sought.
    fn is_sought(&self, effect: usize) -> bool {
        let actuator = &self.plant.actuator;
        let [gain, damping] = actuator.is_found;
        let gain = gain || actuator.is_calibrated;
        match self.catalogue[effect].place() {
            Place::Gain => !gain,
            Place::Delay => !actuator.is_late,
            // If the load does not depend on the position, a scale of the position is equivalent to a gain.
            Place::Scale => !gain || self.coverage.has_load_slope,
            _ => !(damping && self.catalogue[effect].is_of_damping()),
        }
    }

    /// Root mean square of the readings' standard deviations in the windows, rad or m.
    pub fn noise_floor(&self) -> f64 {
        let variances = self.windows.iter().map(|w| self.readings[w.log][w.start..w.start + w.len].iter());
        (variances.map(|v| v.sum::<f64>()).sum::<f64>() / self.sample_count().max(1) as f64).sqrt()
    }

    /// Number of independent measurements in the windows.
    pub fn independent_count(&self) -> f64 {
        (self.weighing.counting_share() * self.sample_count() as f64).max(2.0)
    }

    /// Number of measurements in the windows.
    pub fn sample_count(&self) -> usize {
        self.windows.iter().map(|w| w.len).sum()
    }
}

/// Steps of a rollout between two samples, more for a fast servo.
fn rollout_steps(log: &JointLog, plant: &Plant) -> usize {
    let swings = plant.actuator.servo.map_or(0.0, |s| (s.stiffness / plant.inertia).sqrt());
    let of_servo = log.interval_s().map_or(1.0, |dt| (dt * swings / MAX_TURN).ceil());
    Drive::usual_steps(log).max(of_servo.min(MAX_SERVO_STEPS) as usize)
}

/// Variance of every reading of a log.
fn reading_variances(log: &JointLog, noise: &ReadingNoise) -> Vec<f64> {
    // Without jitter the speeds do not matter, and smoothing is expensive.
    if noise.jitter_s == 0.0 {
        return vec![noise.variance_at_speed(0.0); log.position.len()];
    }
    SmoothMotion::of_positions(&log.time_s, &log.position, noise, &[]).reading_variances(noise)
}

fn motion_coverage(
    plant: &Plant,
    turns: bool,
    logs: &[JointLog],
    traces: &[Trace],
    sigma_y: f64,
) -> Coverage {
    let positions = || traces.iter().flat_map(|t| t.position.iter().copied());
    let mut speeds: Vec<f64> = traces.iter().flat_map(|t| t.velocity.iter().map(|v| v.abs())).collect();
    speeds.sort_by(f64::total_cmp);
    let at =
        |share: f64| speeds.get((share * (speeds.len().max(1) - 1) as f64) as usize).copied().unwrap_or(0.0);
    let efforts: Vec<f64> = traces.iter().flat_map(|t| t.effort.iter().copied()).collect();
    let low = positions().fold(f64::INFINITY, f64::min);
    let high = positions().fold(f64::NEG_INFINITY, f64::max);
    // Every twentieth sample suffices to see whether the load depends on the position.
    let carried = logs.iter().flat_map(|l| l.carried.iter().step_by(20).map(Some));
    let seen: Vec<_> =
        std::iter::once(None).filter(|_| logs.iter().all(|l| l.carried.is_empty())).chain(carried).collect();
    let slopes = (0..9)
        // derived: nine positions have eight intervals.
        .map(|i| low + (high - low) * f64::from(i) / 8.0)
        .flat_map(|q| seen.iter().map(move |c| plant.load_at(*c, q).1));
    let slope = slopes.fold(0.0f64, |m, s| m.max(s.abs()));
    Coverage {
        position: (low, high),
        travel: traces.iter().map(Trace::position_range).fold(0.0, f64::max),
        speed: (at(SPEED_QUANTILES[0]), at(SPEED_QUANTILES[1])),
        effort_rms: (efforts.iter().map(|u| u * u).sum::<f64>() / efforts.len().max(1) as f64).sqrt(),
        interval_s: logs.iter().filter_map(JointLog::interval_s).fold(0.0, f64::max),
        inertia: plant.inertia,
        damping: plant.damping,
        position_noise: sigma_y,
        durations_s: logs.iter().map(JointLog::duration_s).collect(),
        others: logs.first().map_or(0, |l| l.others.len()),
        turns,
        has_load_slope: slope > LEAST_SLOPE,
        in_chain: logs.iter().any(|l| !l.carried.is_empty()),
    }
}
