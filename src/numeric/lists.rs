//! Numbered lists, e.g. of the triangles at each vertex of a mesh.

use std::ops::Range;

/// Lists numbered from 0, all in one block of memory.
pub struct Lists<T> {
    /// Index in `all` of the first entry of each list, and the total at the end.
    first: Vec<u32>,
    all: Vec<T>,
}

impl<T: Copy + Default + Ord> Lists<T> {
    /// Builds `count` lists from entries, each given with the number of its list; entries of a list are in
    /// ascending order. Lists are short: entries are counted, not sorted.
    pub fn of_entries(count: usize, entries: impl Iterator<Item = (u32, T)> + Clone) -> Self {
        let mut first = vec![0u32; count + 1];
        entries.clone().for_each(|(list, _)| first[list as usize + 1] += 1);
        for list in 0..count {
            first[list + 1] += first[list];
        }
        let mut next = first.clone();
        let mut all = vec![T::default(); first[count] as usize];
        for (list, entry) in entries {
            all[next[list as usize] as usize] = entry;
            next[list as usize] += 1;
        }
        let mut lists = Self { first, all };
        for list in 0..count {
            let range = lists.range_of(list as u32);
            lists.all[range].sort_unstable();
        }
        lists
    }

    /// The lists without repeated entries.
    pub fn without_repeats(mut self) -> Self {
        let mut kept = 0;
        for list in 0..self.first.len() - 1 {
            let range = self.range_of(list as u32);
            let start = kept;
            for i in range {
                if kept == start || self.all[i] != self.all[kept - 1] {
                    self.all[kept] = self.all[i];
                    kept += 1;
                }
            }
            self.first[list] = start as u32;
        }
        if let Some(end) = self.first.last_mut() {
            *end = kept as u32;
        }
        self.all.truncate(kept);
        self
    }

    fn range_of(&self, list: u32) -> Range<usize> {
        self.range_of_lists(list, list)
    }

    /// Range in [`Self::entries`] of the lists from `first` to `last`.
    pub fn range_of_lists(&self, first: u32, last: u32) -> Range<usize> {
        self.first[first as usize] as usize..self.first[last as usize + 1] as usize
    }

    /// The entries of all lists, one list after the other.
    pub fn entries(&self) -> &[T] {
        &self.all
    }

    /// Entries of a list, ascending.
    pub fn list_at(&self, list: u32) -> &[T] {
        &self.all[self.range_of(list)]
    }

    /// All lists with their numbers, in their order.
    pub fn all(&self) -> impl Iterator<Item = (u32, &[T])> {
        (0..self.first.len() as u32 - 1).map(|list| (list, self.list_at(list)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn lists_hold_what_sorting_gives(pairs in prop::collection::vec((0u32..9, 0u32..5), 0..60)) {
            let mut sorted = pairs.clone();
            sorted.sort_unstable();
            let all = |lists: &Lists<u32>| -> Vec<(u32, u32)> {
                lists.all().flat_map(|(list, of)| of.iter().map(move |e| (list, *e))).collect()
            };
            let lists = Lists::of_entries(9, pairs.iter().copied());
            prop_assert_eq!(&all(&lists), &sorted);
            sorted.dedup();
            prop_assert_eq!(all(&lists.without_repeats()), sorted);
        }
    }
}
