//! Sets of indices, joined pairwise.

/// Disjoint sets of indices (union-find). The smallest index of a set is its root, so the result does not
/// depend on the order of joins.
pub struct IndexSets(Vec<usize>);

impl IndexSets {
    /// Every index below `count` in a set of its own.
    pub fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    /// The smallest index of the set of `i`.
    pub fn root_of(&mut self, mut i: usize) -> usize {
        while self.0[i] != i {
            // Halves the path for later searches.
            self.0[i] = self.0[self.0[i]];
            i = self.0[i];
        }
        i
    }

    /// Makes the sets of two indices one.
    pub fn join(&mut self, a: usize, b: usize) {
        let a = self.root_of(a);
        let b = self.root_of(b);
        // The smallest index is the root: a set's name does not depend on the order of joining.
        self.0[a.max(b)] = a.min(b);
    }
}
