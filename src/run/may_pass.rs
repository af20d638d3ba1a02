//! Distinguishes failures of a run that may not recur if it is tried again.

use std::{error::Error, io};

use super::{CheckpointError, RunError};
use ::io::RunDirError;

impl RunError {
    /// Whether the same command may succeed later: the machine refused, or another process was in the way.
    /// Any other failure would recur.
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Checkpoint(CheckpointError::InUse { .. } | CheckpointError::Disk { .. }) => true,
            Self::Stage { source, .. } => is_of_machine(source.as_ref()),
            Self::Cancelled(_) | Self::OtherResult { .. } | Self::Checkpoint(_) | Self::Config(_) => false,
        }
    }
}

/// Whether the system refused because of the machine, not because of the requested file.
fn is_of_machine(error: &(dyn Error + 'static)) -> bool {
    if let Some(RunDirError::Full { .. }) = error.downcast_ref() {
        return true;
    }
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
            // Errors that readers raise themselves have no system error number.
            return io.kind() == io::ErrorKind::StorageFull || (io.raw_os_error().is_some() && !of_file);
        }
        next = error.source();
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Cancelled, outcome::OUTPUT_STAGE};
    use capture::CaptureError;
    use config::ConfigError;

    #[test]
    fn what_the_machine_refuses_may_pass_and_what_a_recording_lacks_does_not() {
        let read =
            |source| RunError::stage("capture", CaptureError::Read { path: "bag".into(), source }).may_pass();
        // EIO, ENOSPC, EMFILE.
        for number in [5, 28, 24] {
            assert!(read(io::Error::from_raw_os_error(number)), "{number}");
        }
        // ENOENT, and what a decoder says.
        assert!(!read(io::Error::from_raw_os_error(2)));
        assert!(!read(io::Error::other("damaged")));
        let output = |error: RunDirError| RunError::stage(OUTPUT_STAGE, error).may_pass();
        assert!(output(RunDirError::Full { folder: "runs".into(), least_bytes: 2, free: 1 }));
        assert!(!output(RunDirError::Taken { path: "runs".into(), why: String::new() }));
        assert!(!RunError::stage("register", "no rigid motion explains it").may_pass());
        assert!(RunError::from(CheckpointError::InUse { folder: "runs".into() }).may_pass());
        assert!(!RunError::from(Cancelled::default()).may_pass());
        let preset = ConfigError::UnknownPreset { name: String::new(), known: String::new() };
        assert!(!RunError::from(preset).may_pass());
    }
}
