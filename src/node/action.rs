//! Actions of the node: each runs one goal at a time, with feedback and cancellation.

use std::{sync::Arc, time::Duration};

use ros2_client::{
    ActionTypeName, ServiceMapping,
    action::{ActionServerQosPolicies, AsyncActionServer, ExecutingGoalHandle, GoalEndStatus, NewGoalHandle},
};

use super::{
    error::NodeError,
    job::{Finished, Job, News},
    participant::{Participant, latched_profile, reliable_profile},
};

/// Queue length for requests.
const DEPTH: usize = 10;
/// Longest time for a client to fetch its result.
const RESULT_WAIT: Duration = Duration::from_secs(900);

type Server<J> = AsyncActionServer<<J as Job>::Goal, <J as Job>::Result, <J as Job>::Feedback>;
type Goal<J> = ExecutingGoalHandle<<J as Job>::Goal>;

/// Offers an action.
///
/// # Errors
/// If the name is invalid or the network reports an error.
pub(crate) fn offer_action<J: Job>(
    participant: &mut Participant,
    mapping: ServiceMapping,
    job: Arc<J>,
) -> Result<(), NodeError> {
    let name = participant.library_name(J::NAME)?;
    let qos = ActionServerQosPolicies {
        goal_service: reliable_profile(DEPTH),
        result_service: reliable_profile(DEPTH),
        cancel_service: reliable_profile(DEPTH),
        feedback_publisher: reliable_profile(DEPTH),
        // rcl_action latches the status as well, so that later clients see the goal.
        status_publisher: latched_profile(1),
    };
    let server = participant
        .node()
        .create_action_server(mapping, &name, &ActionTypeName::new("artitwin_msgs", J::TYPE), qos)
        .map_err(|e| NodeError::network_error(&format!("offering {}", J::NAME), e))?;
    // Not in the spinner: a goal takes minutes, while parameters and discovery must go on.
    tokio::spawn(serve_goals(AsyncActionServer::new(server), job));
    Ok(())
}

/// A finished goal whose result waits for the client's request.
struct Ended<J: Job> {
    goal: Goal<J>,
    status: GoalEndStatus,
    result: J::Result,
    until: tokio::time::Instant,
}

async fn serve_goals<J: Job>(server: Server<J>, job: Arc<J>) {
    let mut ended: Option<Ended<J>> = None;
    loop {
        tokio::select! {
            new = server.receive_new_goal() => match new {
                Ok(new) => {
                    // Only one result waits; a client that sends a new goal no longer wants the old result.
                    if let Some(old) = ended.take() {
                        // Nobody requested it; otherwise the server would wait forever.
                        server.abort_executing_goal(old.goal).await.ok();
                    }
                    // Copied, since accepting consumes the handle.
                    let Some(request) = server.get_new_goal(new.clone()) else { continue };
                    match accept_new_goal::<J>(&server, new).await {
                        Ok(goal) => {
                            let (status, result) = execute_goal(&server, &job, &goal, request).await;
                            let until = tokio::time::Instant::now() + RESULT_WAIT;
                            ended = Some(Ended { goal, status, result, until });
                        }
                        Err(error) => log::warn!("{}: the goal was not accepted: {error}", J::NAME),
                    }
                }
                Err(error) => log::debug!("{}: a goal could not be read: {error}", J::NAME),
            },
            cancel = server.receive_cancel_request() => {
                // Nothing is running, so nothing is canceled.
                if let Ok(cancel) = cancel {
                    server.respond_to_cancel_requests(&cancel, std::iter::empty()).await.ok();
                }
            }
            () = deliver_result(&server, ended.as_ref()), if ended.is_some() => ended = None,
        }
    }
}

/// The middleware's error when a goal could not be accepted.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct NotAccepted(String);

async fn accept_new_goal<J: Job>(
    server: &Server<J>,
    new: NewGoalHandle<J::Goal>,
) -> Result<Goal<J>, NotAccepted> {
    let accepted = server.accept_goal(new).await.map_err(|e| NotAccepted(format!("{e:?}")))?;
    server.start_executing_goal(accepted).await.map_err(|e| NotAccepted(format!("{e:?}")))
}

/// Waits until the client requests the result, and sends it.
async fn deliver_result<J: Job>(server: &Server<J>, ended: Option<&Ended<J>>) {
    let Some(Ended { goal, status, result, until }) = ended else { return };
    match tokio::time::timeout_at(*until, server.send_result_response(goal.clone(), *status, result.clone()))
        .await
    {
        Ok(Ok(())) => {}
        Ok(Err(error)) => log::warn!("{}: the result was not sent: {error:?}", J::NAME),
        Err(_) => {
            log::warn!("{}: nobody asked for the result", J::NAME);
            server.abort_executing_goal(goal.clone()).await.ok();
        }
    }
}

/// Runs a goal to its end; in the meantime rejects other goals and handles cancel requests.
async fn execute_goal<J: Job>(
    server: &Server<J>,
    job: &Arc<J>,
    goal: &Goal<J>,
    request: J::Goal,
) -> (GoalEndStatus, J::Result) {
    let mut work = match job.begin_work(&request) {
        Ok(work) => work,
        // The goal is already accepted, so an error must reach the client as a result.
        Err(error) => return goal_outcome::<J>(Finished::Failed(error.to_string())),
    };
    loop {
        tokio::select! {
            news = work.next() => match news {
                News::Feedback(feedback) => _ = server.publish_feedback(goal.clone(), feedback).await,
                // `deliver_result` sends the result when the client requests it.
                News::Ended(finished) => return goal_outcome::<J>(finished),
            },
            cancel = server.receive_cancel_request() => {
                let Ok(cancel) = cancel else { continue };
                // A cancel request may name other goals, or all; only this one can be confirmed. The work
                // ends after its current step.
                let ours = cancel.contains_goal(&goal.goal_id());
                if ours {
                    work.cancel();
                }
                let canceled = cancel.goals().filter(|id| *id == goal.goal_id());
                server.respond_to_cancel_requests(&cancel, canceled).await.ok();
            }
            other = server.receive_new_goal() => {
                if let Ok(other) = other {
                    log::warn!("{}: a goal was rejected, as another runs", J::NAME);
                    server.reject_goal(other).await.ok();
                }
            }
        }
    }
}

fn goal_outcome<J: Job>(finished: Finished<J::Result>) -> (GoalEndStatus, J::Result) {
    match finished {
        Finished::Done(result) => (GoalEndStatus::Succeeded, result),
        Finished::Canceled => {
            log::info!("{}: canceled", J::NAME);
            (GoalEndStatus::Canceled, J::failed_result("canceled".to_owned()))
        }
        Finished::Failed(message) => {
            log::warn!("{}: {message}", J::NAME);
            (GoalEndStatus::Aborted, J::failed_result(message))
        }
    }
}
