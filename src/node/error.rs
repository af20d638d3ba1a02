//! Errors that prevent the node from starting, or end it.

use super::{
    environment::EnvironmentError, parameters::ParameterError, ros_args::RosArgsError, ros_names::NameError,
    session_lock::SessionLockError,
};
use config::ConfigError;
use io::BagWriteError;

/// Why the node does not start, or ends.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// A ROS argument cannot be parsed.
    #[error(transparent)]
    Arguments(#[from] RosArgsError),
    /// An unknown argument.
    #[error(
        "`{0}` is no argument of the node; parameters stand behind --ros-args, e.g. `--ros-args -p parts:=2`"
    )]
    Stray(String),
    /// A parameter is invalid.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The settings are invalid.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The environment is invalid.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// A ROS name is invalid.
    #[error("`{name}` cannot be a name: {reason}")]
    Name {
        /// The name.
        name: String,
        /// Why it is invalid.
        reason: NameError,
    },
    /// The network reports an error.
    #[error("{what}: {reason}")]
    Network {
        /// What was attempted.
        what: String,
        /// Message of the middleware.
        reason: String,
    },
    /// Writing a recording failed.
    #[error(transparent)]
    Bag(#[from] BagWriteError),
    /// The session folder is not available.
    #[error(transparent)]
    Session(#[from] SessionLockError),
    /// The middleware listens on more than this machine.
    #[error(
        "only this machine is to be talked to, but {0} listens to all networks: this program was built \
         without its own RustDDS; build it from its repository, or open the node with \
         ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET"
    )]
    Open(std::net::SocketAddr),
    /// The operating system reports an error.
    #[error("{what}: {source}")]
    System {
        /// What was attempted.
        what: &'static str,
        /// Error of the operating system.
        source: std::io::Error,
    },
}

impl NodeError {
    /// Whether arguments, parameters or the environment are invalid.
    #[must_use]
    pub fn is_usage(&self) -> bool {
        !matches!(
            self,
            Self::Network { .. } | Self::Bag(_) | Self::Session(_) | Self::Open(_) | Self::System { .. }
        )
    }

    /// An error reported by the middleware.
    pub fn network_error(what: &str, reason: impl std::fmt::Display) -> Self {
        Self::Network { what: what.to_owned(), reason: reason.to_string() }
    }
}
