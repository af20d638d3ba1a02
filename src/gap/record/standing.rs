//! Joints that stand still.

use crate::record::{
    log::{JointLog, LEAST_RANGE, position_noise},
    recording::Recording,
};

/// Least range of a position, rad or m. chosen: less is rounding
const LEAST_TRAVEL: f64 = 1e-9;

/// Whether positions over `range` show a motion beyond noise of a standard deviation, rad or m.
#[must_use]
pub fn is_motion(range: f64, noise: f64) -> bool {
    // A range of NaN is no motion.
    range > LEAST_RANGE * noise && range >= LEAST_TRAVEL
}

/// Mean position of a joint that stands at one place in all runs, rad or m; `None` if it moves, or a run has
/// no position of it.
#[must_use]
pub fn standing_position(runs: &[&Recording], joint: &str) -> Option<f64> {
    let mut logs = Vec::with_capacity(runs.len());
    for run in runs {
        let samples = run.samples(joint)?;
        let mut log = JointLog::default();
        for (&time_s, &position) in samples.time_s.iter().zip(&samples.position) {
            if position.is_finite() && log.time_s.last().is_none_or(|last| time_s > *last) {
                log.time_s.push(time_s);
                log.position.push(position);
            }
        }
        if log.position.is_empty() {
            return None;
        }
        logs.push(log);
    }
    let all = || logs.iter().flat_map(|l| l.position.iter().copied());
    let low = all().fold(f64::INFINITY, f64::min);
    let high = all().fold(f64::NEG_INFINITY, f64::max);
    let stands = !is_motion(high - low, position_noise(&logs));
    stands.then(|| all().sum::<f64>() / all().count() as f64)
}
