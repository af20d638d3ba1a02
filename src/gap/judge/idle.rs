//! Detects efforts that were not recorded: they never change, though the joint was driven.

use nalgebra::DVector;

use crate::{
    fit::stretch::{Moved, RunMotion},
    record::motion::SmoothMotion,
    twin_tree::TwinTree,
};

/// Parts of a joint's range in which passes are compared.
/// chosen: from one to the next the speed of a swing hardly changes.
const PARTS: usize = 64;
/// Least gain of a later pass, as a share of the largest squared speed.
/// chosen: far above what noise and the width of a part make, far below what a drive does.
const LEAST_GAIN: f64 = 0.5;

/// Whether the efforts of a run never change, though its motion gains energy: a joint without a drive passes
/// no place faster than before, whatever friction, load and springs it has.
#[must_use]
pub fn is_idle_effort(moved: &Moved) -> bool {
    is_constant(moved) && gains_energy(&moved.motion)
}

/// The same for joints of a chain that move together, by the energy of the twin: what one gains another may
/// lose. `joints` are their indices.
#[must_use]
pub fn are_idle_efforts(tree: &TwinTree, run: &RunMotion, joints: &[usize]) -> bool {
    let moved: Vec<(usize, &Moved)> = joints.iter().filter_map(|j| Some((*j, run[*j].as_ref()?))).collect();
    if moved.len() < joints.len() || !moved.iter().all(|(_, m)| is_constant(m)) {
        return false;
    }
    let Some((_, first)) = moved.first() else { return false };
    let mut least = f64::INFINITY;
    let mut most_kinetic: f64 = 0.0;
    let mut gain: f64 = 0.0;
    let every = (first.motion.time_s.len() / LOOKS).max(1);
    for t in first.motion.time_s.iter().step_by(every) {
        let mut q = vec![0.0; tree.joints.len()];
        let mut v = DVector::zeros(tree.joints.len());
        for (j, moved) in &moved {
            let state = moved.motion.state_at(*t);
            (q[*j], v[*j]) = (state[0], state[1]);
        }
        let kinetic = 0.5 * v.dot(&(tree.mass_matrix(&q) * &v));
        let energy = kinetic + tree.gravity_energy(&q);
        most_kinetic = most_kinetic.max(kinetic);
        least = least.min(energy);
        gain = gain.max(energy - least);
    }
    gain > LEAST_GAIN * most_kinetic
}

/// Moments of a run at which the energy of a chain is looked at.
/// chosen: several in each swing of a joint over a minute.
const LOOKS: usize = 500;

fn is_constant(moved: &Moved) -> bool {
    moved.log.as_ref().is_some_and(|log| log.effort.windows(2).all(|w| w[0] == w[1]))
}

/// Whether a motion passes a place with clearly more kinetic energy than it did before.
fn gains_energy(motion: &SmoothMotion) -> bool {
    let positions = || motion.state.iter().map(|s| s[0]);
    let low = positions().fold(f64::INFINITY, f64::min);
    let high = positions().fold(f64::NEG_INFINITY, f64::max);
    let most = motion.state.iter().map(|s| s[1] * s[1]).fold(0.0, f64::max);
    let width = (high - low) / PARTS as f64;
    // A joint at rest shows nothing.
    if !(width > 0.0 && most > 0.0) {
        return false;
    }
    let part = |q: f64| (((q - low) / width) as usize).min(PARTS - 1);
    // The least squared speed of the passes so far, by part, and that of the present pass.
    let mut least = [f64::INFINITY; PARTS];
    let mut present: Option<(usize, f64)> = None;
    for state in &motion.state {
        let at = part(state[0]);
        let square = state[1] * state[1];
        match &mut present {
            Some((own, slowest)) if *own == at => *slowest = slowest.min(square),
            passed => {
                if let Some((own, slowest)) = passed.replace((at, square)) {
                    least[own] = least[own].min(slowest);
                }
            }
        }
        if square > least[at] + LEAST_GAIN * most {
            return true;
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{log::JointLog, reading_noise::ReadingNoise};

    /// A swing with an amplitude over time.
    fn moved(amplitude: impl Fn(f64) -> f64, effort: impl Fn(usize) -> f64) -> Moved {
        let time_s: Vec<f64> = (0..1000).map(|k| 0.01 * f64::from(k)).collect();
        let position: Vec<f64> = time_s.iter().map(|t| amplitude(*t) * (4.0 * t).cos()).collect();
        let effort = (0..time_s.len()).map(effort).collect();
        let motion = SmoothMotion::of_positions(&time_s, &position, &ReadingNoise::at_rest(1e-5), &[]);
        Moved { log: Some(JointLog { time_s, position, effort, ..JointLog::default() }), motion }
    }

    #[test]
    fn a_swing_that_dies_out_needs_no_effort_and_one_that_grows_does() {
        let dies_out = |t: f64| (-0.2 * t).exp();
        let grows = |t: f64| 0.3 + 0.1 * t;
        assert!(!is_idle_effort(&moved(dies_out, |_| 0.0)));
        assert!(is_idle_effort(&moved(grows, |_| 0.0)));
        // A sensor may have an offset; efforts that change were recorded.
        assert!(is_idle_effort(&moved(grows, |_| 0.02)));
        assert!(!is_idle_effort(&moved(grows, |k| (k % 2) as f64)));
    }
}
