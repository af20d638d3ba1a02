//! A job: one object, from where its recordings lie to where its result does, done once.
//!
//! A job has a key, the digest of all that determines its result. A store holds the result under the key, and
//! a manifest beside it that is written last. Where a manifest stands, nothing is left to do.

mod estimate;
mod hold;
mod job_error;
mod key;
mod located;
mod manifest;
mod output;
mod perform;
mod request;
mod scratch;
mod usage;

pub use estimate::estimate;
pub use job_error::JobError;
pub use manifest::{Manifest, Status};
pub use perform::{Ended, Local, Made, perform};
pub use request::{JobInput, JobRequest, Reads};
