//! The messages of a ROS 2 action: its three services, its feedback and its status (`action_msgs`).

use serde::{Deserialize, Serialize};

use io::ros2msg::Time;

/// Identifier of a goal (`unique_identifier_msgs/msg/UUID`); all zero where none is meant.
pub(crate) type GoalId = [u8; 16];

/// `action_msgs/msg/GoalInfo`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct GoalInfo {
    /// The goal.
    pub goal_id: GoalId,
    /// When it was accepted.
    pub stamp: Time,
}

/// `action_msgs/msg/GoalStatus`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct GoalStatus {
    /// The goal.
    pub goal_info: GoalInfo,
    /// One of [`status`].
    pub status: i8,
}

/// Values of `GoalStatus.status`.
pub(crate) mod status {
    pub(crate) const UNKNOWN: i8 = 0;
    pub(crate) const EXECUTING: i8 = 2;
    pub(crate) const CANCELING: i8 = 3;
    pub(crate) const SUCCEEDED: i8 = 4;
    pub(crate) const CANCELED: i8 = 5;
    pub(crate) const ABORTED: i8 = 6;
}

/// `action_msgs/msg/GoalStatusArray`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct GoalStatusArray {
    /// All goals that are remembered.
    pub status_list: Vec<GoalStatus>,
}

/// Request of the service `send_goal`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub(crate) struct SendGoalRequest<G> {
    /// The goal's identifier, chosen by the client.
    pub goal_id: GoalId,
    /// What is asked for.
    pub goal: G,
}

/// Response of the service `send_goal`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct SendGoalResponse {
    /// Whether the goal runs.
    pub accepted: bool,
    /// When it was accepted.
    pub stamp: Time,
}

/// Request of the service `get_result`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub(crate) struct GetResultRequest {
    /// The goal.
    pub goal_id: GoalId,
}

/// Response of the service `get_result`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct GetResultResponse<R> {
    /// How it ended, one of [`status`].
    pub status: i8,
    /// The result.
    pub result: R,
}

/// Message of the topic `feedback`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct FeedbackMessage<F> {
    /// The goal.
    pub goal_id: GoalId,
    /// How far it is.
    pub feedback: F,
}

/// Request of the service `cancel_goal`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub(crate) struct CancelGoalRequest {
    /// A goal, or all goals accepted until a time, or, all zero, every goal.
    pub goal_info: GoalInfo,
}

/// Response of the service `cancel_goal`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct CancelGoalResponse {
    /// One of [`cancel`].
    pub return_code: i8,
    /// Goals that will be canceled.
    pub goals_canceling: Vec<GoalInfo>,
}

/// Values of `CancelGoalResponse.return_code`.
pub(crate) mod cancel {
    pub(crate) const NONE: i8 = 0;
    pub(crate) const REJECTED: i8 = 1;
    pub(crate) const UNKNOWN_GOAL: i8 = 2;
    pub(crate) const GOAL_ENDED: i8 = 3;
}

impl CancelGoalRequest {
    /// Whether a goal is meant.
    #[must_use]
    pub(crate) fn means(&self, goal: &GoalInfo) -> bool {
        let asked = &self.goal_info;
        let is_timed = asked.stamp != Time::default();
        let until = (goal.stamp.sec, goal.stamp.nanosec) <= (asked.stamp.sec, asked.stamp.nanosec);
        match asked.goal_id == GoalId::default() {
            true => !is_timed || until,
            false => asked.goal_id == goal.goal_id || (is_timed && until),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goals_are_named_by_identifier_by_time_or_all() {
        let goal = GoalInfo { goal_id: [7; 16], stamp: Time { sec: 5, nanosec: 0 } };
        let ask = |goal_id, sec| {
            CancelGoalRequest { goal_info: GoalInfo { goal_id, stamp: Time { sec, nanosec: 0 } } }
                .means(&goal)
        };
        assert!(ask([0; 16], 0) && ask([7; 16], 0) && ask([0; 16], 5) && ask([1; 16], 6));
        assert!(!ask([1; 16], 0) && !ask([0; 16], 4) && !ask([1; 16], 4));
    }
}
