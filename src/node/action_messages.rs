//! The messages of a ROS 2 action, those of ros2-client, with what they lack.

use serde::{Deserialize, Serialize};

pub(crate) use ros2_client::{
    action::{FeedbackMessage, GetResultRequest, GetResultResponse, SendGoalRequest, SendGoalResponse},
    action_msgs::{
        CancelGoalResponse, CancelGoalResponseEnum, GoalId, GoalInfo, GoalStatus, GoalStatusArray,
        GoalStatusEnum,
    },
    builtin_interfaces::Time as ActionTime,
};

/// Request of the service `cancel_goal`; that of ros2-client has a private field.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct CancelGoalRequest {
    /// A goal, or all goals accepted until a time, or, all zero, every goal.
    pub goal_info: GoalInfo,
}

impl CancelGoalRequest {
    /// Whether a goal is meant.
    #[must_use]
    pub(crate) fn means(&self, goal: &GoalInfo) -> bool {
        let asked = &self.goal_info;
        let is_timed = asked.stamp != ActionTime::ZERO;
        let until = goal.stamp <= asked.stamp;
        match asked.goal_id == GoalId::ZERO {
            true => !is_timed || until,
            false => asked.goal_id == goal.goal_id || (is_timed && until),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::service_server::tests::cdr;
    use rustdds::{RepresentationIdentifier, serialization::deserialize_from_cdr_with_rep_id};

    const ENCODING: RepresentationIdentifier = RepresentationIdentifier::CDR_LE;

    /// The identifier of 16 equal bytes, read as from a client.
    fn goal_id(byte: u8) -> GoalId {
        deserialize_from_cdr_with_rep_id(&[byte; 16], ENCODING).unwrap().0
    }

    #[test]
    fn goals_are_named_by_identifier_by_time_or_all() {
        let goal = GoalInfo { goal_id: goal_id(7), stamp: ActionTime::new(5, 0) };
        let ask = |id, sec| {
            let goal_info = GoalInfo { goal_id: goal_id(id), stamp: ActionTime::new(sec, 0) };
            CancelGoalRequest { goal_info }.means(&goal)
        };
        assert!(ask(0, 0) && ask(7, 0) && ask(0, 5) && ask(1, 6));
        assert!(!ask(1, 0) && !ask(0, 4) && !ask(1, 4));
    }

    #[test]
    fn messages_have_the_bytes_of_their_definitions() {
        // An identifier is 16 bytes without a length, a status one byte, a code one byte.
        assert_eq!(cdr(&goal_id(7)), [7; 16]);
        let goal_info = GoalInfo { goal_id: goal_id(7), stamp: ActionTime::new(5, 6) };
        let info = ([7_u8; 16], 5_i32, 6_u32);
        assert_eq!(cdr(&goal_info), cdr(&info));
        let status = GoalStatus { goal_info: goal_info.clone(), status: GoalStatusEnum::Canceling };
        assert_eq!(cdr(&GoalStatusArray { status_list: vec![status] }), cdr(&vec![(info, 3_i8)]));
        let return_code = CancelGoalResponseEnum::UnknownGoal;
        let canceled = CancelGoalResponse { return_code, goals_canceling: vec![goal_info.clone()] };
        assert_eq!(cdr(&canceled), cdr(&(2_i8, vec![info])));
        let (asked, _) =
            deserialize_from_cdr_with_rep_id::<CancelGoalRequest>(&cdr(&info), ENCODING).unwrap();
        assert_eq!(cdr(&asked), cdr(&info));
        let accepted = SendGoalResponse { accepted: true, stamp: goal_info.stamp };
        assert_eq!(cdr(&accepted), cdr(&(true, 5_i32, 6_u32)));
        let result = GetResultResponse { status: GoalStatusEnum::Succeeded, result: 9_u32 };
        assert_eq!(cdr(&result), cdr(&(4_i8, 9_u32)));
        let feedback = FeedbackMessage { goal_id: goal_id(7), feedback: 9_u32 };
        assert_eq!(cdr(&feedback), cdr(&([7_u8; 16], 9_u32)));
    }
}
