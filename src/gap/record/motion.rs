//! Motion of a joint from its positions: a Kalman smoother. The acceleration is an expected one plus a
//! remainder driven by white jerk, with a level chosen by likelihood. See docs/method.md (14.5).

use nalgebra::{Matrix3, Vector3};

use crate::record::reading_noise::ReadingNoise;

/// Motion at the stamps of the positions and between them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SmoothMotion {
    /// Stamps, seconds.
    pub time_s: Vec<f64>,
    /// (position, velocity, remainder of the acceleration) at each stamp.
    pub state: Vec<Vector3<f64>>,
    /// Expected acceleration from each stamp to the next; empty if there is none.
    pub expected: Vec<f64>,
    /// Index of the chosen level of the jerk.
    pub level: i32,
}

/// Lowest tried jerk, in ranges of the position per s^2 and root second.
/// chosen: far below the jerk of any recorded motion.
const LEAST_JERK: f64 = 1e-4;
/// Number of tried levels of the jerk, each `RATIO` times the next lower one.
const LEVELS: i32 = 18;
/// Ratio of neighboring levels. chosen: half a decade; the likelihood is flat near its maximum.
const RATIO: f64 = 3.0;
/// Number of levels below the present one tried for another noise.
/// derived: noise taken for motion raises the level by its ratio to the true noise, at most three decades.
const LOWER: i32 = 6;

/// Jerk of a level, rad/s^2 or m/s^2 per root second.
fn jerk_of_level(position: &[f64], variances: &[f64], level: i32) -> f64 {
    let low = position.iter().copied().fold(f64::INFINITY, f64::min);
    let high = position.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let least = variances.iter().copied().fold(f64::INFINITY, f64::min).sqrt();
    // A joint at rest has the scale of its own noise.
    LEAST_JERK * (high - low).max(10.0 * least).max(1e-12) * RATIO.powi(level)
}

impl SmoothMotion {
    /// Smooths positions, rad or m; `expected` holds an acceleration from each stamp to the next, or nothing.
    #[must_use]
    pub fn of_positions(time_s: &[f64], position: &[f64], noise: &ReadingNoise, expected: &[f64]) -> Self {
        let at_rest = vec![noise.variance_at_speed(0.0); position.len()];
        let motion = Self::likeliest_motion(time_s, position, &at_rest, expected);
        // The stamps' errors depend on the speeds of the sought motion: one repetition is enough.
        if noise.jitter_s > 0.0 {
            return Self::likeliest_motion(time_s, position, &motion.reading_variances(noise), expected);
        }
        motion
    }

    /// The motion with the most likely level of the jerk.
    fn likeliest_motion(time_s: &[f64], position: &[f64], variances: &[f64], expected: &[f64]) -> Self {
        let jerk = |level| jerk_of_level(position, variances, level);
        let filtered = |level| filter_positions(time_s, position, variances, jerk(level), expected);
        let best = (0..LEVELS).map(|i| (filtered(i).1, i)).max_by(|a, b| a.0.total_cmp(&b.0));
        let level = best.map_or(0, |b| b.1);
        let (passed, _) = filtered(level);
        let mut state: Vec<Vector3<f64>> = passed.iter().map(|p| p.updated.0).collect();
        // Backward pass of the Rauch-Tung-Striebel smoother.
        for k in (0..state.len().saturating_sub(1)).rev() {
            let here = &passed[k];
            let next = &passed[k + 1];
            let Some(inverse) = next.predicted.1.try_inverse() else { continue };
            let gain = here.updated.1 * next.transition.transpose() * inverse;
            state[k] = here.updated.0 + gain * (state[k + 1] - next.predicted.0);
        }
        Self { time_s: time_s.to_vec(), state, expected: expected.to_vec(), level }
    }

    /// Variance of each reading of the motion.
    #[must_use]
    pub fn reading_variances(&self, noise: &ReadingNoise) -> Vec<f64> {
        self.state.iter().map(|s| noise.variance_at_speed(s[1])).collect()
    }

    /// Log likelihood of the motion's positions under another noise, for the best level from well below the
    /// motion's.
    #[must_use]
    pub fn log_likelihood_under(&self, position: &[f64], noise: &ReadingNoise) -> f64 {
        let variances = self.reading_variances(noise);
        let mut best = f64::NEG_INFINITY;
        // Noise taken for motion had required more jerk.
        for level in self.level - LOWER..=self.level + 1 {
            let jerk = jerk_of_level(position, &variances, level);
            best = best.max(filter_positions(&self.time_s, position, &variances, jerk, &self.expected).1);
        }
        best
    }

    /// Position, velocity and acceleration at a time; outside the recording the joint rests at its first or
    /// last position.
    #[must_use]
    pub fn state_at(&self, t: f64) -> Vector3<f64> {
        let Some(last) = self.state.len().checked_sub(1) else { return Vector3::zeros() };
        let k = self.time_s.partition_point(|x| *x <= t).clamp(1, last.max(1)) - 1;
        let here = self.state[k];
        let next = self.state[(k + 1).min(last)];
        let x = (t - self.time_s[k]).clamp(0.0, self.time_s[(k + 1).min(last)] - self.time_s[k]);
        let acceleration = self.expected.get(k).copied().unwrap_or(0.0) + 0.5 * (here[2] + next[2]);
        Vector3::new(
            here[0] + x * (here[1] + 0.5 * x * acceleration),
            here[1] + x * acceleration,
            acceleration,
        )
    }
}

type Belief = (Vector3<f64>, Matrix3<f64>);

struct Passed {
    predicted: Belief,
    updated: Belief,
    transition: Matrix3<f64>,
}

/// Forward filter; returns the estimates at every sample and the log likelihood.
fn filter_positions(
    time_s: &[f64],
    position: &[f64],
    variances: &[f64],
    jerk: f64,
    expected: &[f64],
) -> (Vec<Passed>, f64) {
    let variance = variances.first().copied().unwrap_or(0.0);
    let wide = Matrix3::from_diagonal(&Vector3::new(100.0 * variance, 1e4, 1e6));
    let mut belief = (Vector3::new(position.first().copied().unwrap_or(0.0), 0.0, 0.0), wide);
    let mut transition = Matrix3::identity();
    let mut likelihood = 0.0;
    let mut passed = Vec::with_capacity(position.len());
    for (k, y) in position.iter().enumerate() {
        if k > 0 {
            let h = time_s[k] - time_s[k - 1];
            transition = Matrix3::new(1.0, h, 0.5 * h * h, 0.0, 1.0, h, 0.0, 0.0, 1.0);
            // derived: integrals of white jerk.
            let [a, b] = [h.powi(5) / 20.0, h.powi(4) / 8.0];
            // derived: likewise.
            let [c, d, e] = [h.powi(3) / 6.0, h.powi(3) / 3.0, h.powi(2) / 2.0];
            // (14.5)
            let noise = Matrix3::new(a, b, c, b, d, e, c, e, h) * (jerk * jerk);
            let push = expected.get(k - 1).copied().unwrap_or(0.0);
            belief = (
                transition * belief.0 + Vector3::new(0.5 * h * h, h, 0.0) * push,
                transition * belief.1 * transition.transpose() + noise,
            );
        }
        let predicted = belief;
        let s = predicted.1[(0, 0)] + variances[k];
        let innovation = y - predicted.0[0];
        // The first innovations only reflect the wide initial state.
        if k > 5 {
            likelihood -= 0.5 * (innovation * innovation / s + s.ln());
        }
        let gain = predicted.1.column(0) / s;
        belief = (predicted.0 + gain * innovation, predicted.1 - gain * predicted.1.row(0));
        passed.push(Passed { predicted, updated: belief, transition });
    }
    (passed, likelihood)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_oscillation_with_noise_has_its_velocity_and_acceleration() {
        let time_s: Vec<f64> = (0..1000).map(|k| 0.005 * f64::from(k)).collect();
        let noise = |k: usize| 1e-4 * (((k * 7919) % 1009) as f64 / 1009.0 - 0.5) * 12f64.sqrt();
        let position: Vec<f64> =
            time_s.iter().enumerate().map(|(k, t)| 0.5 * (4.0 * t).sin() + noise(k)).collect();
        let motion = SmoothMotion::of_positions(&time_s, &position, &ReadingNoise::at_rest(1e-4), &[]);
        let mut worst = Vector3::<f64>::zeros();
        for (k, t) in time_s.iter().enumerate().skip(50).take(900) {
            let truth = Vector3::new(0.5 * (4.0 * t).sin(), 2.0 * (4.0 * t).cos(), -8.0 * (4.0 * t).sin());
            worst = worst.sup(&(motion.state[k] - truth).abs());
        }
        assert!(worst[0] < 1e-4 && worst[1] < 0.01 && worst[2] < 0.4, "{worst}");
        assert!((motion.state_at(0.5025)[0] - 0.5 * (4.0f64 * 0.5025).sin()).abs() < 1e-4);
    }
}
