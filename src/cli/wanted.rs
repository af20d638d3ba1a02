//! What an option wants, where its value is something else.

/// Why the value of an option cannot be used: what to give.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("give {0}")]
pub(super) struct Wanted(pub &'static str);
