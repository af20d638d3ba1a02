//! Why a job has no manifest, and which refusals get one.

use std::{error::Error, io, path::PathBuf};

use crate::{
    run::{CheckpointError, RunError},
    store::StoreError,
};

/// Why a job ended without a manifest.
#[derive(Debug, thiserror::Error)]
pub enum JobError {
    /// A store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Another process works on the same job.
    #[error("another process works on the same job and holds {}; try again later", .0.display())]
    Busy(PathBuf),
    /// A file or folder of the job.
    #[error("cannot use `{}`", path.display())]
    Disk {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A manifest that cannot be read.
    #[error("`{uri}` is no manifest of a job; remove it")]
    Manifest {
        /// Where it stands.
        uri: String,
        /// Why.
        source: serde_json::Error,
    },
    /// The run, for a reason that may pass.
    #[error(transparent)]
    MayPass(RunError),
    /// The run, where no store keeps what became of it.
    #[error(transparent)]
    Run(RunError),
}

impl JobError {
    /// Whether the same command may succeed later.
    #[must_use]
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Store(error) => error.may_pass(),
            Self::Busy(_) | Self::Disk { .. } => true,
            Self::MayPass(error) => !matches!(error, RunError::Cancelled(_)),
            Self::Manifest { .. } | Self::Run(_) => false,
        }
    }
}

impl JobError {
    /// Whether what was fetched and made on the way serves a later command.
    #[must_use]
    pub fn can_continue(&self) -> bool {
        match self {
            Self::MayPass(_) => true,
            Self::Run(error) => error.can_continue(),
            _ => self.may_pass(),
        }
    }
}

/// Whether a run may succeed with the same inputs and settings: it was stopped, its place was in use, or the
/// machine refused. All else would be met again.
#[must_use]
pub fn may_pass(error: &RunError) -> bool {
    match error {
        RunError::Cancelled(_) | RunError::OtherResult { .. } => true,
        RunError::Checkpoint(CheckpointError::StageName(_) | CheckpointError::TooLarge { .. }) => false,
        RunError::Checkpoint(_) => true,
        RunError::Config(_) => false,
        // Written files say nothing of the inputs.
        RunError::Stage { source, .. } => error.can_continue() || is_of_machine(source.as_ref()),
    }
}

/// Whether the system refused for a reason that lies in the machine, not in the file that was asked for.
fn is_of_machine(error: &(dyn Error + 'static)) -> bool {
    let mut next = Some(error);
    while let Some(error) = next {
        if let Some(io) = error.downcast_ref::<io::Error>() {
            let of_file = matches!(
                io.kind(),
                io::ErrorKind::NotFound
                    | io::ErrorKind::NotADirectory
                    | io::ErrorKind::IsADirectory
                    | io::ErrorKind::InvalidInput
                    | io::ErrorKind::InvalidFilename
            );
            // Errors that a reader made have no number.
            return io.kind() == io::ErrorKind::StorageFull || (io.raw_os_error().is_some() && !of_file);
        }
        next = error.source();
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{capture::CaptureError, config::ConfigError, run::Cancelled};

    #[test]
    fn what_the_machine_refuses_may_pass_and_what_a_recording_lacks_does_not() {
        let read = |source| RunError::stage("capture", CaptureError::Read { path: "bag".into(), source });
        // EIO, ENOSPC, EMFILE.
        for number in [5, 28, 24] {
            assert!(may_pass(&read(io::Error::from_raw_os_error(number))), "{number}");
        }
        // ENOENT, and what a decoder says.
        assert!(!may_pass(&read(io::Error::from_raw_os_error(2))));
        assert!(!may_pass(&read(io::Error::other("damaged"))));
        assert!(may_pass(&RunError::Cancelled(Cancelled::default())));
        assert!(may_pass(&RunError::stage("output", "no room")));
        assert!(!may_pass(&RunError::stage("register", "no rigid motion explains it")));
        assert!(!may_pass(&ConfigError::UnknownPreset { name: String::new(), known: String::new() }.into()));
    }
}
