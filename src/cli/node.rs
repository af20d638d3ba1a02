//! `artitwin node`.

use super::{
    args::NodeArgs,
    exit::{CliError, Exit},
};

/// Works as a ROS 2 node until it is asked to end.
///
/// # Errors
/// If the node cannot start.
pub(super) fn run(args: &NodeArgs) -> Result<Exit, CliError> {
    node::run(&args.arguments)?;
    Ok(Exit::Done)
}
