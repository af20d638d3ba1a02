//! Work that can be asked to stop.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

/// Whether work was asked to stop. Long work checks this at least every fraction of a second; copies share
/// one flag.
#[derive(Clone, Debug, Default)]
pub struct Stop(Arc<AtomicBool>);

/// Work ended without a result, because it was asked to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped on request")]
pub struct Stopped;

impl Stop {
    /// Stops once `flag` is set.
    pub fn by(flag: Arc<AtomicBool>) -> Self {
        Self(flag)
    }

    /// Never stops.
    pub fn never() -> Self {
        Self::default()
    }

    /// Ends work that was asked to stop.
    ///
    /// # Errors
    /// [`Stopped`], so that `stop.check()?` ends a step.
    pub fn check(&self) -> Result<(), Stopped> {
        if self.0.load(Ordering::Relaxed) { Err(Stopped) } else { Ok(()) }
    }
}
