//! Exit codes and the errors behind them.

use std::process::ExitCode;

use capture::CaptureError;
use config::ConfigError;
use evaluate::EvaluateError;
use io::SynthError;
use run::{DemonstrateError, RunError, TrialsError, chain};

/// How a command ended; the number is the exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// Done.
    Done = 0,
    /// Failed; nothing stands under the final name.
    Failed = 1,
    /// The command line or the configuration is wrong.
    Usage = 2,
    /// Done, but data was lost or a result is uncertain.
    Degraded = 3,
    /// A disk or another process was in the way; the same command may succeed later. EX_TEMPFAIL of
    /// sysexits.h.
    MayPass = 75,
    /// Stopped on request; 128 + SIGINT.
    Cancelled = 130,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub(super) enum CliError {
    /// The configuration is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The run failed or was stopped.
    #[error(transparent)]
    Run(#[from] RunError),
    /// Trials ended.
    #[error(transparent)]
    Trials(#[from] TrialsError),
    /// A command of another package.
    #[error("cannot run `{}`", path.display())]
    External {
        /// The program.
        path: std::path::PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The recording cannot be read.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// The runs cannot be measured.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// The folder cannot be read.
    #[error(transparent)]
    Folder(#[from] io::ModelFolderError),
    /// The object cannot be made or written.
    #[error(transparent)]
    Synth(#[from] SynthError),
    /// There is no demonstration.
    #[error(transparent)]
    Demonstrate(#[from] DemonstrateError),
    /// Folders of results cannot be read.
    #[error("cannot read `{}`: {source}", path.display())]
    Results {
        /// The folder.
        path: std::path::PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A page cannot be written.
    #[error("cannot write `{}`: {source}", path.display())]
    Page {
        /// Where it was to go.
        path: std::path::PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The signal handler could not be set.
    #[error("cannot listen for Ctrl-C")]
    Signal(#[from] ctrlc::Error),
    /// The options of the command line contradict each other.
    #[error("{0}")]
    Usage(&'static str),
    /// Some objects of several have no result; why was reported.
    #[error(
        "{failed} of {total} objects {}",
        if *cancelled { "were stopped or failed, the others are in their folders; continue with \
            --resume" } else { "failed, the others are in their folders" }
    )]
    Batch {
        /// Objects without a result.
        failed: usize,
        /// All objects.
        total: usize,
        /// Whether they were stopped on request.
        cancelled: bool,
    },
    /// The node could not start.
    #[cfg(feature = "node")]
    #[error(transparent)]
    Node(#[from] node::NodeError),
    /// A file could not be written.
    #[error("cannot write `{}`; give a name that is not taken, in a folder that is there", path.display())]
    File {
        /// Its path.
        path: std::path::PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// There is no joint to write.
    #[error("no URDF is written: {0}")]
    NoJoint(String),
    /// Standard output could not be written.
    #[error("cannot write to standard output; files that the command wrote are in their place")]
    Output(#[source] std::io::Error),
    /// Events could not be written to standard output: the run was stopped.
    #[error("cannot write events to standard output; the run was stopped, unless it was done")]
    Events(#[source] std::io::Error),
}

impl CliError {
    /// The error and its causes, on one line.
    #[must_use]
    pub(super) fn chain(&self) -> String {
        chain(self)
    }

    /// The exit code of this error.
    #[must_use]
    pub(super) fn exit(&self) -> Exit {
        match self {
            // Wrong settings are wrong usage, whichever layer finds them.
            Self::Config(_)
            | Self::Run(RunError::Config(_))
            | Self::Trials(TrialsError::Run(RunError::Config(_)))
            | Self::Usage(_)
            | Self::Synth(SynthError::Config(_)) => Exit::Usage,
            #[cfg(feature = "node")]
            Self::Node(error) if error.is_usage() => Exit::Usage,
            Self::Run(RunError::Cancelled(_))
            | Self::Trials(TrialsError::Run(RunError::Cancelled(_)))
            | Self::Demonstrate(DemonstrateError::Cancelled(_))
            | Self::Batch { cancelled: true, .. } => Exit::Cancelled,
            Self::Run(error) if error.may_pass() => Exit::MayPass,
            _ => Exit::Failed,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use run::Cancelled;

    #[test]
    fn errors_have_their_codes() {
        let code = |error: CliError| error.exit() as i32;
        assert_eq!(code(RunError::Cancelled(Cancelled::default()).into()), 130);
        assert_eq!(code(RunError::stage("field/state0", "no memory").into()), 1);
        assert_eq!(code(ConfigError::UnknownPreset { name: String::new(), known: String::new() }.into()), 2);
    }

    #[test]
    fn messages_hold_the_whole_chain_once() {
        let error: CliError = RunError::stage("field/state0", std::io::Error::other("disk full")).into();
        assert_eq!(error.chain(), "field/state0: disk full");
        let missing = CaptureError::Read { path: "bag".into(), source: std::io::Error::other("gone") };
        assert_eq!(
            CliError::from(RunError::stage("capture", missing)).chain(),
            "capture: cannot read `bag`: gone"
        );
    }
}
