//! Counts of messages and views for diagnostics.

use super::{keyframes::Verdict, sample::Refusal};

/// Counts since the start or the last reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    /// Messages with an invalid header.
    pub bad_header: u64,
    /// Messages with inconsistent or excessive sizes.
    pub bad_size: u64,
    /// Messages with invalid numbers.
    pub bad_value: u64,
    /// Views whose images cannot be decoded.
    pub broken: u64,
    /// Sets dropped without a camera pose.
    pub without_pose: u64,
    /// Kept views.
    pub kept: u64,
    /// Views similar to a kept one.
    pub known: u64,
    /// Views dropped because the state was full.
    pub full: u64,
    /// Views older than the last kept one.
    pub late: u64,
    /// Backward time jumps.
    pub jumps: u64,
}

impl Counts {
    /// Counts a rejected message.
    pub(crate) fn count_refusal(&mut self, refusal: Refusal) {
        match refusal {
            Refusal::Header => self.bad_header += 1,
            Refusal::Size => self.bad_size += 1,
            Refusal::Value => self.bad_value += 1,
        }
    }

    /// Counts the verdict on a view while a state is collected.
    pub(crate) fn count_verdict(&mut self, verdict: Verdict, collecting: bool) {
        match verdict {
            // Between states every view counts as known, which is no information.
            _ if !collecting => {}
            Verdict::Keep => self.kept += 1,
            Verdict::Known => self.known += 1,
            Verdict::Full => self.full += 1,
            Verdict::Late => self.late += 1,
        }
    }

    /// The counts that survive a reset: rejected messages and jumps, as they come from other nodes.
    #[must_use]
    pub(crate) fn after_reset(self) -> Self {
        Self {
            bad_header: self.bad_header,
            bad_size: self.bad_size,
            bad_value: self.bad_value,
            jumps: self.jumps,
            ..Self::default()
        }
    }
}
