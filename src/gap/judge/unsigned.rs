//! Detects efforts recorded as magnitudes although the joint was driven in both directions.

use std::f64::consts::LN_2;

use super::doubt::{JointScene, LOG_ODDS, all_gains, gains_up_to};
use crate::{
    fit::stretch::Stretch,
    judge::convention::AS_GIVEN,
    record::{log::rms, recording::Recording},
};

/// Tried frictions in addition to the twin's effort, as shares of it.
/// chosen: none, and from half to twice: the sign follows the larger of the two.
const FRICTIONS: [f64; 4] = [0.0, 0.5, 1.0, 2.0];
/// Tried inertias, as multiples of the twin's.
/// chosen: the twin's own, and those with a small and a large gear.
const INERTIAS: [f64; 3] = [1.0, 4.0, 16.0];
/// Largest factor of an effort without sign, as a power of two: such efforts are often in counts.
/// derived: from counts of a millionth of a unit to a million units.
const LARGEST_POWER: i32 = 20;

/// Whether efforts of a joint were recorded and none is negative in any run.
#[must_use]
pub fn is_never_negative<'r>(runs: impl Iterator<Item = &'r Recording>, joint: &str) -> bool {
    let samples = runs.filter_map(|r| r.samples(joint)).flat_map(|s| s.effort.iter().copied());
    let known: Vec<f64> = samples.filter(|u| u.is_finite()).collect();
    known.iter().all(|u| *u >= 0.0) && known.iter().any(|u| *u > 0.0)
}

/// Log odds of non-negative efforts being magnitudes, against efforts in one direction. With the sign of the
/// required effort, motion and efforts must explain each other. `None` if there is too little motion.
#[must_use]
pub fn magnitude_odds(joint: &JointScene) -> Option<f64> {
    let stretches: Vec<&Stretch> = joint.stretches.iter().collect();
    let seen = joint.seen_stretches(&stretches, &AS_GIVEN);
    let gains = gains_up_to(LARGEST_POWER);
    let mut best: Option<f64> = None;
    for inertia in INERTIAS {
        let needs: Vec<f64> = seen.iter().map(|s| inertia * s.inertial + s.rest).collect();
        let size = rms(&needs);
        for friction in FRICTIONS {
            let sign: Vec<f64> = needs
                .iter()
                .zip(&seen)
                .map(|(need, s)| (need + friction * size * s.velocity.signum()).signum())
                .collect();
            let efforts = |delay_s: f64| signed_efforts(joint, &stretches, &sign, delay_s);
            // The weight of each stretch depends on the residual, and the residual on the sign.
            let with = joint.with_share(&stretches, &seen, &efforts(0.0));
            let Some(given) = with.baseline_evidence(&stretches, &all_gains()) else { continue };
            // The sign is taken from the motion to be explained, which costs one bit per independent
            // measurement.
            let odds = with.log_odds_of(&seen, &efforts, &given, &gains, (LN_2, 0.0));
            let tried = ((INERTIAS.len() * FRICTIONS.len()) as f64).ln();
            best = odds.map(|o| o.log - tried).into_iter().chain(best).reduce(f64::max);
        }
    }
    best
}

/// Recorded efforts of a joint over stretches, late by a delay, each multiplied by a sign.
fn signed_efforts(
    joint: &JointScene,
    stretches: &[&Stretch],
    sign: &[f64],
    delay_s: f64,
) -> Vec<Option<f64>> {
    let own = joint.recorded_efforts(joint.joint, stretches, delay_s);
    own.into_iter().zip(sign).map(|(u, sign)| u.map(|u| u * sign)).collect()
}

/// Whether magnitudes are probable enough for a name.
#[must_use]
pub fn is_magnitude(joint: &JointScene) -> bool {
    magnitude_odds(joint).is_some_and(|odds| odds > LOG_ODDS)
}

/// Gives efforts the sign of command minus position. Returns whether the run has commands of the joint.
/// Before the first command efforts become NaN.
pub fn sign_by_command(run: &mut Recording, joint: &str) -> bool {
    let Some(command) = run.commands.iter().find(|c| c.joint == joint) else { return false };
    let Some(samples) = run.joints.iter_mut().find(|s| s.name == joint) else { return false };
    let commanded = command.at_samples(&samples.time_s, &samples.position);
    for ((u, c), q) in samples.effort.iter_mut().zip(&commanded).zip(&samples.position) {
        let error = c - q;
        *u = if error.is_nan() { f64::NAN } else { *u * error.signum() };
    }
    true
}
