//! Where the inputs of a job lie, and what its key holds of them.

use std::{io, path::PathBuf, sync::Arc};

use super::{
    JobError, JobRequest, Reads,
    key::{content, key},
    manifest::{InputFound, Transfer},
    request::uri,
};
use crate::store::{Bucket, Listing, StoreError, Traffic, Uri, connect, list};

/// Where an input lies.
pub enum Place {
    /// On this machine.
    Here(PathBuf),
    /// In a store, by its number.
    Elsewhere(Listing, usize),
    /// Nowhere, or in no store that is served.
    Absent(Option<StoreError>),
}

/// An input that was looked for.
pub struct Located {
    /// As it was given.
    pub given: String,
    /// What is read of it.
    pub reads: Reads,
    /// What the key holds of it.
    pub identity: String,
    /// Where it lies.
    pub place: Place,
    /// Its bytes.
    pub bytes_stored: u64,
    /// Bytes that were read of it.
    pub bytes_read: u64,
}

impl Located {
    /// Whether it is to be fetched.
    pub fn is_elsewhere(&self) -> bool {
        matches!(self.place, Place::Elsewhere(..))
    }

    /// For the manifest.
    pub fn found(&self) -> InputFound {
        InputFound {
            uri: self.given.clone(),
            identity: self.identity.clone(),
            bytes_stored: self.bytes_stored,
            bytes_read: self.bytes_read,
        }
    }
}

/// All inputs, and the stores that they lie in.
pub struct Places {
    /// In the order of the request.
    pub all: Vec<Located>,
    /// With what their URIs begin with.
    pub buckets: Vec<(String, Box<dyn Bucket>)>,
}

impl Places {
    /// Looks for the inputs of a request.
    ///
    /// # Errors
    /// A store or disk that refuses. An input that is not there is no error.
    pub fn of(request: &JobRequest, traffic: &Arc<Traffic>) -> Result<Self, JobError> {
        let mut found = Self { all: Vec::new(), buckets: Vec::new() };
        for input in &request.inputs {
            let given = input.given.display().to_string();
            let (place, identity, bytes) = match uri(&input.given) {
                Ok(None) => here(input.given.clone(), input.reads)?,
                Ok(Some(uri)) => match uri.local() {
                    Some(path) => here(path, input.reads)?,
                    None => found.elsewhere(&uri, input.reads, traffic)?,
                },
                Err(error) => (Place::Absent(Some(error.into())), "no URI".to_owned(), 0),
            };
            let bytes_read = if matches!(place, Place::Here(_)) { bytes } else { 0 };
            let reads = input.reads;
            found.all.push(Located { given, reads, identity, place, bytes_stored: bytes, bytes_read });
        }
        Ok(found)
    }

    fn elsewhere(
        &mut self,
        uri: &Uri,
        reads: Reads,
        traffic: &Arc<Traffic>,
    ) -> Result<(Place, String, u64), JobError> {
        let at = match self.buckets.iter().position(|(root, _)| *root == uri.root) {
            Some(at) => at,
            None => {
                self.buckets.push((uri.root.clone(), connect(uri, traffic)?));
                self.buckets.len() - 1
            }
        };
        match list(self.buckets[at].1.as_ref(), uri, reads.role()) {
            Ok(listing) => {
                let (identity, bytes) = (listing.identity(), listing.bytes());
                Ok((Place::Elsewhere(listing, at), identity, bytes))
            }
            Err(error) if error.may_pass() => Err(error.into()),
            Err(error) => Ok((Place::Absent(Some(error)), "absent".to_owned(), 0)),
        }
    }

    /// Key of the job.
    pub fn key(&self, request: &JobRequest) -> String {
        let identities: Vec<(Reads, String)> =
            self.all.iter().map(|l| (l.reads, l.identity.clone())).collect();
        key(request.command, &request.resolved_name(), &identities, &request.settings)
    }

    /// What went over the network.
    pub fn transfer(&self, traffic: &Traffic) -> Transfer {
        let elsewhere = || self.all.iter().filter(|l| l.is_elsewhere());
        Transfer {
            bytes_stored: elsewhere().map(|l| l.bytes_stored).sum(),
            bytes_read: elsewhere().map(|l| l.bytes_read).sum(),
            bytes_written: Traffic::get(&traffic.bytes_written),
            requests: Traffic::get(&traffic.requests),
            retries: Traffic::get(&traffic.retries),
            seconds: Traffic::get(&traffic.nanos) as f64 * 1e-9,
        }
    }
}

/// An input of this machine.
fn here(path: PathBuf, reads: Reads) -> Result<(Place, String, u64), JobError> {
    // Meshes stand beside a URDF.
    let of = match (reads, path.parent()) {
        (Reads::TwinWithMeshes, Some(folder)) if path.is_file() && !folder.as_os_str().is_empty() => folder,
        _ => path.as_path(),
    };
    match content(of, reads) {
        Ok((identity, bytes)) => Ok((Place::Here(path), identity, bytes)),
        // The command itself says that it is not there.
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            Ok((Place::Here(path), "absent".to_owned(), 0))
        }
        Err(source) => Err(JobError::Disk { path, source }),
    }
}
