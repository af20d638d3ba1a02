//! A source whose fronts, summaries and indexes are read once.

use std::{
    cell::{Cell, RefCell},
    io,
    ops::Range,
};

use super::ranges::Ranges;

/// Most bytes that are kept.
const MAX_KEPT: u64 = 64 << 20;

/// A source that remembers what was read of it, up to a limit: one look at a front or a summary serves all.
pub struct Remembered<'a> {
    source: &'a dyn Ranges,
    /// Where they begin, and bytes.
    kept: RefCell<Vec<(u64, Vec<u8>)>>,
    kept_bytes: Cell<u64>,
}

impl<'a> Remembered<'a> {
    /// Remembers nothing yet.
    pub fn of(source: &'a dyn Ranges) -> Self {
        Self { source, kept: RefCell::default(), kept_bytes: Cell::default() }
    }

    fn remember(&self, start: u64, bytes: &[u8]) {
        let mut kept = self.kept.borrow_mut();
        let total = self.kept_bytes.get() + bytes.len() as u64;
        if total <= MAX_KEPT {
            self.kept_bytes.set(total);
            kept.push((start, bytes.to_vec()));
        }
    }

    /// A range in parts, of which some are known. Known ones in the middle count from `least` bytes on: they
    /// divide one request into two.
    #[must_use]
    pub fn parts(&self, range: &Range<u64>, least: u64) -> Vec<(Range<u64>, Option<Vec<u8>>)> {
        let kept = self.kept.borrow();
        let mut sorted: Vec<&(u64, Vec<u8>)> = kept.iter().collect();
        sorted.sort_by_key(|(start, _)| *start);
        let (mut parts, mut at) = (Vec::new(), range.start);
        for (start, bytes) in sorted {
            let (from, to) = ((*start).max(at), (start + bytes.len() as u64).min(range.end));
            let at_an_end = from == range.start || to == range.end;
            if to <= from || (to - from < least && !at_an_end) {
                continue;
            }
            if from > at {
                parts.push((at..from, None));
            }
            parts.push((from..to, Some(bytes[(from - start) as usize..(to - start) as usize].to_vec())));
            at = to;
        }
        if at < range.end {
            parts.push((at..range.end, None));
        }
        parts
    }

    /// What is known of a range without reading it.
    fn known(&self, range: &Range<u64>) -> Option<Vec<u8>> {
        let within = |(start, bytes): &(u64, Vec<u8>)| {
            let from = usize::try_from(range.start.checked_sub(*start)?).ok()?;
            let count = usize::try_from(range.end - range.start).ok()?;
            bytes.get(from..from.checked_add(count)?).map(<[u8]>::to_vec)
        };
        self.kept.borrow().iter().find_map(within)
    }
}

impl Ranges for Remembered<'_> {
    fn size(&self) -> u64 {
        self.source.size()
    }

    fn range(&self, start: u64, count: u64) -> io::Result<Vec<u8>> {
        if let Some(bytes) = self.known(&(start..start.saturating_add(count))) {
            return Ok(bytes);
        }
        let bytes = self.source.range(start, count)?;
        self.remember(start, &bytes);
        Ok(bytes)
    }

    fn many(&self, ranges: &[Range<u64>]) -> io::Result<Vec<Vec<u8>>> {
        // All or none: they are asked for again as a whole.
        let known: Option<Vec<Vec<u8>>> = ranges.iter().map(|r| self.known(r)).collect();
        if let Some(known) = known {
            return Ok(known);
        }
        let all = self.source.many(ranges)?;
        ranges.iter().zip(&all).for_each(|(range, bytes)| self.remember(range.start, bytes));
        Ok(all)
    }
}
