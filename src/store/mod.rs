//! Object stores: what a URI names, recordings fetched from there, results put there.
//!
//! All is synchronous to the outside; requests run on a runtime of one thread inside. Without the feature
//! `store` nothing connects, and only `file://` is served.

#![cfg_attr(not(feature = "store"), allow(dead_code, reason = "only what connects uses all of it"))]

mod bucket;
mod connect;
mod error;
mod fetch;
mod listing;
#[cfg(feature = "store")]
mod remote;
mod traffic;
mod upload;
mod uri;

pub use bucket::{Bucket, Created, ObjectFacts};
pub use connect::connect;
pub use error::StoreError;
pub use fetch::{fetch, look};
pub use listing::{Listing, Role, list};
pub use traffic::Traffic;
pub use upload::{UploadedFile, upload};
pub use uri::{Scheme, Uri, UriError};

#[cfg(all(test, feature = "store"))]
mod tests;
