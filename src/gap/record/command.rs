//! What joints were commanded to, and what is told of the actuators that followed.

use crate::gap::record::{drive::Hold, log::GAP_INTERVALS, tracks::resampled};
use crate::statistics::median;

/// Commands of one joint.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Command {
    /// Joint.
    pub joint: String,
    /// Stamps, seconds from the first of the recording; they rise.
    pub time_s: Vec<f64>,
    /// Positions, rad or m; NaN where none was commanded.
    pub position: Vec<f64>,
    /// Velocities, rad/s or m/s; NaN where none was commanded.
    pub velocity: Vec<f64>,
    /// The command runs straight from stamp to stamp; else it holds until the next one.
    pub is_straight: bool,
}

impl Command {
    /// Commanded position from each sample of the joint to the next, in the mean; NaN before the first command.
    #[must_use]
    pub fn at_samples(&self, time_s: &[f64], position: &[f64]) -> Vec<f64> {
        let mut latest = f64::NEG_INFINITY;
        // Stamps that run backward are left out of the log; here they repeat.
        let rising = time_s.iter().map(|t| {
            latest = latest.max(*t);
            latest
        });
        let stamps: Vec<f64> = rising.collect();
        let first = self.time_s.first().copied().unwrap_or(0.0);
        let began = stamps.iter().zip(position).find(|(t, q)| **t >= first && q.is_finite());
        self.at_stamps(&stamps, began.map_or(0.0, |(_, q)| *q))
    }

    /// The same by stamps. Velocities alone add up from `start`, where the joint was at the first of them.
    fn at_stamps(&self, stamps: &[f64], start: f64) -> Vec<f64> {
        let positions = if self.position.iter().any(|q| q.is_finite()) {
            let known: Vec<usize> =
                (0..self.time_s.len()).filter(|k| self.position[*k].is_finite()).collect();
            let of = |values: &[f64]| known.iter().map(|k| values[*k]).collect::<Vec<f64>>();
            (of(&self.time_s), of(&self.position), self.is_straight)
        } else {
            (self.time_s.clone(), self.integrated(start), true)
        };
        let (time_s, position, is_straight) = positions;
        held(&time_s, &position, is_straight, stamps)
    }

    /// Positions that held velocities add up to.
    fn integrated(&self, start: f64) -> Vec<f64> {
        let mut at = start;
        let mut last = (self.time_s.first().copied().unwrap_or(0.0), 0.0);
        let add = |(t, v): (&f64, &f64)| {
            at += last.1 * (t - last.0);
            last = (*t, if v.is_finite() { *v } else { 0.0 });
            at
        };
        self.time_s.iter().zip(&self.velocity).map(add).collect()
    }
}

/// A command brought to stamps. It stands until the next one comes, however long that takes.
fn held(time_s: &[f64], position: &[f64], is_straight: bool, stamps: &[f64]) -> Vec<f64> {
    let (Some(first), Some(last)) = (time_s.first(), time_s.last()) else {
        return vec![f64::NAN; stamps.len()];
    };
    let end = stamps.last().copied().unwrap_or(*last).max(*last);
    let usual = median(stamps.windows(2).map(|w| w[1] - w[0]).collect()).unwrap_or(0.0);
    // `resampled` takes long waits for gaps: the samples in between repeat the command.
    let wait = usual.max(1e-6) * (GAP_INTERVALS - 1.0).max(1.0);
    let (mut times, mut values) = (Vec::new(), Vec::new());
    for k in 0..time_s.len() {
        let next = time_s.get(k + 1).copied().unwrap_or(end);
        let after = position.get(k + 1).copied().unwrap_or(position[k]);
        let parts = (((next - time_s[k]) / wait).ceil().max(1.0) as usize).min(MAX_REPEATS);
        for part in 0..parts {
            let share = part as f64 / parts as f64;
            times.push(time_s[k] + share * (next - time_s[k]));
            values.push(if is_straight { position[k] + share * (after - position[k]) } else { position[k] });
        }
    }
    let hold = if is_straight { Hold::Linear } else { Hold::Zero };
    let before = |(t, value): (&f64, f64)| if t + 1e-9 < *first { f64::NAN } else { value };
    stamps.iter().zip(resampled(&times, &values, stamps, hold)).map(before).collect()
}

/// Most samples that a standing command is repeated by.
const MAX_REPEATS: usize = 1_000_000;

/// What is told of actuators; what is not is found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Told {
    /// Of what recorded efforts are.
    pub unit: EffortUnit,
    /// Of servos: those of single joints, and those of all others.
    pub servos: Vec<ToldServo>,
    /// Topics of commands, each with the joints of its values where messages do not name them.
    pub commands: Vec<(String, Vec<String>)>,
}

impl Told {
    /// What is told of the servo of a joint.
    #[must_use]
    pub fn servo(&self, joint: &str) -> Option<&ToldServo> {
        let own = self.servos.iter().find(|s| s.joint.as_deref() == Some(joint));
        own.or_else(|| self.servos.iter().find(|s| s.joint.is_none()))
    }
}

/// What recorded efforts are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum EffortUnit {
    /// N m or N.
    #[default]
    Newton,
    /// So many N m or N each.
    Factor(f64),
    /// Currents, duty cycles or counts: the factor is found.
    Unknown,
}

/// A position controller between commands and joint, as far as it is told.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ToldServo {
    /// Joint; `None` for all that have no own.
    pub joint: Option<String>,
    /// N m/rad or N/m.
    pub stiffness: Option<f64>,
    /// N m s/rad or N s/m.
    pub damping: Option<f64>,
    /// Largest effort, N m or N.
    pub limit: Option<f64>,
    /// Time from a command to its effect, seconds.
    pub delay_s: Option<f64>,
}
