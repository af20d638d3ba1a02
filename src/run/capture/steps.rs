//! Progress of the stage, and whether it should stop.

use crate::{Event, Monitor};
use common::stop::Stop;

/// Views that went through the stage's steps, out of all.
pub(super) struct Steps<'a> {
    monitor: &'a Monitor,
    pub stop: Stop,
    done: usize,
    total: usize,
}

impl<'a> Steps<'a> {
    pub fn new(monitor: &'a Monitor) -> Self {
        Self { monitor, stop: monitor.stop(), done: 0, total: 0 }
    }

    /// Sets how many views are still to come, whatever was expected before.
    pub fn expects(&mut self, views: usize) {
        self.total = self.done + views;
    }

    /// Counts views that passed a step.
    pub fn did(&mut self, views: usize) {
        self.done += views;
        let total = self.total.max(self.done);
        self.monitor.report(Event::Count { stage: "capture".to_owned(), done: self.done, total });
    }
}
