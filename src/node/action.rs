//! Actions of the node: each runs one goal at a time, with feedback and cancellation.

use std::{collections::VecDeque, sync::Arc};

use super::{
    action_messages::{
        CancelGoalRequest, CancelGoalResponse, CancelGoalResponseEnum, FeedbackMessage, GetResultRequest,
        GetResultResponse, GoalId, GoalInfo, GoalStatus, GoalStatusArray, GoalStatusEnum, SendGoalRequest,
        SendGoalResponse,
    },
    clock::NodeClock,
    error::NodeError,
    job::{Finished, Job, News, Work},
    participant::{Participant, Publisher, latched_profile, reliable_profile},
    service_server::{RequestId, ServiceServer},
};

/// Queue length for feedback.
const DEPTH: usize = 10;
/// Ended goals whose results can be asked for.
/// chosen: a goal takes minutes, so they cover hours
const REMEMBERED: usize = 16;
/// Requests for the result of one goal that wait for its end.
/// chosen: one client asks once; the bound is against floods
const WAITING: usize = 64;

type Goals<J> = ServiceServer<SendGoalRequest<<J as Job>::Goal>, SendGoalResponse>;
type Results<J> = ServiceServer<GetResultRequest, GetResultResponse<<J as Job>::Result>>;
type Cancels = ServiceServer<CancelGoalRequest, CancelGoalResponse>;

/// An action as clients see it.
struct ActionServer<J: Job> {
    job: Arc<J>,
    clock: Arc<NodeClock>,
    goals: Goals<J>,
    cancels: Cancels,
    results: Results<J>,
    feedback: Publisher<FeedbackMessage<J::Feedback>>,
    status: Publisher<GoalStatusArray>,
    running: Option<Running<J>>,
    ended: VecDeque<Ended<J>>,
}

/// A goal whose work is not done.
struct Running<J: Job> {
    goal: GoalInfo,
    is_canceling: bool,
    work: Work<J::Result, J::Feedback>,
    waiting: Vec<RequestId>,
}

/// A goal whose result can be asked for.
struct Ended<J: Job> {
    goal: GoalInfo,
    status: GoalStatusEnum,
    result: J::Result,
}

/// Offers an action.
///
/// # Errors
/// If the name is invalid or the network reports an error.
pub(crate) fn offer_action<J: Job>(
    participant: &mut Participant,
    clock: &Arc<NodeClock>,
    job: Arc<J>,
) -> Result<(), NodeError> {
    let name = |part: &str| format!("{}/_action/{part}", J::NAME);
    let part_type = |part: &str| format!("artitwin_msgs/action/{}_{part}", J::TYPE);
    // A client waits for the services; the topics must be there by then.
    let feedback_type = part_type("FeedbackMessage");
    let feedback = reliable_profile(DEPTH);
    let feedback = participant.create_publisher_of_type(&name("feedback"), &feedback_type, &feedback)?;
    // rcl_action latches the status as well, so that later clients see the goal.
    let latched = latched_profile(1);
    let status =
        participant.create_publisher_of_type(&name("status"), "action_msgs/msg/GoalStatusArray", &latched)?;
    let server = ActionServer {
        results: ServiceServer::offer(participant, &name("get_result"), &part_type("GetResult"))?,
        cancels: ServiceServer::offer(participant, &name("cancel_goal"), "action_msgs/srv/CancelGoal")?,
        goals: ServiceServer::offer(participant, &name("send_goal"), &part_type("SendGoal"))?,
        job,
        clock: Arc::clone(clock),
        feedback,
        status,
        running: None,
        ended: VecDeque::new(),
    };
    tokio::spawn(server.serve_goals());
    Ok(())
}

/// The next report of the work, if there is any.
async fn next_news<J: Job>(running: &mut Option<Running<J>>) -> News<J::Result, J::Feedback> {
    match running {
        Some(running) => running.work.next().await,
        None => std::future::pending().await,
    }
}

impl<J: Job> ActionServer<J> {
    async fn serve_goals(mut self) {
        loop {
            tokio::select! {
                (id, request) = self.goals.next_request() => self.take_goal(id, &request).await,
                (id, request) = self.cancels.next_request() => self.cancel_goals(id, request).await,
                (id, request) = self.results.next_request() => self.tell_result(id, request.goal_id),
                news = next_news(&mut self.running) => match news {
                    News::Feedback(feedback) => self.publish_feedback(feedback).await,
                    News::Ended(finished) => self.end_goal(finished).await,
                },
            }
        }
    }

    async fn take_goal(&mut self, id: RequestId, request: &SendGoalRequest<J::Goal>) {
        let goal = GoalInfo { goal_id: request.goal_id, stamp: self.clock.message_stamp_now() };
        let is_known = self.ended.iter().any(|e| e.goal.goal_id == goal.goal_id);
        if self.running.is_some() || is_known {
            log::warn!("{}: a goal was rejected, as another runs or had its identifier", J::NAME);
            self.goals.send_reply(id, &SendGoalResponse { accepted: false, stamp: goal.stamp });
            return;
        }
        self.goals.send_reply(id, &SendGoalResponse { accepted: true, stamp: goal.stamp });
        match self.job.begin_work(&request.goal) {
            Ok(work) => self.running = Some(Running { goal, is_canceling: false, work, waiting: Vec::new() }),
            // The goal is already accepted, so an error must reach the client as a result.
            Err(error) => self.remember_end(goal, Finished::Failed(error.to_string())),
        }
        self.publish_status().await;
    }

    async fn cancel_goals(&mut self, id: RequestId, request: CancelGoalRequest) {
        let mut goals_canceling = Vec::new();
        if let Some(running) = self.running.as_mut().filter(|r| request.means(&r.goal)) {
            // The work ends after its current step.
            running.work.cancel();
            running.is_canceling = true;
            goals_canceling.push(running.goal.clone());
        }
        let asked = request.goal_info.goal_id;
        let return_code = match () {
            () if !goals_canceling.is_empty() => CancelGoalResponseEnum::None,
            () if self.ended.iter().any(|e| e.goal.goal_id == asked) => {
                CancelGoalResponseEnum::GoalTerminated
            }
            () if asked != GoalId::ZERO => CancelGoalResponseEnum::UnknownGoal,
            () => CancelGoalResponseEnum::Rejected,
        };
        self.cancels.send_reply(id, &CancelGoalResponse { return_code, goals_canceling });
        self.publish_status().await;
    }

    /// Replies with the result of a goal, or notes who waits for it.
    fn tell_result(&mut self, id: RequestId, goal_id: GoalId) {
        if let Some(running) = self.running.as_mut().filter(|r| r.goal.goal_id == goal_id) {
            if running.waiting.len() < WAITING {
                running.waiting.push(id);
            }
            return;
        }
        let ended = self.ended.iter().find(|e| e.goal.goal_id == goal_id);
        let response = match ended {
            Some(ended) => GetResultResponse { status: ended.status, result: ended.result.clone() },
            None => GetResultResponse { status: GoalStatusEnum::Unknown, result: J::Result::default() },
        };
        self.results.send_reply(id, &response);
    }

    async fn end_goal(&mut self, finished: Finished<J::Result>) {
        let Some(running) = self.running.take() else { return };
        let goal_id = running.goal.goal_id;
        self.remember_end(running.goal, finished);
        for id in running.waiting {
            self.tell_result(id, goal_id);
        }
        self.publish_status().await;
    }

    fn remember_end(&mut self, goal: GoalInfo, finished: Finished<J::Result>) {
        let (status, result) = goal_outcome::<J>(finished);
        self.ended.push_back(Ended { goal, status, result });
        if self.ended.len() > REMEMBERED {
            self.ended.pop_front();
        }
    }

    async fn publish_feedback(&self, feedback: J::Feedback) {
        let Some(running) = &self.running else { return };
        let message = FeedbackMessage { goal_id: running.goal.goal_id, feedback };
        if self.feedback.async_publish(message).await.is_err() {
            log::debug!("{}: feedback could not be published", J::NAME);
        }
    }

    async fn publish_status(&self) {
        let mut status_list: Vec<GoalStatus> =
            self.ended.iter().map(|e| GoalStatus { goal_info: e.goal.clone(), status: e.status }).collect();
        if let Some(running) = &self.running {
            let status =
                if running.is_canceling { GoalStatusEnum::Canceling } else { GoalStatusEnum::Executing };
            status_list.push(GoalStatus { goal_info: running.goal.clone(), status });
        }
        if self.status.async_publish(GoalStatusArray { status_list }).await.is_err() {
            log::debug!("{}: the status could not be published", J::NAME);
        }
    }
}

fn goal_outcome<J: Job>(finished: Finished<J::Result>) -> (GoalStatusEnum, J::Result) {
    match finished {
        Finished::Done(result) => (GoalStatusEnum::Succeeded, result),
        Finished::Canceled => {
            log::info!("{}: canceled", J::NAME);
            (GoalStatusEnum::Canceled, J::failed_result("canceled".to_owned()))
        }
        Finished::Failed(message) => {
            log::warn!("{}: {message}", J::NAME);
            (GoalStatusEnum::Aborted, J::failed_result(message))
        }
    }
}
