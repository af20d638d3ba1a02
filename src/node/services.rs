//! Services of the node: starting and finishing states, reset, save.

use std::{path::PathBuf, sync::Arc};

use serde::{Serialize, de::DeserializeOwned};
use tokio::sync::{mpsc, oneshot};

use super::{
    collect_error::CollectError,
    collection::{Command, Shared},
    error::NodeError,
    participant::Participant,
    service_server::ServiceServer,
};
use crate::requests::{SetStateRequest, SetStateResponse, TriggerRequest, TriggerResponse};

/// Context of the services.
#[derive(Clone)]
pub(crate) struct ServiceContext {
    /// Channel to the collection thread.
    pub commands: mpsc::Sender<Command>,
    /// Data shared with the collection.
    pub shared: Arc<Shared>,
    /// Returns a folder for the next session.
    pub next_session: Arc<dyn Fn() -> PathBuf + Send + Sync>,
}

impl ServiceContext {
    /// Sends a command to the collection and waits for its answer.
    async fn ask_core<T>(
        &self,
        command: impl FnOnce(oneshot::Sender<Result<T, CollectError>>) -> Command,
    ) -> Result<T, CollectError> {
        let (answer, answered) = oneshot::channel();
        // Only the collection thread changes the session, in order of the commands.
        if self.commands.send(command(answer)).await.is_err() {
            return Err(CollectError::Ending);
        }
        // The collection ended without an answer.
        answered.await.unwrap_or(Err(CollectError::Ending))
    }

    async fn set_state(&self, begin: bool, state: usize) -> SetStateResponse {
        let done = match begin {
            true => self
                .ask_core(|a| Command::Start(state, a))
                .await
                .map(|()| format!("state {state} is being collected")),
            false => self
                .ask_core(|a| Command::Finish(state, a))
                .await
                .map(|kept| format!("state {state} has {kept} views")),
        };
        let keyframes = self.shared.snapshot().kept.get(state).copied().unwrap_or(0) as u32;
        match done {
            Ok(message) => {
                log::info!("{message}");
                SetStateResponse { success: true, message, keyframes }
            }
            Err(error) => {
                log::warn!("{error}");
                SetStateResponse { success: false, message: error.to_string(), keyframes }
            }
        }
    }

    async fn reset_session(&self) -> TriggerResponse {
        // A new folder, so that no later message enters the old session.
        let session = (self.next_session)();
        let done = self.ask_core(|a| Command::Reset(session.clone(), a)).await;
        trigger_response(done.map(|()| format!("the next session is {}", session.display())))
    }

    async fn save_states(&self) -> TriggerResponse {
        let done = self.ask_core(Command::Flush).await;
        let snapshot = self.shared.snapshot();
        trigger_response(done.map(|()| {
            let [zero, one] = snapshot.kept;
            format!("{}: {zero} and {one} views are on the disk", snapshot.session.display())
        }))
    }
}

fn trigger_response(done: Result<String, CollectError>) -> TriggerResponse {
    match done {
        Ok(message) => TriggerResponse { success: true, message },
        Err(error) => TriggerResponse { success: false, message: error.to_string() },
    }
}

/// Offers all services.
///
/// # Errors
/// If a name is invalid or the network reports an error.
pub(crate) fn offer_services(
    participant: &mut Participant,
    context: &ServiceContext,
) -> Result<(), NodeError> {
    for (name, begin) in [("~/start_state", true), ("~/finish_state", false)] {
        let context = context.clone();
        serve_requests(participant, name, "artitwin_msgs/srv/SetState", move |request: SetStateRequest| {
            let context = context.clone();
            async move { context.set_state(begin, request.state as usize).await }
        })?;
    }
    let c = context.clone();
    serve_requests(participant, "~/reset", "std_srvs/srv/Trigger", move |_: TriggerRequest| {
        let context = c.clone();
        async move { context.reset_session().await }
    })?;
    let c = context.clone();
    serve_requests(participant, "~/save", "std_srvs/srv/Trigger", move |_: TriggerRequest| {
        let context = c.clone();
        async move { context.save_states().await }
    })
}

/// Answers the requests of one service in order.
///
/// # Errors
/// If the name is invalid or the network reports an error.
pub(crate) fn serve_requests<Q, A, F>(
    participant: &mut Participant,
    name: &str,
    ros_type: &str,
    mut answer: impl FnMut(Q) -> F + Send + 'static,
) -> Result<(), NodeError>
where
    Q: DeserializeOwned + Send + 'static,
    A: Serialize + Send + Sync + 'static,
    F: Future<Output = A> + Send,
{
    let server = ServiceServer::<Q, A>::offer(participant, name, ros_type)?;
    tokio::spawn(async move {
        loop {
            let (id, request) = server.next_request().await;
            // One after the other, so that two starts of a state cannot overtake each other.
            let reply = answer(request).await;
            server.send_reply(id, &reply);
        }
    });
    Ok(())
}
