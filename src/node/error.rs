//! Why the node does not start, or ends.

use super::{
    environment::EnvironmentError, parameters::ParameterError, ros_args::RosArgsError, ros_names::NameError,
    session_lock::SessionLockError,
};
use config::ConfigError;
use io::BagWriteError;

/// Why the node does not start, or ends.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// An argument cannot be read.
    #[error(transparent)]
    Arguments(#[from] RosArgsError),
    /// An argument means nothing.
    #[error(
        "`{0}` is no argument of the node; parameters stand behind --ros-args, e.g. `--ros-args -p parts:=2`"
    )]
    Stray(String),
    /// A parameter cannot be used.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The settings cannot be used.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The environment cannot be used.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// A name cannot be used.
    #[error("`{name}` cannot be a name: {reason}")]
    Name {
        /// The name.
        name: String,
        /// Why.
        reason: NameError,
    },
    /// The network refuses.
    #[error("{what}: {reason}")]
    Network {
        /// The attempted action.
        what: String,
        /// The middleware's message.
        reason: String,
    },
    /// A recording could not be written.
    #[error(transparent)]
    Bag(#[from] BagWriteError),
    /// The session cannot be worked on.
    #[error(transparent)]
    Session(#[from] SessionLockError),
    /// The middleware listens to more than this machine.
    #[error(
        "only this machine is to be talked to, but {0} listens to all networks: this program was built \
         without its own RustDDS; build it from its repository, or open the node with \
         ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET"
    )]
    Open(std::net::SocketAddr),
    /// The system refuses.
    #[error("{what}: {source}")]
    System {
        /// The attempted action.
        what: &'static str,
        /// Its message.
        source: std::io::Error,
    },
}

impl NodeError {
    /// Whether arguments, parameters or the environment are wrong.
    #[must_use]
    pub fn is_usage(&self) -> bool {
        !matches!(
            self,
            Self::Network { .. } | Self::Bag(_) | Self::Session(_) | Self::Open(_) | Self::System { .. }
        )
    }

    /// The middleware refused something.
    pub fn network_error(what: &str, reason: impl std::fmt::Display) -> Self {
        Self::Network { what: what.to_owned(), reason: reason.to_string() }
    }
}
