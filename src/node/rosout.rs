//! `/rosout`: the node's log for other programs.

use ros2_client::Log;
use tokio::sync::mpsc;

use super::{
    error::NodeError,
    logger,
    participant::{Participant, latched_profile},
};

/// Queue length; where it is full, lines are on standard error only.
const DEPTH: usize = 100;

/// Publishes the log from now on.
///
/// # Errors
/// If the network reports an error.
pub(crate) fn publish_log(participant: &mut Participant) -> Result<(), NodeError> {
    let qos = latched_profile(DEPTH);
    let publisher = participant.create_publisher_of_type("/rosout", "rcl_interfaces/msg/Log", &qos)?;
    let (lines, mut queue) = mpsc::channel::<Log>(DEPTH);
    logger::copy_lines(lines);
    tokio::spawn(async move {
        while let Some(line) = queue.recv().await {
            // A failure is not logged, as that would be another line.
            publisher.async_publish(line).await.ok();
        }
    });
    Ok(())
}
