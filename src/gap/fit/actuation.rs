//! Where the fit of an actuator begins: what recorded signals must be multiplied by to move the twin as it
//! was measured, by a regression on the smoothed motion.

use nalgebra::{DMatrix, DVector};

use crate::gap::{
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

/// Delays of a command that are tried, seconds.
/// derived: none to five periods of 50 Hz, the slowest rate of commands in use.
const DELAYS_S: [f64; 11] = [0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09, 0.1];
/// Share of its limit from which a servo is taken to be at it.
/// derived: a reading within the interval may lie a step off.
const AT_LIMIT: f64 = 0.98;

/// Why there is no actuator.
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
        "the efforts of joint '{0}' do not move it, whatever their unit: are they those of another joint, or \
         of the other sign?"
    )]
    Unrelated(String),
}

/// One interval of the measured motion.
struct Moment {
    log: usize,
    sample: usize,
    /// Effort that moves the twin so.
    required: f64,
    velocity: f64,
}

/// The plant with its actuator as far as it is given or a regression has it, and logs with the efforts that
/// it makes, those of `fitted` and `held_out`. The regression reads the fitted ones.
///
/// # Errors
/// [`ActuationError`] where the recorded signal moves nothing.
pub fn actuated(
    name: &str,
    plant: &Plant,
    fitted: &mut [JointLog],
    held_out: &mut [JointLog],
    told: &Told,
) -> Result<Plant, ActuationError> {
    let is_servo = fitted.iter().chain(held_out.iter()).any(|l| !l.commanded.is_empty());
    let logs = || fitted.iter();
    if !is_servo && told.unit != EffortUnit::Unknown {
        return Ok(plant.clone());
    }
    let moments = moments(plant, fitted);
    if !is_servo {
        let signal = |m: &Moment| fitted[m.log].effort[m.sample];
        let (gain, _) = regressed(&moments, &signal, None, None);
        if !(gain.abs() > 0.0) || !gain.is_finite() {
            return Err(ActuationError::Unrelated(name.to_owned()));
        }
        for log in fitted.iter_mut().chain(held_out) {
            log.effort.iter_mut().for_each(|u| *u *= gain);
        }
        let actuator = Actuator { unit: gain, is_found: [true, false], ..Actuator::default() };
        return Ok(Plant { actuator, ..plant.clone() });
    }
    let given = told.servo(name).cloned().unwrap_or_default();
    let limit = given.limit.unwrap_or(f64::INFINITY);
    let tried: Vec<f64> = given.delay_s.map_or_else(|| DELAYS_S.to_vec(), |d| vec![d]);
    let best = tried
        .into_iter()
        .map(|delay_s| {
            let errors: Vec<Vec<f64>> = logs().map(|l| position_errors(l, delay_s)).collect();
            let (stiffness, damping, left) = servo(&moments, &errors, &given, limit);
            (left, delay_s, stiffness, damping)
        })
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((_, delay_s, stiffness, damping)) = best.filter(|b| b.2 > 0.0 && b.2.is_finite()) else {
        return Err(ActuationError::Idle(name.to_owned()));
    };
    let actuator = Actuator {
        gain: 1.0,
        damping: damping.max(0.0),
        delay_s,
        servo: Some(Servo { stiffness, limit }),
        unit: 1.0,
        is_found: [given.stiffness.is_none(), given.damping.is_none()],
        is_late: given.delay_s.is_none(),
    };
    for log in fitted.iter_mut().chain(held_out) {
        let errors = position_errors(log, delay_s);
        let velocity = |k: usize| {
            let next = (k + 1).min(log.time_s.len() - 1);
            (log.position[next] - log.position[k]) / (log.time_s[next] - log.time_s[k]).max(1e-9)
        };
        let act = |(k, e): (usize, &f64)| (stiffness * e - damping * velocity(k)).clamp(-limit, limit);
        log.effort = errors.iter().enumerate().map(act).collect();
    }
    Ok(Plant { actuator, ..plant.clone() })
}

/// What a servo sees from each sample to the next: the command less the reading in the middle.
fn position_errors(log: &JointLog, delay_s: f64) -> Vec<f64> {
    let drive = Drive::with_steps(log, Hold::Zero, delay_s, 1);
    let n = log.time_s.len();
    let reading = |k: usize| 0.5 * (log.position[k] + log.position[(k + 1).min(n - 1)]);
    drive.means(log.commanded.last().copied()).into_iter().enumerate().map(|(k, c)| c - reading(k)).collect()
}

/// Stiffness, damping and what they leave of the required efforts, without the samples at the limit.
fn servo(moments: &[Moment], errors: &[Vec<f64>], given: &ToldServo, limit: f64) -> (f64, f64, f64) {
    let error = |m: &Moment| errors[m.log][m.sample];
    let fitted = |of: &[Moment]| {
        let (stiffness, rest) = regressed(of, &error, given.stiffness, given.damping);
        (stiffness, rest[0], rest[2])
    };
    let first = fitted(moments);
    if limit.is_infinite() {
        return first;
    }
    let stiffness = given.stiffness.unwrap_or(first.0);
    let is_free = |m: &&Moment| (stiffness * error(m) - first.1 * m.velocity).abs() < AT_LIMIT * limit;
    let free: Vec<Moment> = moments.iter().filter(is_free).map(|m| Moment { ..*m }).collect();
    fitted(&free)
}

/// Factor of a signal that makes the required efforts, beside damping, Coulomb friction and a constant; with
/// the damping, the constant and the root mean square that is left. What is given stays.
fn regressed(
    moments: &[Moment],
    signal: &dyn Fn(&Moment) -> f64,
    factor: Option<f64>,
    damping: Option<f64>,
) -> (f64, [f64; 3]) {
    let columns = |m: &Moment| {
        let own = |given: Option<f64>, x: f64| if given.is_some() { 0.0 } else { x };
        let signal = signal(m);
        let known = factor.unwrap_or(0.0) * signal - damping.unwrap_or(0.0) * m.velocity;
        let row = [own(factor, signal), own(damping, -m.velocity), -m.velocity.signum(), 1.0];
        (row, m.required - known)
    };
    let (mut normal, mut right) = (DMatrix::<f64>::zeros(4, 4), DVector::<f64>::zeros(4));
    let mut square = 0.0;
    for m in moments {
        let (row, y) = columns(m);
        square += y * y;
        for i in 0..4 {
            right[i] += row[i] * y;
            for j in 0..4 {
                normal[(i, j)] += row[i] * row[j];
            }
        }
    }
    for i in 0..4 {
        // A column that is given, or zero throughout, must not stop the solution.
        normal[(i, i)] = normal[(i, i)] * (1.0 + 1e-9) + 1e-300;
    }
    let Some(x) = normal.cholesky().map(|c| c.solve(&right)) else { return (f64::NAN, [0.0, 0.0, f64::MAX]) };
    let left = ((square - x.dot(&right)).max(0.0) / moments.len().max(1) as f64).sqrt();
    (factor.unwrap_or(x[0]), [damping.unwrap_or(x[1]), x[3], left])
}

/// The required effort of every interval in which the joint moves.
fn moments(plant: &Plant, logs: &[JointLog]) -> Vec<Moment> {
    let noise = reading_noise(logs);
    let mut all = Vec::new();
    for (index, log) in logs.iter().enumerate() {
        let motion = SmoothMotion::of(&log.time_s, &log.position, &noise, &[]);
        let top = motion.state.iter().fold(0.0f64, |m, s| m.max(s[1].abs()));
        for segment in log.segments(index) {
            for k in segment.start..(segment.start + segment.len).saturating_sub(1) {
                let s = motion.at(0.5 * (log.time_s[k] + log.time_s[k + 1]));
                // Where friction may hold the joint it takes any value up to its bound.
                if s[1].abs() < SLOW * top {
                    continue;
                }
                let carried = log.carried.get(k);
                let (inertia, rate) = plant.inertia_at(carried);
                let required = inertia * s[2]
                    + (plant.damping + rate) * s[1]
                    + plant.friction * s[1].signum()
                    + plant.load_at(carried, s[0]).0;
                all.push(Moment { log: index, sample: k, required, velocity: s[1] });
            }
        }
    }
    all
}

/// Share of the top speed below which friction may hold the joint.
/// derived: a smoothed motion is never exactly at rest; where efforts are regressed alone, little is lost.
const SLOW: f64 = 0.03;
