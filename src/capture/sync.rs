//! Pairing of messages by stamp.

use std::{
    cmp::Reverse,
    collections::{BTreeMap, BinaryHeap, VecDeque},
};

/// For each `left` stamp the index of its partner in `right`; `None` where none lies within `slop_nanos`.
///
/// Equal stamps are paired first, then the closest remaining pairs, the earlier one of equally close pairs.
/// Each message is used once. Neither side needs to be sorted.
#[must_use]
pub fn pair(left: &[i64], right: &[i64], slop_nanos: i64) -> Vec<Option<usize>> {
    let mut partners = vec![None; left.len()];
    let mut free = Free::new(left, right, &mut partners);
    // No stamp lies within the closest pair, so only neighbors can form one.
    let mut closest: BinaryHeap<_> =
        (0..free.stamps.len()).filter_map(|at| free.pair_behind(at, slop_nanos)).collect();
    while let Some(Reverse((key, at))) = closest.pop() {
        // A heap entry is stale once a closer pair has used one of its stamps.
        if free.pair_behind(at, slop_nanos) != Some(Reverse((key, at))) {
            continue;
        }
        let pair = free.take(at);
        partners[pair.left] = Some(pair.right);
        closest.extend(pair.around.into_iter().flatten().filter_map(|at| free.pair_behind(at, slop_nanos)));
    }
    partners
}

/// Heap key: difference of the stamps, left and right stamp; and the index of the first of them.
type Closest = Reverse<((u64, i64, i64), usize)>;

/// Messages without a partner, in order of stamp.
struct Free {
    stamps: Vec<Stamp>,
    /// Index of the next and of the previous stamp with a free message; the number of stamps where there is
    /// none.
    next: Vec<usize>,
    before: Vec<usize>,
}

/// Messages with one stamp, in order of arrival; all from one side.
struct Stamp {
    nanos: i64,
    is_left: bool,
    messages: VecDeque<usize>,
}

impl Free {
    /// Pairs equal stamps and returns the remaining messages.
    fn new(left: &[i64], right: &[i64], partners: &mut [Option<usize>]) -> Self {
        let mut sides = BTreeMap::<i64, [VecDeque<usize>; 2]>::new();
        for (side, list) in [left, right].into_iter().enumerate() {
            list.iter()
                .enumerate()
                .for_each(|(i, stamp)| sides.entry(*stamp).or_default()[side].push_back(i));
        }
        let mut stamps = Vec::new();
        for (nanos, [mut lefts, mut rights]) in sides {
            // Equal stamps are of one exposure; pair them in order of arrival.
            let equal = lefts.len().min(rights.len());
            lefts.drain(..equal).zip(rights.drain(..equal)).for_each(|(l, r)| partners[l] = Some(r));
            let is_left = !lefts.is_empty();
            stamps.push(Stamp { nanos, is_left, messages: if is_left { lefts } else { rights } });
        }
        stamps.retain(|s| !s.messages.is_empty());
        let count = stamps.len();
        Self {
            stamps,
            next: (1..=count).collect(),
            before: (0..count).map(|i| i.checked_sub(1).unwrap_or(count)).collect(),
        }
    }

    /// The pair of a stamp and the next one, if they are from different sides and within the slop.
    fn pair_behind(&self, at: usize, slop_nanos: i64) -> Option<Closest> {
        let first = self.stamps.get(at)?;
        let second = self.stamps.get(self.next[at])?;
        let apart = first.nanos.abs_diff(second.nanos);
        let (l, r) = if first.is_left { (first, second) } else { (second, first) };
        let fits = l.is_left && !r.is_left && !l.messages.is_empty() && !r.messages.is_empty();
        (fits && i64::try_from(apart).is_ok_and(|a| a <= slop_nanos))
            .then_some(Reverse(((apart, l.nanos, r.nanos), at)))
    }

    /// Removes a message of a stamp and one of the next.
    fn take(&mut self, at: usize) -> TakenPair {
        let second = self.next[at];
        let mut taken = [0; 2];
        for place in [at, second] {
            let side = usize::from(!self.stamps[place].is_left);
            taken[side] = self.stamps[place].messages.pop_front().unwrap_or_default();
            if self.stamps[place].messages.is_empty() {
                let before = self.before[place];
                let next = self.next[place];
                if let Some(link) = self.next.get_mut(before) {
                    *link = next;
                }
                if let Some(link) = self.before.get_mut(next) {
                    *link = before;
                }
            }
        }
        let alive = |place: usize| (!self.stamps[place].messages.is_empty()).then_some(place);
        // Removed stamps make others neighbors, which may now be the closest pair.
        let first = alive(at).or_else(|| Some(self.before[at]).filter(|b| *b < self.stamps.len()));
        TakenPair { left: taken[0], right: taken[1], around: [first, alive(second)] }
    }
}

/// Two messages paired with each other.
struct TakenPair {
    left: usize,
    right: usize,
    /// Indices of stamps with new neighbors.
    around: [Option<usize>; 2],
}

/// Index of the nearest among increasing stamps, the earlier of two equally near; `None` for an empty list.
#[must_use]
pub fn nearest_stamp(rising: &[i64], stamp: i64) -> Option<usize> {
    let after = rising.partition_point(|s| *s < stamp);
    // The first of equal stamps.
    let before = after.checked_sub(1).map(|last| rising.partition_point(|s| *s < rising[last]));
    let after = Some(after).filter(|i| *i < rising.len());
    before.into_iter().chain(after).min_by_key(|i| (rising[*i].abs_diff(stamp), *i))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn exact_stamps_come_first_and_strangers_stay_alone() {
        // 100 has an exact partner, so 101 must take what is left within reach.
        assert_eq!(pair(&[100, 101, 500], &[100, 99, 900], 3), [Some(0), Some(1), None]);
        assert_eq!(pair(&[10, 20], &[], 5), [None, None]);
        assert_eq!(pair(&[10], &[15, 5], 5), [Some(1)]);
        assert_eq!(pair(&[10], &[16], 5), [None]);
    }

    #[test]
    fn the_nearest_stamp() {
        assert_eq!(nearest_stamp(&[1, 5, 9], 2), Some(0));
        assert_eq!(nearest_stamp(&[1, 5], 3), Some(0));
        assert_eq!(nearest_stamp(&[1, 1, 5, 5], 3), Some(0));
        assert_eq!(nearest_stamp(&[1, 1, 5, 5], 4), Some(2));
        assert_eq!(nearest_stamp(&[1, 5], 50), Some(1));
        assert_eq!(nearest_stamp(&[], 2), None);
    }

    #[test]
    fn many_within_reach_cost_no_more() {
        let begun = std::time::Instant::now();
        let partners = pair(&vec![7; 200_000], &vec![7; 100_000], 15_000_000);
        assert!((0..200_000).all(|i| partners[i] == (i < 100_000).then_some(i)));
        // All want the same partner, which is as far from the next as they are many.
        let (left, right): (Vec<i64>, Vec<i64>) =
            ((0..100_000).collect(), (1..=100_000).map(|i| i * 100_000).collect());
        assert_eq!(pair(&left, &right, i64::MAX).iter().flatten().count(), 100_000);
        assert!(begun.elapsed().as_secs() < 3, "{:?}", begun.elapsed());
    }

    /// All pairs within reach, the closest first.
    fn by_definition(left: &[i64], right: &[i64], slop: i64) -> Vec<Option<usize>> {
        let all = (0..left.len()).flat_map(|l| (0..right.len()).map(move |r| (l, r)));
        let mut all: Vec<_> = all
            .map(|(l, r)| ((right[r] - left[l]).abs(), left[l], right[r], l, r))
            .filter(|c| c.0 <= slop)
            .collect();
        all.sort_unstable();
        let mut partners = vec![None; left.len()];
        let mut used = vec![false; right.len()];
        for (_, _, _, l, r) in all {
            if partners[l].is_none() && !used[r] {
                (partners[l], used[r]) = (Some(r), true);
            }
        }
        partners
    }

    proptest! {
        #[test]
        fn pairs_are_those_of_the_definition(
            left in prop::collection::vec(0..40i64, 0..25),
            right in prop::collection::vec(0..40i64, 0..25),
            slop in 0..9i64,
        ) {
            prop_assert_eq!(pair(&left, &right, slop), by_definition(&left, &right, slop));
        }

        #[test]
        fn partners_are_unique_and_close_and_order_does_not_matter(
            left in prop::collection::btree_set(0..2000i64, 0..40),
            right in prop::collection::btree_set(0..2000i64, 0..40),
            slop in 0..60i64,
        ) {
            let (left, right): (Vec<_>, Vec<_>) = (left.into_iter().collect(), right.into_iter().collect());
            let partners = pair(&left, &right, slop);
            let mut used: Vec<_> = partners.iter().flatten().collect();
            used.sort();
            used.dedup();
            prop_assert_eq!(used.len(), partners.iter().flatten().count());
            for (l, r) in partners.iter().enumerate() {
                match r {
                    Some(r) => prop_assert!((left[l] - right[*r]).abs() <= slop),
                    None => {
                        let taken =
                            |i: usize, s: i64| (s - left[l]).abs() > slop || partners.contains(&Some(i));
                        prop_assert!(right.iter().enumerate().all(|(i, s)| taken(i, *s)));
                    }
                }
            }
            let reversed: Vec<_> = right.iter().rev().copied().collect();
            let mirrored: Vec<_> = pair(&left, &reversed, slop)
                .into_iter()
                .map(|p| p.map(|i| right.len() - 1 - i))
                .collect();
            prop_assert_eq!(mirrored, partners);
        }
    }
}
