//! A cache for the last few results of a function.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

/// The results for the last `most` keys.
pub(crate) struct Recent<K, V> {
    most: usize,
    all: Mutex<VecDeque<(K, Arc<V>)>>,
}

impl<K: PartialEq, V> Recent<K, V> {
    /// A cache of `most` results.
    pub(crate) fn keeping(most: usize) -> Self {
        Self { most, all: Mutex::default() }
    }

    /// The result for a key, computed now unless it is kept.
    pub(crate) fn get(&self, key: K, make: impl FnOnce() -> V) -> Arc<V> {
        if let Some((_, found)) = self.lock().iter().find(|(k, _)| *k == key) {
            return Arc::clone(found);
        }
        // The lock is released while the result is computed: other threads need other results.
        let made = Arc::new(make());
        let mut all = self.lock();
        // Another thread may have been faster.
        if all.iter().all(|(k, _)| *k != key) {
            all.truncate(self.most.saturating_sub(1));
            all.push_front((key, Arc::clone(&made)));
        }
        made
    }

    /// Drops all results.
    pub(crate) fn clear(&self) {
        self.lock().clear();
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<(K, Arc<V>)>> {
        self.all.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    #[test]
    fn a_result_is_made_once_while_it_is_kept() {
        let recent = Recent::keeping(2);
        let made = Cell::new(0);
        let square = |k: i32| {
            *recent.get(k, || {
                made.set(made.get() + 1);
                k * k
            })
        };
        assert_eq!([3, 3, 4, 3].map(square), [9, 9, 16, 9]);
        assert_eq!(made.get(), 2);
        // A third takes the place of the one made first.
        assert_eq!([5, 4, 3].map(square), [25, 16, 9]);
        assert_eq!(made.get(), 4);
        recent.clear();
        assert_eq!((square(3), made.get()), (9, 5));
    }
}
