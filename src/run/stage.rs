//! Runs stages in order and records their times.

use std::time::Instant;

use serde::{Serialize, de::DeserializeOwned};

use super::{Event, Monitor, Planned, StageStore};
use common::note::{Note, NoteCode};

/// Name of the stage of a state after state 0, given the number of states.
pub(super) fn stage_of(name: &str, state: usize, count: usize) -> String {
    if count == 2 { name.to_owned() } else { format!("{name}/state{state}") }
}

/// Runs the stages of a run.
pub struct Stages<'a> {
    /// The listener for events.
    pub monitor: &'a Monitor,
    /// The store of results and of unfinished stages, for a continued run.
    pub checkpoint: Option<&'a StageStore>,
    /// The store of results for runs with other settings, used instead of the checkpoint.
    pub folder: Option<&'a StageStore>,
    /// Name and wall seconds of every finished stage, in order.
    pub seconds: Vec<(String, f64)>,
}

impl<'a> Stages<'a> {
    /// No stage has been run yet.
    pub fn new(monitor: &'a Monitor) -> Self {
        Self { monitor, checkpoint: None, folder: None, seconds: Vec::new() }
    }

    /// No stage has been run yet; results are kept in a checkpoint, or in a folder of stages.
    pub fn keeping(
        monitor: &'a Monitor,
        checkpoint: Option<&'a StageStore>,
        folder: Option<&'a StageStore>,
    ) -> Self {
        Self { checkpoint, folder, ..Self::new(monitor) }
    }

    /// Runs one stage: reports its start and end, records its time, and stops before it if requested.
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
        self.monitor.report(Event::StageStarted { stage: name.to_owned(), steps });
        let start = Instant::now();
        let result = stage(self.monitor)?;
        self.finished(name, start);
        Ok(result)
    }

    /// Runs a stage whose result is kept: takes it from the folder or the checkpoint, or computes and keeps
    /// it.
    ///
    /// If a result cannot be written, the run goes on; it only cannot be continued from there.
    ///
    /// # Errors
    /// Those of [`Self::run`].
    pub fn kept<T: Serialize + DeserializeOwned, E: From<super::Cancelled>>(
        &mut self,
        name: &str,
        steps: Option<usize>,
        stage: impl FnOnce(&Monitor) -> Result<T, E>,
    ) -> Result<T, E> {
        if let Some(found) = self.recall(name)? {
            return Ok(found);
        }
        // Copied, as `run` borrows all of the stages.
        let store = self.folder.or(self.checkpoint);
        let later = if self.folder.is_some() { "--stages" } else { "--resume" };
        self.run(name, steps, |monitor| {
            let result = stage(monitor)?;
            if let Some(Err(error)) = store.map(|store| store.save(name, &result)) {
                let text = format!(
                    "{}; the run goes on, but {later} would begin before {name}",
                    super::chain(&error)
                );
                monitor.note(&Note::new(NoteCode::StageNotKept, text));
            }
            Ok(result)
        })
    }

    /// The result of a stage from an earlier run, if there is one; the stage is then reported as begun, kept
    /// and finished.
    ///
    /// # Errors
    /// [`super::Cancelled`].
    pub fn recall<T: DeserializeOwned, E: From<super::Cancelled>>(
        &mut self,
        name: &str,
    ) -> Result<Option<T>, E> {
        self.monitor.check()?;
        let start = Instant::now();
        let store = self.folder.or(self.checkpoint);
        let Some(result) = store.and_then(|store| store.load(name, self.monitor)) else { return Ok(None) };
        let of = match self.folder {
            Some(folder) => folder.path().display().to_string(),
            None => "the run that was stopped".to_owned(),
        };
        // It takes no time from this run.
        let planned = Planned { stage: name.to_owned(), weight: 0.0 };
        self.monitor.report(Event::Planned { stages: vec![planned] });
        // As if it had run: listeners see the same stages in the same order.
        self.monitor.report(Event::StageStarted { stage: name.to_owned(), steps: None });
        let text = format!("{name} was kept from {of}");
        self.monitor.note(&Note::new(NoteCode::StageKept, text));
        self.finished(name, start);
        Ok(Some(result))
    }

    /// Reports the end of a stage and records its time.
    fn finished(&mut self, name: &str, start: Instant) {
        let seconds = start.elapsed().as_secs_f64();
        self.seconds.push((name.to_owned(), seconds));
        self.monitor.report(Event::StageFinished { stage: name.to_owned(), seconds });
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, mpsc};

    use super::*;
    use crate::{Fingerprint, RunError};

    #[test]
    fn a_stage_is_computed_once_and_a_disk_that_refuses_stops_no_run() {
        let folder = tempfile::tempdir().unwrap();
        let checkpoint = StageStore::open(folder.path(), Fingerprint::default()).unwrap();
        let run = |times: usize, gives: u32| {
            let (sender, events) = mpsc::channel();
            let monitor = Monitor::new(sender, Arc::default());
            let mut stages = Stages::keeping(&monitor, Some(&checkpoint), None);
            let mut done = 0;
            let stage = |_: &Monitor| {
                done += 1;
                Ok::<_, RunError>(gives)
            };
            let result = stages.kept("a", None, stage).unwrap();
            assert_eq!((done, stages.seconds.len(), stages.seconds[0].0.as_str()), (times, 1, "a"));
            drop(monitor);
            let reported: Vec<Event> = events.iter().collect();
            let stages = reported
                .iter()
                .filter(|e| matches!(e, Event::StageStarted { .. } | Event::StageFinished { .. }));
            assert_eq!(stages.count(), 2);
            let note = reported
                .iter()
                .find_map(|e| if let Event::Note { message, .. } = e { Some(message.clone()) } else { None });
            (result, note.unwrap_or_default())
        };
        assert_eq!(run(1, 5), (5, String::new()));
        assert_eq!(run(0, 6), (5, "a was kept from the run that was stopped".to_owned()));
        drop(folder);
        let (result, note) = run(1, 7);
        assert!(result == 7 && note.contains("the run goes on, but --resume would begin before a"), "{note}");
    }
}
