//! Online matching of images by stamp, by the same rule as for recordings ([`capture::pair`]).

use std::collections::VecDeque;

use capture::pair;

/// Number of image kinds: color, depth, mask.
pub(crate) const ROLES: usize = 3;

/// Images that wait for a match.
#[derive(Debug)]
pub(crate) struct Synchronizer<T> {
    slop_nanos: i64,
    /// Most waiting images per kind.
    depth: usize,
    queues: [VecDeque<(i64, T)>; ROLES],
    /// Which kinds a complete set needs; color always.
    needed: [bool; ROLES],
    /// Newest stamp per kind, nanoseconds.
    newest: [Option<i64>; ROLES],
    /// Number of matched sets.
    pub matched: u64,
    /// Number of images dropped without a match, by kind.
    pub unmatched: [u64; ROLES],
}

/// A complete set with the stamp of its color image.
#[derive(Debug, PartialEq)]
pub(crate) struct Matched<T> {
    /// Stamp, nanoseconds.
    pub stamp_nanos: i64,
    /// Color, depth, mask.
    pub images: [Option<T>; ROLES],
}

impl<T> Synchronizer<T> {
    /// Pairs stamps at most `slop_nanos` apart.
    #[must_use]
    pub(crate) fn new(slop_nanos: i64, depth: usize, with_masks: bool) -> Self {
        Self {
            slop_nanos,
            depth,
            queues: Default::default(),
            needed: [true, true, with_masks],
            newest: [None; ROLES],
            matched: 0,
            unmatched: [0; ROLES],
        }
    }

    /// Drops waiting images with a later stamp, after time jumped back to this one; they count as unmatched.
    pub(crate) fn forget_after(&mut self, stamp_nanos: i64) {
        for (role, queue) in self.queues.iter_mut().enumerate() {
            let before = queue.len();
            queue.retain(|e| e.0 <= stamp_nanos);
            self.unmatched[role] += (before - queue.len()) as u64;
            self.newest[role] = queue.iter().map(|e| e.0).max();
        }
    }

    /// Number of waiting images.
    #[must_use]
    pub(crate) fn waiting(&self) -> usize {
        self.queues.iter().map(VecDeque::len).sum()
    }

    /// Adds an image of a kind; returns the completed sets in order of stamp.
    pub(crate) fn push(&mut self, role: usize, stamp_nanos: i64, image: T) -> Vec<Matched<T>> {
        // A kind without matches must not fill the memory.
        if self.queues[role].len() == self.depth {
            self.queues[role].pop_front();
            self.unmatched[role] += 1;
        }
        self.queues[role].push_back((stamp_nanos, image));
        self.newest[role] = self.newest[role].max(Some(stamp_nanos));
        let mut found = self.take_settled();
        self.prune_images();
        found.sort_by_key(|m| m.stamp_nanos);
        self.matched += found.len() as u64;
        found
    }

    /// Removes the sets that are final, and the color images that can no longer be completed.
    fn take_settled(&mut self) -> Vec<Matched<T>> {
        let stamps = |queue: &VecDeque<(i64, T)>| queue.iter().map(|e| e.0).collect::<Vec<_>>();
        let color = stamps(&self.queues[0]);
        // The rule for recordings, applied again for each image: queues are short, and the bag gives the same
        // sets.
        let partners: Vec<Option<Vec<Option<usize>>>> = (0..ROLES)
            .map(|r| {
                (r > 0 && self.needed[r]).then(|| pair(&color, &stamps(&self.queues[r]), self.slop_nanos))
            })
            .collect();
        // Final sets are returned; color images that cannot be completed are dropped.
        let mut whole = Vec::new();
        let mut hopeless = Vec::new();
        for (i, stamp) in color.iter().enumerate() {
            let states: Vec<Fate> = (1..ROLES)
                .filter_map(|r| partners[r].as_ref().map(|p| self.fate_of_image(r, *stamp, p[i])))
                .collect();
            // One kind that cannot match is enough.
            if states.contains(&Fate::Never) {
                hopeless.push(i);
            } else if states.iter().all(|s| *s == Fate::Settled) {
                whole.push(i);
            }
        }
        let mut found = Vec::new();
        let mut taken: [Vec<usize>; ROLES] = Default::default();
        for &i in &whole {
            taken[0].push(i);
            (1..ROLES).for_each(|r| taken[r].extend(partners[r].as_ref().and_then(|p| p[i])));
        }
        let mut images: Vec<Vec<(usize, (i64, T))>> = Vec::new();
        self.unmatched[0] += hopeless.len() as u64;
        for r in 0..ROLES {
            let mut kept = VecDeque::new();
            let mut out = Vec::new();
            for (i, entry) in std::mem::take(&mut self.queues[r]).into_iter().enumerate() {
                if taken[r].contains(&i) {
                    out.push((i, entry));
                } else if r > 0 || !hopeless.contains(&i) {
                    kept.push_back(entry);
                }
            }
            self.queues[r] = kept;
            images.push(out);
        }
        for i in whole {
            let mut set: [Option<T>; ROLES] = Default::default();
            for (r, image) in set.iter_mut().enumerate() {
                let partner = if r == 0 { Some(i) } else { partners[r].as_ref().and_then(|p| p[i]) };
                let at = partner.and_then(|partner| images[r].iter().position(|(k, _)| *k == partner));
                *image = at.map(|at| images[r].swap_remove(at).1.1);
            }
            found.push(Matched { stamp_nanos: color[i], images: set });
        }
        found
    }

    /// What can still happen to a color image with respect to one kind.
    fn fate_of_image(&self, role: usize, stamp: i64, partner: Option<usize>) -> Fate {
        // Assumes that images of one kind arrive in order of stamp.
        let passed = self.newest[role].is_some_and(|n| n > stamp + self.slop_nanos);
        match partner {
            Some(p) if self.queues[role].get(p).is_some_and(|e| e.0 == stamp) => Fate::Settled,
            // A closer image could arrive until the kind has passed the stamp.
            Some(_) if passed => Fate::Settled,
            None if passed => Fate::Never,
            _ => Fate::Open,
        }
    }

    /// Drops depth images and masks that no color image can need.
    fn prune_images(&mut self) {
        // Before the first color image, any could be needed.
        let Some(newest) = self.newest[0] else { return };
        let oldest = self.queues[0].iter().map(|e| e.0).min().unwrap_or(newest).min(newest);
        for r in 1..ROLES {
            let before = self.queues[r].len();
            self.queues[r].retain(|e| e.0 >= oldest - self.slop_nanos);
            self.unmatched[r] += (before - self.queues[r].len()) as u64;
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    Settled,
    Never,
    Open,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamps(found: &[Matched<u32>]) -> Vec<(i64, u32, u32)> {
        found.iter().map(|m| (m.stamp_nanos, m.images[0].unwrap(), m.images[1].unwrap())).collect()
    }

    #[test]
    fn equal_stamps_are_a_set_at_once_in_either_order() {
        let mut sync = Synchronizer::new(5, 10, false);
        assert!(sync.push(0, 100, 1).is_empty());
        assert_eq!(stamps(&sync.push(1, 100, 2)), [(100, 1, 2)]);
        assert!(sync.push(1, 200, 3).is_empty());
        assert_eq!(stamps(&sync.push(0, 200, 4)), [(200, 4, 3)]);
        assert_eq!((sync.matched, sync.unmatched, sync.waiting()), (2, [0; 3], 0));
    }

    #[test]
    fn the_nearer_partner_is_waited_for() {
        let mut sync = Synchronizer::new(5, 10, false);
        sync.push(0, 100, 1);
        assert!(sync.push(1, 96, 2).is_empty());
        assert!(sync.push(1, 101, 3).is_empty());
        // Past 105 nothing nearer than 101 can come.
        assert_eq!(stamps(&sync.push(1, 106, 4)), [(100, 1, 3)]);
        // 96 and 106 may still be those of a color image at 101 or later; 96 is not once one at 102 came.
        assert_eq!((sync.unmatched, sync.waiting()), ([0; 3], 2));
        assert_eq!(stamps(&sync.push(0, 106, 5)), [(106, 5, 4)]);
        assert_eq!((sync.unmatched, sync.waiting()), ([0, 1, 0], 0));
    }

    #[test]
    fn images_without_partner_are_counted() {
        let mut sync = Synchronizer::new(5, 10, false);
        sync.push(0, 100, 1);
        assert_eq!(stamps(&sync.push(1, 120, 2)), []);
        assert_eq!(sync.unmatched, [1, 0, 0]);
        assert_eq!(stamps(&sync.push(0, 120, 3)), [(120, 3, 2)]);
        // Nothing but color: the queue is bounded.
        for i in 0..25 {
            sync.push(0, 200 + i, 4);
        }
        assert_eq!((sync.unmatched[0], sync.waiting()), (16, 10));
        sync.forget_after(i64::MIN);
        assert_eq!((sync.unmatched[0], sync.waiting()), (26, 0));
    }

    #[test]
    fn with_masks_a_set_has_three() {
        let mut sync = Synchronizer::new(5, 10, true);
        sync.push(0, 100, 1);
        assert!(sync.push(1, 100, 2).is_empty());
        let found = sync.push(2, 100, 3);
        assert_eq!(found, [Matched { stamp_nanos: 100, images: [Some(1), Some(2), Some(3)] }]);
        sync.push(0, 200, 1);
        sync.push(1, 200, 1);
        assert!(sync.push(2, 300, 1).is_empty());
        assert_eq!(sync.unmatched, [1, 0, 0]);
    }

    #[test]
    fn any_order_of_arrival_gives_the_pairs_of_a_recording() {
        let color: Vec<i64> = (0..20).map(|i| 1000 * i).collect();
        let depth: Vec<i64> = color.iter().map(|s| s + (s / 1000 * 7919) % 9 - 4).collect();
        let offline = pair(&color, &depth, 5);
        let mut sync = Synchronizer::new(5, 30, false);
        let mut found = Vec::new();
        // Depth comes three images late.
        for i in 0..23 {
            if let Some(s) = color.get(i) {
                found.extend(stamps(&sync.push(0, *s, i as u32)));
            }
            if i >= 3 {
                found.extend(stamps(&sync.push(1, depth[i - 3], i as u32 - 3)));
            }
        }
        found.extend(stamps(&sync.push(1, 1_000_000, 99)));
        let expected: Vec<_> =
            offline.iter().enumerate().map(|(c, d)| (color[c], c as u32, d.unwrap() as u32)).collect();
        assert_eq!(found, expected);
    }
}
