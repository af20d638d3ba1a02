//! Noise of recorded positions, from their scatter about a smooth motion.

use crate::record::{
    log::{JointLog, position_noise},
    motion::SmoothMotion,
    reading_noise::ReadingNoise,
};
use numeric::statistics::CHI_SQUARE_999;

/// Noise of the logs of one joint: (14.1), and the jitter giving the most likely smooth motion, (14.5).
#[must_use]
pub fn reading_noise(logs: &[JointLog]) -> ReadingNoise {
    let noise = ReadingNoise::at_rest(position_noise(logs));
    let motions: Vec<SmoothMotion> =
        logs.iter().map(|l| SmoothMotion::of_positions(&l.time_s, &l.position, &noise, &[])).collect();
    let speeds = motions.iter().flat_map(|m| m.state.iter().map(|s| s[1].abs()));
    let top = speeds.fold(0.0, f64::max);
    if !(top > 0.0) {
        return noise;
    }
    // From a negligible jitter at the top speed to one far beyond the noise at rest.
    let grid = (0..JITTERS).map(|i| noise.at_rest / top * f64::from(i).exp2());
    let trials = grid.map(|jitter_s| ReadingNoise { jitter_s, ..noise });
    let best =
        trials.map(|t| (positions_likelihood(&motions, logs, &t), t)).max_by(|a, b| a.0.total_cmp(&b.0));
    let without = ReadingNoise { jitter_s: 0.0, ..noise };
    match best {
        Some((reached, with)) if reached > positions_likelihood(&motions, logs, &without) + ENOUGH => with,
        _ => noise,
    }
}

/// Log likelihood of the positions of logs under a noise.
fn positions_likelihood(motions: &[SmoothMotion], logs: &[JointLog], noise: &ReadingNoise) -> f64 {
    motions.iter().zip(logs).map(|(m, l)| m.log_likelihood_under(&l.position, noise)).sum()
}

/// Number of tried jitters, each twice the one before.
const JITTERS: i32 = 8;
/// Least gain of log likelihood for a jitter to be accepted.
/// derived: half the quantile of chi-square with one degree of freedom.
const ENOUGH: f64 = 0.5 * CHI_SQUARE_999[0];

#[cfg(test)]
mod tests {
    use super::*;

    fn log(jitter_s: f64) -> JointLog {
        // Uniform with a deviation of one, in an order without a pattern. The joint rests most of the time.
        let normal = |k: usize, a: usize| {
            let x = ((k * a % 1009) as f64 + 0.5) / 1009.0;
            (2.0 * x - 1.0) * 12f64.sqrt() / 2.0
        };
        let time_s: Vec<f64> = (0..2000).map(|k| 0.002 * k as f64).collect();
        let position = time_s
            .iter()
            .enumerate()
            .map(|(k, t)| (3.0 * (t + jitter_s * normal(k, 613))).sin().powi(9) + 1e-4 * normal(k, 719))
            .collect();
        JointLog { time_s, position, ..JointLog::default() }
    }

    #[test]
    fn stamps_that_jitter_are_noise_that_grows_with_speed() {
        assert_eq!(reading_noise(&[log(0.0)]).jitter_s, 0.0);
        let found = reading_noise(&[log(2e-4)]).jitter_s;
        assert!((1.3e-4..3e-4).contains(&found), "{found}");
    }
}
