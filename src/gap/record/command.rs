//! Commands of joints, and known properties of their actuators.

use crate::record::drive::{Interpolation, Signal};

/// Commands of one joint.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Command {
    /// Joint.
    pub joint: String,
    /// Stamps in increasing order, seconds from the start of the recording.
    pub time_s: Vec<f64>,
    /// Positions, rad or m; NaN where none was commanded.
    pub position: Vec<f64>,
    /// Velocities, rad/s or m/s; NaN where none was commanded.
    pub velocity: Vec<f64>,
    /// Whether the command is linear between stamps; else it holds until the next stamp.
    pub is_straight: bool,
}

impl Command {
    /// Mean commanded position from each sample of the joint to the next; NaN before the first command.
    #[must_use]
    pub fn at_samples(&self, time_s: &[f64], position: &[f64]) -> Vec<f64> {
        let mut latest = f64::NEG_INFINITY;
        // Decreasing stamps are left out of the log; here they repeat the last one.
        let rising = time_s.iter().map(|t| {
            latest = latest.max(*t);
            latest
        });
        let stamps: Vec<f64> = rising.collect();
        let first = self.time_s.first().copied().unwrap_or(0.0);
        let began = stamps.iter().zip(position).find(|(t, q)| **t >= first && q.is_finite());
        self.at_stamps(&stamps, began.map_or(0.0, |(_, q)| *q))
    }

    /// The same at given stamps. Commanded velocities are integrated from `start`, the joint's position at
    /// the first one.
    fn at_stamps(&self, stamps: &[f64], start: f64) -> Vec<f64> {
        if !self.position.iter().any(|q| q.is_finite()) {
            return held_means(&self.time_s, &self.integrated_positions(start), true, stamps);
        }
        let mut time_s = Vec::new();
        let mut position = Vec::new();
        for (t, q) in self.time_s.iter().zip(&self.position).filter(|(_, q)| q.is_finite()) {
            time_s.push(*t);
            position.push(*q);
        }
        held_means(&time_s, &position, self.is_straight, stamps)
    }

    /// Integrals of the held velocities.
    fn integrated_positions(&self, start: f64) -> Vec<f64> {
        let mut at = start;
        let mut last = (self.time_s.first().copied().unwrap_or(0.0), 0.0);
        let mut positions = Vec::with_capacity(self.time_s.len());
        for (t, v) in self.time_s.iter().zip(&self.velocity) {
            at += last.1 * (t - last.0);
            last = (*t, if v.is_finite() { *v } else { 0.0 });
            positions.push(at);
        }
        positions
    }
}

/// Mean of a command from each stamp to the next; a command holds until the next one, however late. Stamps
/// must not decrease.
fn held_means(time_s: &[f64], position: &[f64], is_straight: bool, stamps: &[f64]) -> Vec<f64> {
    let Some(first) = time_s.first() else { return vec![f64::NAN; stamps.len()] };
    let between = if is_straight { Interpolation::Linear } else { Interpolation::Held };
    let mut signal = Signal::new(time_s, position, between);
    let mut here = signal.value_and_integral(stamps.first().copied().unwrap_or(*first));
    let mut means = Vec::with_capacity(stamps.len());
    for (k, t) in stamps.iter().enumerate() {
        let width = stamps.get(k + 1).map_or(0.0, |next| next - t);
        let next = signal.value_and_integral(t + width);
        let mean = if width > 0.0 { (next.1 - here.1) / width } else { here.0 };
        here = next;
        means.push(if t + 1e-9 < *first { f64::NAN } else { mean });
    }
    means
}

/// Known properties of actuators; unknown ones are fitted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Told {
    /// Unit of recorded efforts.
    pub unit: EffortUnit,
    /// Known servos: those of single joints, and one for all others.
    pub servos: Vec<ToldServo>,
}

impl Told {
    /// N m or N per recorded unit; 1 if it is unknown.
    #[must_use]
    pub fn effort_factor(&self) -> f64 {
        if let EffortUnit::Factor(factor) = self.unit { factor } else { 1.0 }
    }

    /// The known servo of a joint.
    #[must_use]
    pub fn servo_of(&self, joint: &str) -> Option<&ToldServo> {
        let own = self.servos.iter().find(|s| s.joint.as_deref() == Some(joint));
        own.or_else(|| self.servos.iter().find(|s| s.joint.is_none()))
    }
}

/// Unit of recorded efforts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum EffortUnit {
    /// N m or N, as ROS has it; nobody said how well they are measured.
    #[default]
    Assumed,
    /// N m or N of a calibrated sensor: no gain is looked for.
    Calibrated,
    /// This many N m or N per unit.
    Factor(f64),
    /// Unknown, as for currents, duty cycles or counts: the factor is fitted.
    Unknown,
}

/// Known properties of a position controller.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ToldServo {
    /// Name of the joint; `None` for all joints without an entry of their own.
    pub joint: Option<String>,
    /// Stiffness, N m/rad or N/m.
    pub stiffness: Option<f64>,
    /// Damping, N m s/rad or N s/m.
    pub damping: Option<f64>,
    /// Largest effort, N m or N.
    pub limit: Option<f64>,
    /// Time from a command to its effect, seconds.
    pub delay_s: Option<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_stands_until_the_next_one_and_a_trajectory_runs_straight() {
        let mut command = Command {
            time_s: vec![0.1, 0.3, 5.0],
            position: vec![1.0, 2.0, 4.0],
            velocity: vec![f64::NAN; 3],
            ..Command::default()
        };
        let stamps = [0.0, 0.2, 0.4, 2.4, 2.5, 6.0];
        let near = |found: Vec<f64>, wanted: [f64; 6]| {
            assert!(found[0].is_nan());
            assert!(found.iter().zip(wanted).skip(1).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
        };
        let last = (2.0 * 2.5 + 4.0) / 3.5;
        near(command.at_samples(&stamps, &[0.0; 6]), [0.0, 1.5, 2.0, 2.0, last, 4.0]);
        command.is_straight = true;
        let at = |t: f64| 2.0 + 2.0 * (t - 0.3) / 4.7;
        let last = (0.5 * (at(2.5) + 4.0) * 2.5 + 4.0) / 3.5;
        let second = 0.5 * (0.5 * (1.5 + 2.0) + 0.5 * (2.0 + at(0.4)));
        near(command.at_samples(&stamps, &[0.0; 6]), [0.0, second, at(1.4), at(2.45), last, 4.0]);
    }

    #[test]
    fn velocities_add_up_from_where_the_joint_was() {
        let command = Command {
            time_s: vec![0.0, 1.0, 2.0],
            position: vec![f64::NAN; 3],
            velocity: vec![1.0, -1.0, 0.0],
            ..Command::default()
        };
        let found = command.at_samples(&[0.0, 1.0, 2.0, 3.0], &[0.5, 1.5, 0.5, 0.5]);
        assert_eq!(found, [1.0, 1.0, 0.5, 0.5]);
    }
}
