//! `/rosout`: the node's log for other programs.

use serde::Serialize;
use tokio::sync::mpsc;

use super::{
    error::NodeError,
    logger,
    participant::{Participant, latched_profile},
};
use io::ros2msg::Time;

/// Queue length; where it is full, lines are on standard error only.
const DEPTH: usize = 100;

/// `rcl_interfaces/msg/Log`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct LogLine {
    /// When, by the system clock.
    pub stamp: Time,
    /// 10 debug, 20 info, 30 warn, 40 error.
    pub level: u8,
    /// Name of the logger.
    pub name: String,
    /// The text.
    pub msg: String,
    /// Source file.
    pub file: String,
    /// Function; not known here.
    pub function: String,
    /// Line in the file.
    pub line: u32,
}

/// Publishes the log from now on.
///
/// # Errors
/// If the network reports an error.
pub(crate) fn publish_log(participant: &mut Participant) -> Result<(), NodeError> {
    let qos = latched_profile(DEPTH);
    let publisher = participant.create_publisher_of_type("/rosout", "rcl_interfaces/msg/Log", &qos)?;
    let (lines, mut queue) = mpsc::channel::<LogLine>(DEPTH);
    logger::copy_lines(lines);
    tokio::spawn(async move {
        while let Some(line) = queue.recv().await {
            // A failure is not logged, as that would be another line.
            publisher.async_publish(line).await.ok();
        }
    });
    Ok(())
}
