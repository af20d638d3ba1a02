//! Replaces ranges of a text and leaves the rest as it is.

use std::ops::Range;

/// Replacement of a range of bytes; an empty range inserts.
pub(super) type Edit = (Range<usize>, String);

/// The text after the edits, whose ranges must not overlap. Insertions at one place stay in the order of the
/// list.
pub(super) fn edited(text: &str, mut edits: Vec<Edit>) -> String {
    edits.sort_by_key(|(range, _)| range.start);
    let mut changed = text.to_owned();
    // From the end backwards, so a replacement does not shift the ranges still to come.
    for (range, new) in edits.into_iter().rev() {
        changed.replace_range(range, &new);
    }
    changed
}

/// The empty range before an element's closing tag, if there is one.
pub(super) fn before_end(text: &str, node: roxmltree::Node) -> Range<usize> {
    let range = node.range();
    let at = text[range.clone()].rfind("</").map_or(range.end, |i| range.start + i);
    at..at
}
