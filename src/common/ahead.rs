//! Results computed from growing recordings before the run that needs them, kept in memory under a key of
//! their inputs.

use std::{
    any::Any,
    collections::VecDeque,
    fmt,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use crate::fingerprint::Key;

type Kept = VecDeque<(Key, Arc<dyn Any + Send + Sync>)>;

/// Work done ahead of a run, which only makes the run faster. The default keeps nothing.
#[derive(Default)]
pub struct Ahead {
    keeps: bool,
    /// Kept results, the oldest first.
    kept: Mutex<Kept>,
}

impl Ahead {
    /// An empty store that keeps results.
    pub fn new() -> Self {
        Self { keeps: true, kept: Mutex::default() }
    }

    /// The result under a key, computed if it is not known; the latest `most` results of its stage are kept.
    pub fn get_or_compute<T: Send + Sync + 'static>(
        &self,
        key: impl FnOnce() -> Key,
        most: usize,
        compute: impl FnOnce() -> T,
    ) -> Arc<T> {
        if !self.keeps {
            return Arc::new(compute());
        }
        let key = key();
        // Computed without the lock, as other threads look for other results meanwhile.
        let known = self.kept().iter().find(|(k, _)| *k == key).map(|(_, value)| Arc::clone(value));
        known.and_then(|value| value.downcast().ok()).unwrap_or_else(|| {
            let computed = Arc::new(compute());
            self.keep(key, most, Arc::clone(&computed));
            computed
        })
    }

    /// Keeps a result as the latest of its stage; `most` of a stage are kept, at least one.
    pub fn keep<T: Send + Sync + 'static>(&self, key: Key, most: usize, result: Arc<T>) {
        if !self.keeps {
            return;
        }
        let mut kept = self.kept();
        // Another thread may have computed it as well.
        kept.retain(|(k, _)| *k != key);
        let of_stage: Vec<usize> = (0..kept.len()).filter(|&i| kept[i].0.stage == key.stage).collect();
        if of_stage.len() >= most {
            kept.remove(of_stage[0]);
        }
        kept.push_back((key, result));
    }

    /// Removes the result under a key and returns it, if it is known.
    pub fn take<T: Send + Sync + 'static>(&self, key: &Key) -> Option<T> {
        let mut kept = self.kept();
        let place = kept.iter().position(|(k, _)| k == key)?;
        let (_, value) = kept.remove(place)?;
        Arc::into_inner(value.downcast().ok()?)
    }

    /// Whether the result under a key is known.
    pub fn knows(&self, key: &Key) -> bool {
        self.kept().iter().any(|(k, _)| k == key)
    }

    /// Number of results.
    pub fn count(&self) -> usize {
        self.kept().len()
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl fmt::Debug for Ahead {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Ahead({} results)", self.count())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_result_is_computed_once_and_the_oldest_of_its_stage_goes() {
        let ahead = Ahead::new();
        let of = |stage: &str, number: u8| Key::of(stage, [&[number][..]]);
        let get = |number: u8, gives: u32| *ahead.get_or_compute(|| of("a", number), 2, || gives);
        ahead.keep(of("b", 0), 1, Arc::new("b".to_owned()));
        assert_eq!([get(0, 5), get(0, 6), get(1, 7), get(2, 8)], [5, 5, 7, 8]);
        assert_eq!((get(1, 9), get(0, 9)), (7, 9), "the oldest was to go");
        assert!(ahead.knows(&of("b", 0)) && !ahead.knows(&of("b", 1)));
        assert_eq!(ahead.take::<String>(&of("b", 0)).as_deref(), Some("b"));
        assert_eq!(ahead.take::<String>(&of("b", 0)), None);
        assert_eq!(ahead.count(), 2);
        let none = Ahead::default();
        assert_eq!(*none.get_or_compute(|| of("a", 0), 2, || 4), 4);
        assert_eq!(none.count(), 0);
    }
}
