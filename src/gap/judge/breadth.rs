//! How wide a search for effects is.

/// How wide the search is.
#[derive(Clone, Copy, Debug)]
pub struct Breadth {
    /// Number of effects fitted alone.
    pub singles: usize,
    /// Number of sets of each size to be enlarged.
    pub grown: usize,
    /// Number of effects tried in addition to each of them.
    pub partners: usize,
    /// Largest set size.
    pub largest: usize,
    /// Largest set found by regression, if whole windows are predicted.
    pub regressed: usize,
}

impl Default for Breadth {
    fn default() -> Self {
        Self { singles: 9, grown: 3, partners: 5, largest: 3, regressed: 4 }
    }
}
