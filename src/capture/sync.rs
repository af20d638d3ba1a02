//! Pairing of messages by their stamps.

/// Partner of each `left` stamp among the `right` ones, as an index; `None` where none lies within `slop_nanos`.
///
/// Equal stamps are paired first, then the closest remaining pairs, the earlier first among equals. Each message is
/// used once. Neither side needs to be sorted.
#[must_use]
pub fn pair(left: &[i64], right: &[i64], slop_nanos: i64) -> Vec<Option<usize>> {
    let mut order: Vec<usize> = (0..right.len()).collect();
    order.sort_by_key(|i| right[*i]);
    let mut candidates = Vec::new();
    for (l, stamp) in left.iter().enumerate() {
        let first = order.partition_point(|i| right[*i] < stamp.saturating_sub(slop_nanos));
        for r in order[first..].iter().take_while(|i| right[**i] <= stamp.saturating_add(slop_nanos)) {
            candidates.push(((right[*r] - stamp).abs(), *stamp, right[*r], l, *r));
        }
    }
    candidates.sort_unstable();
    let mut partners = vec![None; left.len()];
    let mut used = vec![false; right.len()];
    for (_, _, _, l, r) in candidates {
        if partners[l].is_none() && !used[r] {
            partners[l] = Some(r);
            used[r] = true;
        }
    }
    partners
}

/// Index of the stamp nearest to `stamp`, the earlier one among equals; `None` of none.
#[must_use]
pub fn nearest(stamps: &[i64], stamp: i64) -> Option<usize> {
    (0..stamps.len()).min_by_key(|i| (stamps[*i].abs_diff(stamp), stamps[*i]))
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
        assert_eq!(nearest(&[5, 1, 9], 2), Some(1));
        assert_eq!(nearest(&[5, 1], 3), Some(1));
        assert_eq!(nearest(&[], 2), None);
    }

    proptest! {
        #[test]
        fn partners_are_unique_and_close_and_order_does_not_matter(
            left in prop::collection::btree_set(0..2000i64, 0..40), right in prop::collection::btree_set(0..2000i64, 0..40), slop in 0..60i64,
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
                    None => prop_assert!(right.iter().enumerate().all(|(i, s)| (s - left[l]).abs() > slop || partners.contains(&Some(i)))),
                }
            }
            let reversed: Vec<_> = right.iter().rev().copied().collect();
            let mirrored: Vec<_> = pair(&left, &reversed, slop).into_iter().map(|p| p.map(|i| right.len() - 1 - i)).collect();
            prop_assert_eq!(mirrored, partners);
        }
    }
}
