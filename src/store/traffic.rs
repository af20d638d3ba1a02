//! What went over the network.

use std::sync::atomic::{AtomicU64, Ordering};

/// Counts, shared by all stores of a command.
#[derive(Debug, Default)]
pub struct Traffic {
    /// Requests that were sent, retries included.
    pub requests: AtomicU64,
    /// Requests that failed in a way that may pass, and were sent again.
    pub retries: AtomicU64,
    /// Bytes of objects that came.
    pub bytes_read: AtomicU64,
    /// Bytes of objects that were written.
    pub bytes_written: AtomicU64,
    /// Time spent waiting, nanoseconds.
    pub nanos: AtomicU64,
}

impl Traffic {
    /// Adds to one of the counts.
    pub fn add(of: &AtomicU64, count: u64) {
        of.fetch_add(count, Ordering::Relaxed);
    }

    /// One of the counts.
    pub fn get(of: &AtomicU64) -> u64 {
        of.load(Ordering::Relaxed)
    }
}
