//! Measured motion of one joint: samples, runs, and windows for the shooting.

use crate::record::carried::Carried;
use numeric::statistics::{MAD_IN_SIGMAS, median};

/// One recorded run of one joint; stamps strictly increase.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointLog {
    /// Name of the run.
    pub run: String,
    /// Seconds from the start of the run.
    pub time_s: Vec<f64>,
    /// Measured position, rad or m.
    pub position: Vec<f64>,
    /// Effort at the joint from this sample on, N m or N; for a servo, computed from the readings.
    pub effort: Vec<f64>,
    /// Commanded position of a servo from this sample on, rad or m; empty if efforts were recorded.
    pub commanded: Vec<f64>,
    /// Measured positions of the twin's other moving joints at the same stamps, by joint.
    pub others: Vec<Vec<f64>>,
    /// Effects of the other joints of its chain, from each sample to the next; empty without a chain.
    pub carried: Vec<Carried>,
}

/// Consecutive samples without a gap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// Index of the log.
    pub log: usize,
    /// First sample.
    pub start: usize,
    /// Number of samples.
    pub len: usize,
}

/// An interval longer than this many usual ones counts as a gap.
/// tuned: tests/python/gap/generate.py.
pub const GAP_INTERVALS: f64 = 3.5;

impl JointLog {
    /// The signal driving the joint: the commanded position of a servo, or the effort.
    #[must_use]
    pub fn driving_signal(&self) -> &[f64] {
        if self.commanded.is_empty() { &self.effort } else { &self.commanded }
    }

    /// Usual sample interval, seconds; `None` with fewer than two samples.
    #[must_use]
    pub fn interval_s(&self) -> Option<f64> {
        median(self.time_s.windows(2).map(|w| w[1] - w[0]).collect())
    }

    /// Segments of samples without a gap.
    #[must_use]
    pub fn gapless_segments(&self, log: usize) -> Vec<Span> {
        let Some(usual) = self.interval_s() else { return Vec::new() };
        let mut spans = Vec::new();
        let mut start = 0;
        for k in 1..=self.time_s.len() {
            if k == self.time_s.len() || self.time_s[k] - self.time_s[k - 1] > GAP_INTERVALS * usual {
                spans.push(Span { log, start, len: k - start });
                start = k;
            }
        }
        spans
    }

    /// Positions of the first eight other joints halfway between a sample and the next.
    #[must_use]
    pub fn others_after(&self, k: usize) -> [f64; 8] {
        let mut now = [0.0; 8];
        for (now, other) in now.iter_mut().zip(&self.others) {
            *now = 0.5 * (other[k] + other[k + 1]);
        }
        now
    }

    /// The samples from `from` to `to`.
    #[must_use]
    pub fn part_between(&self, from: usize, to: usize) -> Self {
        Self {
            run: self.run.clone(),
            time_s: self.time_s[from..to].to_vec(),
            position: self.position[from..to].to_vec(),
            effort: self.effort[from..to].to_vec(),
            commanded: self.commanded.get(from..to).map(<[f64]>::to_vec).unwrap_or_default(),
            others: self.others.iter().map(|o| o[from..to].to_vec()).collect(),
            carried: self.carried.get(from..to).map(<[Carried]>::to_vec).unwrap_or_default(),
        }
    }

    /// Duration, seconds.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        match (self.time_s.first(), self.time_s.last()) {
            (Some(a), Some(b)) => b - a,
            _ => 0.0,
        }
    }
}

/// Least range of the positions of a joint that moves, in standard deviations of their noise.
/// chosen: the motion is then resolved by some tens of steps.
pub const LEAST_RANGE: f64 = 30.0;
/// Fewest samples of a window.
/// chosen: fewer reveal little beyond their start state.
const LEAST_SAMPLES: usize = 8;
/// A number counts as whole if its fraction is farther than this from one half.
/// chosen: within a hundredth of a step it is rounding.
const NEAR_WHOLE: f64 = 0.49;
/// Least spacing of two different held positions, as a share of the mean spacing; a smaller one is rounding
/// in the recording.
/// chosen: recordings resolve a thousandth of a step.
const SPLIT: f64 = 1e-3;
/// Largest deviation of a spacing from a whole number of encoder steps, in steps.
/// chosen: a tenth of a step.
const OFF_STEP: f64 = 0.1;

/// Windows of about `length_s` seconds, equally long within each segment; segments shorter than a third of it
/// are left out.
#[must_use]
pub fn shooting_windows(logs: &[JointLog], length_s: f64) -> Vec<Span> {
    let mut windows = Vec::new();
    for (index, log) in logs.iter().enumerate() {
        let Some(interval) = log.interval_s() else { continue };
        let wanted = (length_s / interval).round().max(LEAST_SAMPLES as f64) as usize;
        for segment in log.gapless_segments(index) {
            // Such a segment reveals little beyond its start state.
            if segment.len * 3 < wanted || segment.len < LEAST_SAMPLES {
                continue;
            }
            let count = (segment.len as f64 / wanted as f64).round().max(1.0) as usize;
            for w in 0..count {
                let a = segment.len * w / count;
                let b = segment.len * (w + 1) / count;
                windows.push(Span { log: index, start: segment.start + a, len: b - a });
            }
        }
    }
    windows
}

/// Root mean square.
#[must_use]
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|r| r * r).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// White noise of the positions, rad or m, from the median absolute fourth difference: the motion of a mass
/// hardly contributes to it. See docs/method.md (14.1).
#[must_use]
pub fn position_noise(logs: &[JointLog]) -> f64 {
    let mut differences = Vec::new();
    let mut steps = Vec::new();
    for (index, log) in logs.iter().enumerate() {
        for s in log.gapless_segments(index) {
            let q = &log.position[s.start..s.start + s.len];
            // derived: binomial coefficients.
            let fourth = q.windows(5).map(|w| w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]);
            differences.extend(fourth.map(f64::abs));
            steps.extend(q.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| *d > 0.0));
        }
    }
    let Some(difference) = median(differences) else { return 0.0 };
    // derived: the standard deviation of the fourth difference of unit white noise is sqrt(70).
    let sigma = difference / MAD_IN_SIGMAS / 70f64.sqrt();
    // A quantized encoder at rest still has its rounding noise.
    steps.sort_by(f64::total_cmp);
    // A quantile, since rounding in the recording may split single steps.
    let smallest = steps.get(steps.len() / 50).copied().unwrap_or(0.0);
    // Steps of an encoder are whole multiples of the smallest: fractions near 0 or near 1.
    let quantized = steps.iter().filter(|d| ((*d / smallest).fract() - 0.5).abs() > NEAR_WHOLE).count() * 10
        > steps.len() * 9;
    let step = if quantized { Some(smallest) } else { encoder_step(logs) };
    // derived: the standard deviation of a uniform distribution over a step.
    step.map_or(sigma, |step| sigma.max(step / 12f64.sqrt()))
}

/// A position counts as held after this many samples without any change.
const HELD_SAMPLES: usize = 4;
/// Fewest different held positions to recognize an encoder.
const MIN_HELD: usize = 8;

/// Step of the encoder, rad or m, if the held positions are multiples of a step. At rest this is visible even
/// in positions interpolated between encoder readings.
fn encoder_step(logs: &[JointLog]) -> Option<f64> {
    let stretches = logs.iter().flat_map(|l| l.position.windows(HELD_SAMPLES));
    let mut held: Vec<f64> = stretches.filter(|w| w.iter().all(|q| *q == w[0])).map(|w| w[0]).collect();
    held.sort_by(f64::total_cmp);
    held.dedup();
    if held.len() < MIN_HELD {
        return None;
    }
    let mut gaps: Vec<f64> = held.windows(2).map(|w| w[1] - w[0]).collect();
    gaps.sort_by(f64::total_cmp);
    // Rounding in the recording may split one encoder step into neighbors.
    let trial =
        gaps.iter().copied().find(|g| *g > SPLIT * (held[held.len() - 1] - held[0]) / held.len() as f64)?;
    let on = gaps.iter().filter(|g| ((*g / trial).round() - *g / trial).abs() < OFF_STEP).count();
    (on * 10 >= gaps.len() * 9).then_some(trial)
}
