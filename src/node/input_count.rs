//! Message counts of a subscription: received, lost and undecodable.

use std::{
    collections::BTreeMap,
    sync::{Mutex, MutexGuard, PoisonError},
};

/// Most publishers whose sequence numbers are tracked.
const MAX_PUBLISHERS: usize = 64;

/// Counts of one subscription.
#[derive(Debug, Default)]
pub(crate) struct InputCount {
    inner: Mutex<Inner>,
}

#[derive(Debug, Default)]
struct Inner {
    snapshot: InputSnapshot,
    /// Last sequence number by publisher.
    last: BTreeMap<[u8; 16], i64>,
    /// Undecodable messages since the last good one, whose sequence numbers are unknown.
    malformed_since: u64,
}

/// A copy of the counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct InputSnapshot {
    /// Decoded messages.
    pub received: u64,
    /// Messages that could not be decoded as their type.
    pub malformed: u64,
    /// Messages lost in transport, from gaps in the publishers' sequence numbers.
    pub lost: u64,
    /// Messages dropped because the node was busy.
    pub overrun: u64,
}

impl InputCount {
    fn locked_inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a message from a publisher.
    pub(crate) fn count_received(&self, publisher: [u8; 16], sequence: i64) {
        let mut inner = self.locked_inner();
        inner.snapshot.received += 1;
        let malformed = std::mem::take(&mut inner.malformed_since);
        // DDS numbers the samples of each writer without gaps, so a gap is a loss.
        let last = inner.last.get(&publisher).copied();
        match last {
            Some(last) if sequence > last => {
                // Undecodable messages leave gaps too, but are counted as malformed.
                inner.snapshot.lost += ((sequence - last - 1) as u64).saturating_sub(malformed)
            }
            // A late message that was counted as lost.
            Some(_) => {
                inner.snapshot.lost = inner.snapshot.lost.saturating_sub(1);
                return;
            }
            // Restarted publishers count as new; the bound limits memory.
            None if inner.last.len() >= MAX_PUBLISHERS => inner.last.clear(),
            None => {}
        }
        inner.last.insert(publisher, sequence);
    }

    /// Counts an undecodable message.
    pub(crate) fn count_malformed(&self) {
        let mut inner = self.locked_inner();
        inner.snapshot.malformed += 1;
        inner.malformed_since += 1;
    }

    /// Counts a message dropped because the node was busy.
    pub(crate) fn count_overrun(&self) {
        self.locked_inner().snapshot.overrun += 1;
    }

    /// A copy of the counts.
    #[must_use]
    pub(crate) fn snapshot(&self) -> InputSnapshot {
        self.locked_inner().snapshot
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_losses_by_publisher() {
        let count = InputCount::default();
        let a = [1; 16];
        let b = [2; 16];
        [5, 6, 9].iter().for_each(|s| count.count_received(a, *s));
        [100, 101].iter().for_each(|s| count.count_received(b, *s));
        assert_eq!(count.snapshot(), InputSnapshot { received: 5, lost: 2, ..InputSnapshot::default() });
        // 7 was only late.
        count.count_received(a, 7);
        assert_eq!(count.snapshot().lost, 1);
        count.count_malformed();
        count.count_received(a, 12);
        assert_eq!((count.snapshot().lost, count.snapshot().malformed), (2, 1));
    }
}
