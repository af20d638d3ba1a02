//! Start of an actuator's fit: a regression on the smoothed motion finds the factors with which the recorded
//! signals move the twin as measured.

use nalgebra::{Matrix4, Vector4};

use super::stretch::SLOW;
use crate::{
    model::{
        actuator::{Actuator, Servo},
        plant::Plant,
    },
    record::{
        command::{EffortUnit, Told, ToldServo},
        drive::{Drive, Hold},
        jitter::reading_noise,
        log::JointLog,
        motion::SmoothMotion,
    },
};

/// Tried delays of a command, seconds.
/// chosen: none to five periods of 50 Hz, the slowest rate of commands in use.
const DELAYS_S: [f64; 11] = [0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09, 0.1];
/// A servo counts as saturated from this share of its limit.
/// chosen: a reading within the interval may lie a step off.
const AT_LIMIT: f64 = 0.98;

/// Why no actuator could be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ActuationError {
    /// The commands do not move the joint.
    #[error(
        "joint '{0}' does not follow what it was commanded to: is it the command of another joint, in \
         another unit, or in other positions than those recorded?"
    )]
    Idle(String),
    /// The efforts do not move the joint.
    #[error(
        "the efforts of joint '{0}' do not move it, whatever their unit: are they those of another joint?"
    )]
    Unrelated(String),
}

/// One interval of the measured motion.
#[derive(Clone, Copy)]
struct Moment {
    log: usize,
    sample: usize,
    /// Effort needed to move the twin this way, N m or N.
    required: f64,
    velocity: f64,
}

/// The plant with its actuator as given or regressed; sets the actuator's efforts in the logs `fitted` and
/// `held_out`. The regression reads the fitted logs only.
///
/// # Errors
/// [`ActuationError`] where the recorded signal moves nothing.
pub fn actuated_plant(
    name: &str,
    plant: &Plant,
    fitted: &mut [JointLog],
    held_out: &mut [JointLog],
    told: &Told,
) -> Result<Plant, ActuationError> {
    let is_servo = fitted.iter().chain(held_out.iter()).any(|l| !l.commanded.is_empty());
    if !is_servo && told.unit != EffortUnit::Unknown {
        let is_calibrated = told.unit == EffortUnit::Calibrated;
        let actuator = Actuator { is_calibrated, ..plant.actuator };
        return Ok(Plant { actuator, ..plant.clone() });
    }
    let moments = moving_moments(plant, fitted);
    if !is_servo {
        let gain = effort_regression(&moments, &|m| fitted[m.log].effort[m.sample], None, None).factor;
        if !(gain.abs() > 0.0) || !gain.is_finite() {
            return Err(ActuationError::Unrelated(name.to_owned()));
        }
        for log in fitted.iter_mut().chain(held_out) {
            log.effort.iter_mut().for_each(|u| *u *= gain);
        }
        let actuator = Actuator { unit: gain, is_found: [true, false], ..Actuator::default() };
        return Ok(Plant { actuator, ..plant.clone() });
    }
    let given = told.servo_of(name).cloned().unwrap_or_default();
    let limit = given.limit.unwrap_or(f64::INFINITY);
    let tried: Vec<f64> = given.delay_s.map_or_else(|| DELAYS_S.to_vec(), |d| vec![d]);
    let best = tried
        .into_iter()
        .map(|delay_s| {
            let errors: Vec<Vec<f64>> = fitted.iter().map(|l| position_errors(l, delay_s)).collect();
            (delay_s, servo_regression(&moments, &errors, &given, limit))
        })
        .min_by(|a, b| a.1.left.total_cmp(&b.1.left));
    let Some((delay_s, Regressed { factor: stiffness, damping, .. })) =
        best.filter(|(_, r)| r.factor > 0.0 && r.factor.is_finite())
    else {
        return Err(ActuationError::Idle(name.to_owned()));
    };
    let actuator = Actuator {
        damping: damping.max(0.0),
        delay_s,
        servo: Some(Servo { stiffness, limit }),
        is_found: [given.stiffness.is_none(), given.damping.is_none()],
        is_late: given.delay_s.is_none(),
        ..Actuator::default()
    };
    for log in fitted.iter_mut().chain(held_out) {
        log.effort = servo_efforts(log, delay_s, stiffness, damping, limit);
    }
    Ok(Plant { actuator, ..plant.clone() })
}

/// Mean effort of a servo from each sample to the next, N m or N.
fn servo_efforts(log: &JointLog, delay_s: f64, stiffness: f64, damping: f64, limit: f64) -> Vec<f64> {
    let errors = position_errors(log, delay_s);
    let mut efforts = Vec::with_capacity(errors.len());
    for (k, error) in errors.iter().enumerate() {
        let next = (k + 1).min(log.time_s.len() - 1);
        let velocity = (log.position[next] - log.position[k]) / (log.time_s[next] - log.time_s[k]).max(1e-9);
        efforts.push((stiffness * error - damping * velocity).clamp(-limit, limit));
    }
    efforts
}

/// Mean position error of a servo from each sample to the next: the command minus the reading halfway.
fn position_errors(log: &JointLog, delay_s: f64) -> Vec<f64> {
    let drive = Drive::with_steps(log, Hold::Zero, delay_s, 1);
    let n = log.time_s.len();
    let means = drive.means_by_sample(log.commanded.last().copied()).into_iter().enumerate();
    means.map(|(k, c)| c - 0.5 * (log.position[k] + log.position[(k + 1).min(n - 1)])).collect()
}

/// Result of a regression.
struct Regressed {
    /// Factor of the signal.
    factor: f64,
    damping: f64,
    /// Root mean square of the required efforts left unexplained.
    left: f64,
}

/// Stiffness and damping of a servo, from the samples below its limit.
fn servo_regression(moments: &[Moment], errors: &[Vec<f64>], given: &ToldServo, limit: f64) -> Regressed {
    let error = |m: &Moment| errors[m.log][m.sample];
    let first = effort_regression(moments, &error, given.stiffness, given.damping);
    if limit.is_infinite() {
        return first;
    }
    let mut free = Vec::new();
    for m in moments {
        let effort = first.factor * error(m) - first.damping * m.velocity;
        if effort.abs() < AT_LIMIT * limit {
            free.push(*m);
        }
    }
    effort_regression(&free, &error, given.stiffness, given.damping)
}

/// Factor of a signal fitting the required efforts, together with damping, Coulomb friction and a constant.
/// Given numbers are kept.
fn effort_regression(
    moments: &[Moment],
    signal: &dyn Fn(&Moment) -> f64,
    factor: Option<f64>,
    damping: Option<f64>,
) -> Regressed {
    let own = |given: Option<f64>, x: f64| if given.is_some() { 0.0 } else { x };
    let mut normal = Matrix4::zeros();
    let mut right = Vector4::zeros();
    let mut square = 0.0;
    for m in moments {
        let signal = signal(m);
        let known = factor.unwrap_or(0.0) * signal - damping.unwrap_or(0.0) * m.velocity;
        let row = Vector4::new(own(factor, signal), own(damping, -m.velocity), -m.velocity.signum(), 1.0);
        let y = m.required - known;
        square += y * y;
        right += y * row;
        normal += row * row.transpose();
    }
    for i in 0..4 {
        // A column of zeros, or one with a given factor, must not make the matrix singular.
        normal[(i, i)] = normal[(i, i)] * (1.0 + 1e-9) + 1e-300;
    }
    let Some(x) = normal.cholesky().map(|c| c.solve(&right)) else {
        return Regressed { factor: f64::NAN, damping: 0.0, left: f64::MAX };
    };
    let left = ((square - x.dot(&right)).max(0.0) / moments.len().max(1) as f64).sqrt();
    Regressed { factor: factor.unwrap_or(x[0]), damping: damping.unwrap_or(x[1]), left }
}

/// The required effort in every interval with motion.
fn moving_moments(plant: &Plant, logs: &[JointLog]) -> Vec<Moment> {
    let noise = reading_noise(logs);
    let mut all = Vec::new();
    for (index, log) in logs.iter().enumerate() {
        let motion = SmoothMotion::of_positions(&log.time_s, &log.position, &noise, &[]);
        let top = motion.state.iter().fold(0.0f64, |m, s| m.max(s[1].abs()));
        for segment in log.gapless_segments(index) {
            for k in segment.start..(segment.start + segment.len).saturating_sub(1) {
                let s = motion.state_at(0.5 * (log.time_s[k] + log.time_s[k + 1]));
                // Near rest static friction takes any value up to its bound.
                if s[1].abs() < SLOW * top {
                    continue;
                }
                let carried = log.carried.get(k);
                let required = plant.inertia_at(carried).0 * s[2] + plant.friction * s[1].signum()
                    - plant.net_effort(carried, s[0], s[1], 0.0);
                all.push(Moment { log: index, sample: k, required, velocity: s[1] });
            }
        }
    }
    all
}
