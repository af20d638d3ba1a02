//! How far the stage is, and whether it is to stop.

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

    /// So many are to come, whatever was expected before.
    pub fn expects(&mut self, views: usize) {
        self.total = self.done + views;
    }

    /// Views went through a step.
    pub fn did(&mut self, views: usize) {
        self.done += views;
        let total = self.total.max(self.done);
        self.monitor.report(Event::Count { stage: "capture".to_owned(), done: self.done, total });
    }
}
