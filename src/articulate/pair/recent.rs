//! The last few results of a function, by what they were made of.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, PoisonError},
};

/// Results that are kept while no more than so many others were made after them.
pub(crate) struct Recent<K, V> {
    most: usize,
    all: Mutex<VecDeque<(K, Arc<V>)>>,
}

impl<K: PartialEq, V> Recent<K, V> {
    /// Keeps so many results.
    pub(crate) fn keeping(most: usize) -> Self {
        Self { most, all: Mutex::default() }
    }

    /// The result of a key, made now unless it is kept.
    pub(crate) fn get(&self, key: K, make: impl FnOnce() -> V) -> Arc<V> {
        let kept =
            |all: &VecDeque<(K, Arc<V>)>| all.iter().find(|(k, _)| *k == key).map(|(_, v)| Arc::clone(v));
        let lock = || self.all.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = kept(&lock()) {
            return found;
        }
        // The lock is free while it is made, as other threads ask for others.
        let made = Arc::new(make());
        let mut all = lock();
        // Another thread may have been faster.
        if kept(&all).is_none() {
            all.truncate(self.most.saturating_sub(1));
            all.push_front((key, Arc::clone(&made)));
        }
        made
    }

    /// Gives up all of them.
    pub(crate) fn clear(&self) {
        self.all.lock().unwrap_or_else(PoisonError::into_inner).clear();
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
