//! Ranges of a text exchanged for others, the rest left as it is.

use std::ops::Range;

/// Replacement of a range of bytes; an empty range is a place between two.
pub(super) type Edit = (Range<usize>, String);

/// The text with the edits made; their ranges do not overlap. Of two at one place the later in the list comes
/// later.
pub(super) fn edited(text: &str, mut edits: Vec<Edit>) -> String {
    edits.sort_by_key(|(range, _)| range.start);
    let mut changed = text.to_owned();
    // From the end backwards: a replacement does not move the ranges still to come.
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
