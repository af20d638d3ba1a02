//! Runs stages in order and keeps their times.

use std::time::Instant;

use super::{Event, Monitor};

/// The clock of a run.
pub struct Stages<'a> {
    /// Who is told.
    pub monitor: &'a Monitor,
    /// Name and wall seconds of every finished stage, in order.
    pub seconds: Vec<(String, f64)>,
}

impl<'a> Stages<'a> {
    /// No stage done yet.
    #[must_use]
    pub fn new(monitor: &'a Monitor) -> Self {
        Self { monitor, seconds: Vec::new() }
    }

    /// Runs one stage: tells its start and end, keeps its time, and stops before it if asked to.
    ///
    /// # Errors
    /// The stage's own error, or [`super::Cancelled`].
    pub fn run<T, E: From<super::Cancelled>>(
        &mut self,
        name: &str,
        steps: Option<usize>,
        stage: impl FnOnce(&Monitor) -> Result<T, E>,
    ) -> Result<T, E> {
        self.monitor.check()?;
        self.monitor.tell(Event::StageStarted { stage: name.to_owned(), steps });
        let start = Instant::now();
        let result = stage(self.monitor)?;
        let seconds = start.elapsed().as_secs_f64();
        self.seconds.push((name.to_owned(), seconds));
        self.monitor.tell(Event::StageFinished { stage: name.to_owned(), seconds });
        Ok(result)
    }
}
