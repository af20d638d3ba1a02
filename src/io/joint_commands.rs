//! Commanded joint positions and velocities, as controllers publish or receive them.

use std::collections::BTreeMap;

use super::ros2msg::{
    JointState,
    joints::{ControllerStateFront, Float64MultiArray, JointTrajectory},
};
use gap::record::command::Command;

/// Message type of a controller's own state.
pub const CONTROLLER_STATE: &str = "control_msgs/msg/JointTrajectoryControllerState";
/// Message type of commands to a trajectory controller.
pub const TRAJECTORY: &str = "trajectory_msgs/msg/JointTrajectory";
/// Message type of commands to a forward controller.
pub const ARRAY: &str = "std_msgs/msg/Float64MultiArray";
/// Most joints of one recording.
pub const MAX_JOINTS: usize = 256;
/// Most points of a trajectory.
const MAX_POINTS: usize = 100_000;

/// Where commands come from, in order of increasing certainty.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Origin {
    /// A trajectory sent to a controller.
    #[default]
    Trajectory,
    /// Joint states on a topic with a command's name.
    Named,
    /// Setpoints reported by a controller.
    Controller,
    /// A topic that the user named.
    Asked,
}

/// Commands of one joint, from the most certain origin.
#[derive(Clone, Debug, Default)]
struct Commanded {
    origin: Origin,
    stamps: Vec<i64>,
    position: Vec<f64>,
    velocity: Vec<f64>,
}

/// Commands of all joints.
#[derive(Clone, Debug, Default)]
pub struct Commands {
    joints: BTreeMap<String, Commanded>,
}

impl Commands {
    /// Adds a command of one joint; stamps must increase.
    fn add(&mut self, joint: &str, origin: Origin, stamp: i64, position: f64, velocity: f64) {
        // Kept joints continue; further ones are left out.
        if self.joints.len() >= MAX_JOINTS && !self.joints.contains_key(joint) {
            return;
        }
        let known = self.joints.entry(joint.to_owned()).or_default();
        if origin > known.origin {
            *known = Commanded { origin, ..Commanded::default() };
        }
        let is_next = known.stamps.last().is_none_or(|last| stamp > *last);
        if origin == known.origin && is_next && (position.is_finite() || velocity.is_finite()) {
            known.stamps.push(stamp);
            known.position.push(position);
            known.velocity.push(velocity);
        }
    }

    /// Adds joint states that are meant as commands.
    pub fn joint_state(&mut self, state: &JointState, stamp: i64, origin: Origin) {
        for (i, name) in state.name.iter().enumerate() {
            let of = |values: &[f64]| values.get(i).copied().unwrap_or(f64::NAN);
            self.add(name, origin, stamp, of(&state.position), of(&state.velocity));
        }
    }

    /// Adds the setpoints of a controller.
    pub fn controller_state(&mut self, state: &ControllerStateFront, stamp: i64) {
        for (i, name) in state.joint_names.iter().enumerate() {
            let of = |values: &[f64]| values.get(i).copied().unwrap_or(f64::NAN);
            let velocity = of(&state.reference.velocities);
            self.add(name, Origin::Controller, stamp, of(&state.reference.positions), velocity);
        }
    }

    /// Adds a trajectory sent to a controller: straight from point to point, from the joint's previous
    /// command on.
    pub fn trajectory(&mut self, trajectory: &JointTrajectory, stamp: i64, asked: bool) {
        let origin = if asked { Origin::Asked } else { Origin::Trajectory };
        for (i, name) in trajectory.joint_names.iter().enumerate() {
            // The rest of an earlier trajectory is replaced.
            if let Some(known) = self.joints.get_mut(name).filter(|k| k.origin == origin) {
                known.cut(stamp);
            }
            for point in trajectory.points.iter().take(MAX_POINTS) {
                let after = point.time_from_start.nanos().unwrap_or(0);
                let position = point.positions.get(i).copied().unwrap_or(f64::NAN);
                self.add(name, origin, stamp.saturating_add(after), position, f64::NAN);
            }
        }
    }

    /// Adds positions of joints in a given order.
    pub fn array(&mut self, array: &Float64MultiArray, joints: &[String], stamp: i64) {
        let values = array.data.iter().skip(array.data_offset as usize);
        for (joint, position) in joints.iter().zip(values) {
            self.add(joint, Origin::Asked, stamp, *position, f64::NAN);
        }
    }

    /// First stamp of all.
    pub fn first(&self) -> Option<i64> {
        self.joints.values().filter_map(|c| c.stamps.first().copied()).min()
    }

    /// The commands, seconds from `first`.
    pub fn since(self, first: i64) -> Vec<Command> {
        let commanded = self.joints.into_iter().filter(|(_, c)| !c.stamps.is_empty());
        commanded
            .map(|(joint, c)| Command {
                joint,
                time_s: c.stamps.iter().map(|n| (n - first) as f64 * 1e-9).collect(),
                position: c.position,
                velocity: c.velocity,
                is_straight: c.origin == Origin::Trajectory,
            })
            .collect()
    }
}

impl Commanded {
    /// Ends the commands at a stamp, at the position between two points that is reached then.
    fn cut(&mut self, stamp: i64) {
        let kept = self.stamps.partition_point(|s| *s <= stamp);
        let on_way = (kept > 0 && kept < self.stamps.len()).then(|| {
            let from = self.stamps[kept - 1];
            let to = self.stamps[kept];
            let share = (stamp - from) as f64 / (to - from) as f64;
            self.position[kept - 1] * (1.0 - share) + self.position[kept] * share
        });
        // Without a motion the joint stays where it was sent.
        let now = on_way.or_else(|| self.position[..kept].last().copied());
        self.stamps.truncate(kept);
        self.position.truncate(kept);
        self.velocity.truncate(kept);
        if let Some(now) = now.filter(|_| self.stamps.last() != Some(&stamp)) {
            self.stamps.push(stamp);
            self.position.push(now);
            self.velocity.push(f64::NAN);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2msg::{Time, joints::TrajectoryPoint};

    fn trajectory(points: &[(i32, f64)]) -> JointTrajectory {
        let point = |(sec, q): &(i32, f64)| TrajectoryPoint {
            positions: vec![*q],
            time_from_start: Time { sec: *sec, nanosec: 0 },
            ..TrajectoryPoint::default()
        };
        JointTrajectory {
            joint_names: vec!["j".into()],
            points: points.iter().map(point).collect(),
            ..JointTrajectory::default()
        }
    }

    #[test]
    fn a_trajectory_replaces_what_was_to_come_of_another() {
        let second = 1_000_000_000;
        let mut commands = Commands::default();
        commands.trajectory(&trajectory(&[(1, 0.0), (3, 2.0), (9, 9.0)]), 0, false);
        commands.trajectory(&trajectory(&[(1, 5.0)]), 2 * second, false);
        let command = &commands.since(0)[0];
        assert_eq!(command.time_s, [1.0, 2.0, 3.0]);
        assert_eq!(command.position, [0.0, 1.0, 5.0]);
        assert!(command.is_straight);
    }

    #[test]
    fn what_a_controller_followed_counts_before_what_it_was_sent() {
        let mut commands = Commands::default();
        commands.trajectory(&trajectory(&[(1, 1.0)]), 0, false);
        let reference = TrajectoryPoint { positions: vec![0.5], ..TrajectoryPoint::default() };
        let state = ControllerStateFront { joint_names: vec!["j".into()], reference, ..Default::default() };
        commands.controller_state(&state, 10);
        commands.trajectory(&trajectory(&[(1, 2.0)]), 20, false);
        assert_eq!(commands.since(0)[0].position, [0.5]);
    }
}
