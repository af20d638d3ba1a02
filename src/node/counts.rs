//! Counts of messages by their fate, for diagnostics.

use super::{keyframes::Verdict, sample::Refusal};

/// Numbers since the start or the last reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    /// Messages with an unusable header.
    pub bad_header: u64,
    /// Messages with sizes against each other or the bounds.
    pub bad_size: u64,
    /// Messages with impossible numbers.
    pub bad_value: u64,
    /// Views with undecodable images.
    pub broken: u64,
    /// Sets given up as no camera pose came.
    pub without_pose: u64,
    /// Views kept.
    pub kept: u64,
    /// Views like a kept one.
    pub known: u64,
    /// Views given up as the state was full.
    pub full: u64,
    /// Views older than the last one kept.
    pub late: u64,
    /// Number of jumps back in time.
    pub jumps: u64,
}

impl Counts {
    /// Counts an unused message.
    pub(crate) fn count_refusal(&mut self, refusal: Refusal) {
        match refusal {
            Refusal::Header => self.bad_header += 1,
            Refusal::Size => self.bad_size += 1,
            Refusal::Value => self.bad_value += 1,
        }
    }

    /// Counts a view while a state is collected.
    pub(crate) fn count_verdict(&mut self, verdict: Verdict, collecting: bool) {
        match verdict {
            // Between states every view is known; counting those would say nothing.
            _ if !collecting => {}
            Verdict::Keep => self.kept += 1,
            Verdict::Known => self.known += 1,
            Verdict::Full => self.full += 1,
            Verdict::Late => self.late += 1,
        }
    }

    /// Counts kept after a reset: refusals and jumps, as they concern the neighbors.
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
