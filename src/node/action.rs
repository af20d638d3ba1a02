//! The action `~/reconstruct`: one goal at a time, with feedback and cancel.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use ros2_client::{
    ActionTypeName, Message, ServiceMapping,
    action::{ActionServerQosPolicies, AsyncActionServer, ExecutingGoalHandle, GoalEndStatus, NewGoalHandle},
};

use super::{
    error::NodeError,
    participant::{Participant, latched, reliable},
    reconstruction::{Finished, News, Reconstructor},
};
use crate::io::{
    SummaryJoint,
    ros2msg::status::{ReconstructFeedback, ReconstructGoal, ReconstructResult},
};

impl Message for ReconstructGoal {}
impl Message for ReconstructResult {}
impl Message for ReconstructFeedback {}

/// Requests that wait.
const DEPTH: usize = 10;
/// How long a client may take to fetch its result.
const RESULT_WAIT: Duration = Duration::from_secs(900);
/// Least time between two feedbacks of one stage.
const FEEDBACK_EVERY: Duration = Duration::from_millis(100);

type Server = AsyncActionServer<ReconstructGoal, ReconstructResult, ReconstructFeedback>;
type Goal = ExecutingGoalHandle<ReconstructGoal>;

/// Offers the action.
///
/// # Errors
/// If the name cannot be used or the network refuses.
pub fn offer(participant: &mut Participant, mapping: ServiceMapping, reconstructor: Arc<Reconstructor>) -> Result<(), NodeError> {
    let name = participant.name("~/reconstruct")?;
    let qos = ActionServerQosPolicies {
        goal_service: reliable(DEPTH),
        result_service: reliable(DEPTH),
        cancel_service: reliable(DEPTH),
        feedback_publisher: reliable(DEPTH),
        status_publisher: latched(1),
    };
    let server = participant
        .node()
        .create_action_server(mapping, &name, &ActionTypeName::new("artitwin_msgs", "Reconstruct"), qos)
        .map_err(|e| NodeError::network("offering ~/reconstruct", e))?;
    tokio::spawn(serve(AsyncActionServer::new(server), reconstructor));
    Ok(())
}

/// A goal that ended, and its result, which waits for the client to ask.
#[derive(Clone)]
struct Ended {
    goal: Goal,
    status: GoalEndStatus,
    result: ReconstructResult,
    until: tokio::time::Instant,
}

async fn serve(server: Server, reconstructor: Arc<Reconstructor>) {
    let mut ended: Option<Ended> = None;
    loop {
        tokio::select! {
            new = server.receive_new_goal() => match new {
                Ok(new) => {
                    if let Some(old) = ended.take() {
                        // Nobody asked for it; the server would wait for ever.
                        server.abort_executing_goal(old.goal).await.ok();
                    }
                    let Some(request) = server.get_new_goal(new.clone()) else { continue };
                    match accept(&server, new).await {
                        Ok(goal) => {
                            let (status, result) = execute(&server, &reconstructor, &goal, request).await;
                            log::info!("~/reconstruct: {}", result.message);
                            ended = Some(Ended { goal, status, result, until: tokio::time::Instant::now() + RESULT_WAIT });
                        }
                        Err(error) => log::warn!("~/reconstruct: the goal was not accepted: {error}"),
                    }
                }
                Err(error) => log::debug!("~/reconstruct: a goal could not be read: {error}"),
            },
            cancel = server.receive_cancel_request() => {
                // Nothing runs, so nothing is canceled.
                if let Ok(cancel) = cancel {
                    server.respond_to_cancel_requests(&cancel, std::iter::empty()).await.ok();
                }
            }
            () = deliver(&server, ended.clone()), if ended.is_some() => ended = None,
        }
    }
}

async fn accept(server: &Server, new: NewGoalHandle<ReconstructGoal>) -> Result<Goal, String> {
    let accepted = server.accept_goal(new).await.map_err(|e| format!("{e:?}"))?;
    server.start_executing_goal(accepted).await.map_err(|e| format!("{e:?}"))
}

/// Waits for the client to ask for its result, and sends it.
async fn deliver(server: &Server, ended: Option<Ended>) {
    let Some(Ended { goal, status, result, until }) = ended else { return };
    match tokio::time::timeout_at(until, server.send_result_response(goal.clone(), status, result)).await {
        Ok(Ok(())) => {}
        Ok(Err(error)) => log::warn!("~/reconstruct: the result was not sent: {error:?}"),
        Err(_) => {
            log::warn!("~/reconstruct: nobody asked for the result");
            server.abort_executing_goal(goal).await.ok();
        }
    }
}

/// Runs a goal to its end; meanwhile other goals are rejected and cancels are heard.
async fn execute(
    server: &Server,
    reconstructor: &Arc<Reconstructor>,
    goal: &Goal,
    request: ReconstructGoal,
) -> (GoalEndStatus, ReconstructResult) {
    let mut run = match reconstructor.begin(&request) {
        Ok(run) => run,
        Err(message) => return (GoalEndStatus::Aborted, ReconstructResult { message, ..ReconstructResult::default() }),
    };
    let mut told = FeedbackGate::default();
    loop {
        tokio::select! {
            news = run.next() => match news {
                News::Feedback(feedback) => {
                    if told.opens(&feedback) {
                        server.publish_feedback(goal.clone(), feedback).await.ok();
                    }
                }
                News::Ended(finished) => return outcome(finished),
            },
            cancel = server.receive_cancel_request() => {
                let Ok(cancel) = cancel else { continue };
                let ours = cancel.contains_goal(&goal.goal_id());
                if ours {
                    run.cancel();
                }
                let canceled = cancel.goals().filter(|id| *id == goal.goal_id());
                server.respond_to_cancel_requests(&cancel, canceled).await.ok();
            }
            other = server.receive_new_goal() => {
                if let Ok(other) = other {
                    log::warn!("~/reconstruct: a goal was rejected, as another runs");
                    server.reject_goal(other).await.ok();
                }
            }
        }
    }
}

fn outcome(finished: Finished) -> (GoalEndStatus, ReconstructResult) {
    match finished {
        Finished::Twin(twin, message) => {
            let motion = |j: &SummaryJoint| j.states.last().copied().unwrap_or_default() - j.states.first().copied().unwrap_or_default();
            let result = ReconstructResult {
                success: true,
                message,
                folder: twin.summary.folder.display().to_string(),
                joints: twin.summary.joints.iter().map(|j| j.name.clone()).collect(),
                motions: twin.summary.joints.iter().map(motion).collect(),
            };
            (GoalEndStatus::Succeeded, result)
        }
        Finished::Canceled => {
            let message = "canceled".to_owned();
            (GoalEndStatus::Canceled, ReconstructResult { message, ..ReconstructResult::default() })
        }
        Finished::Failed(message) => (GoalEndStatus::Aborted, ReconstructResult { message, ..ReconstructResult::default() }),
    }
}

/// Lets through the first feedback of every stage, and then not too many.
#[derive(Default)]
struct FeedbackGate {
    stage: String,
    last: Option<Instant>,
}

impl FeedbackGate {
    fn opens(&mut self, feedback: &ReconstructFeedback) -> bool {
        let late = self.last.is_none_or(|t| t.elapsed() >= FEEDBACK_EVERY);
        let opens = late || feedback.stage != self.stage;
        if opens {
            self.stage.clone_from(&feedback.stage);
            self.last = Some(Instant::now());
        }
        opens
    }
}
