//! How wide a search for effects is.

/// How wide the search is.
#[derive(Clone, Copy, Debug)]
pub struct Breadth {
    /// Effects fitted alone.
    pub singles: usize,
    /// Grown sets of each size.
    pub grown: usize,
    /// Effects tried beside each of them.
    pub partners: usize,
    /// Largest set.
    pub largest: usize,
    /// Largest regressed set, where whole windows are predicted.
    pub regressed: usize,
}

impl Default for Breadth {
    fn default() -> Self {
        Self { singles: 9, grown: 3, partners: 5, largest: 3, regressed: 4 }
    }
}
