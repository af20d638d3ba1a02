//! What is asked of a job.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::{
    capture::CaptureConfig,
    gap::record::tracks::Streams,
    io::{Wanted, name_of},
    store::{Role, Uri, UriError},
};

/// What a command reads of an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reads {
    /// The RGB-D views of an object's states.
    Views,
    /// Joints.
    Joints,
    /// RGB-D views of one state, and joints beside them.
    Frames,
    /// The dynamics of a twin.
    Twin,
    /// Its meshes, too.
    TwinWithMeshes,
    /// A file.
    File,
}

/// An input as it was given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JobInput {
    /// A path or a URI.
    pub given: PathBuf,
    /// What is read of it.
    pub reads: Reads,
}

/// What is asked of a job.
#[derive(Clone, Debug)]
pub struct JobRequest {
    /// `reconstruct` or `diagnose`.
    pub command: &'static str,
    /// Name of the result; without it that of the recordings, or `diagnosis`.
    pub name: Option<String>,
    /// In the order in which they are given.
    pub inputs: Vec<JobInput>,
    /// All that beside inputs, name and version determines the result.
    pub settings: Value,
    /// How views are read.
    pub capture: CaptureConfig,
    /// Nodes along the longest side of the object's box, for the estimate.
    pub nodes: usize,
    /// What is read beside joint states.
    pub streams: Streams,
    /// Folder or URI that gets the result.
    pub out: PathBuf,
    /// Folder for what is fetched; without it the system's for temporary files.
    pub scratch: Option<PathBuf>,
}

/// The URI that an option holds, if it is one.
///
/// # Errors
/// [`UriError`].
pub fn uri(given: &Path) -> Result<Option<Uri>, UriError> {
    // What is no text is a path.
    given.to_str().map_or(Ok(None), Uri::parse)
}

impl JobRequest {
    /// Whether an input or the output is named by a URI.
    #[must_use]
    pub fn names_a_store(&self) -> bool {
        let is_uri = |p: &Path| uri(p).is_ok_and(|u| u.is_some()) || uri(p).is_err();
        is_uri(&self.out) || self.inputs.iter().any(|i| is_uri(&i.given))
    }

    /// Name of the result.
    #[must_use]
    pub fn resolved_name(&self) -> String {
        if let Some(name) = &self.name {
            return name.clone();
        }
        if self.command != "reconstruct" {
            return "diagnosis".to_owned();
        }
        let path = |input: &JobInput| match uri(&input.given) {
            Ok(Some(uri)) => uri.local().unwrap_or_else(|| uri.relative()),
            _ => input.given.clone(),
        };
        name_of(&self.inputs.iter().filter(|i| i.reads == Reads::Views).map(path).collect::<Vec<_>>())
    }

    /// What is read of bags.
    #[must_use]
    pub fn wanted(&self, reads: Reads) -> Wanted<'_> {
        match reads {
            Reads::Views => Wanted::Views(&self.capture),
            Reads::Joints => Wanted::Joints(&self.streams),
            Reads::Frames => Wanted::ViewsAndJoints(&self.capture, &self.streams),
            Reads::Twin | Reads::TwinWithMeshes | Reads::File => Wanted::All,
        }
    }
}

impl Reads {
    /// What that is to a store.
    #[must_use]
    pub fn role(self) -> Role {
        match self {
            Self::Views | Self::Joints | Self::Frames => Role::Recording,
            Self::Twin => Role::Twin,
            Self::TwinWithMeshes => Role::TwinWithMeshes,
            Self::File => Role::File,
        }
    }
}
