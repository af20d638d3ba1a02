//! From a URI to its store.

use std::sync::Arc;

use super::{Bucket, StoreError, Traffic, Uri};

/// Connects to the store of a URI, by credentials and endpoints of the environment.
///
/// # Errors
/// [`StoreError::Without`] where the binary has no stores; [`StoreError::Access`] where the environment
/// cannot be used.
#[cfg(feature = "store")]
pub fn connect(uri: &Uri, traffic: &Arc<Traffic>) -> Result<Box<dyn Bucket>, StoreError> {
    Ok(Box::new(super::remote::Remote::connect(uri, traffic)?))
}

/// Connects to no store.
///
/// # Errors
/// [`StoreError::Without`].
#[cfg(not(feature = "store"))]
pub fn connect(uri: &Uri, _: &Arc<Traffic>) -> Result<Box<dyn Bucket>, StoreError> {
    Err(StoreError::Without(uri.to_string()))
}
