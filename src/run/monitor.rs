//! Events from a running pipeline, and requests to stop it.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
    mpsc::Sender,
};

use serde::Serialize;

use common::{
    note::{Note, NoteCode},
    stop::{Stop, Stopped},
};

/// A stage that is still to come.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Planned {
    /// Name, e.g. `field/state0`.
    pub stage: String,
    /// Its share of the time, relative to the other stages; 0 if it is skipped.
    pub weight: f64,
}

/// One event. `--json` writes it as a line of JSON with the variant's name in snake case as `event` and the
/// fields below. A non-finite number is `null`.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// Stages are to come, or their weights have changed.
    Planned {
        /// The stages, in order.
        stages: Vec<Planned>,
    },
    /// A stage began.
    StageStarted {
        /// Name, e.g. `field/state0`.
        stage: String,
        /// Number of steps it will take, if known.
        steps: Option<usize>,
    },
    /// A step of a stage was done.
    Step {
        /// Name of the stage.
        stage: String,
        /// Number of steps done.
        done: usize,
        /// Total number of steps.
        total: usize,
        /// Current loss.
        loss: f64,
    },
    /// A part of a stage without a loss was done.
    Count {
        /// Name of the stage.
        stage: String,
        /// Number of parts done.
        done: usize,
        /// Total number of parts.
        total: usize,
    },
    /// A stage ended.
    StageFinished {
        /// Name of the stage.
        stage: String,
        /// Wall time, seconds.
        seconds: f64,
    },
    /// The run is degraded.
    Warning {
        /// What it is about.
        code: NoteCode,
        /// A sentence.
        message: String,
    },
    /// Something to report.
    Note {
        /// What it is about.
        code: NoteCode,
        /// A sentence.
        message: String,
    },
    /// A file has been written.
    Artifact {
        /// Its path.
        path: String,
    },
    /// One of several objects failed; the others continue.
    Failed {
        /// A message that names the place and the remedy.
        message: String,
    },
    /// The run ended without a result. This is the last event.
    Error {
        /// A message that names the place and the remedy.
        message: String,
        /// Exit code of the program.
        exit_code: u8,
    },
}

/// The run was asked to stop.
#[derive(Debug, Default, thiserror::Error)]
#[error("stopped on request{}{kept}", if kept.is_empty() { "" } else { "; " })]
pub struct Cancelled {
    /// Which results were kept, where, and how to continue; empty if there are none.
    pub kept: String,
}

impl From<Stopped> for Cancelled {
    fn from(Stopped: Stopped) -> Self {
        Self::default()
    }
}

/// Given to every stage: reports events and says whether to stop.
#[derive(Clone)]
pub struct Monitor {
    events: Sender<Event>,
    cancel: Arc<AtomicBool>,
    /// Name of the object, if there are several.
    object: Option<String>,
}

impl Monitor {
    /// A monitor that reports to `events` and stops once `cancel` is set.
    pub fn new(events: Sender<Event>, cancel: Arc<AtomicBool>) -> Self {
        Self { events, cancel, object: None }
    }

    /// A monitor without a listener.
    pub fn silent() -> Self {
        Self::new(std::sync::mpsc::channel().0, Arc::default())
    }

    /// The same monitor for one of several objects: its stages are `object/stage`, and its sentences begin
    /// with its name.
    #[must_use]
    pub fn of_object(&self, name: &str) -> Self {
        Self { object: Some(name.to_owned()), ..self.clone() }
    }

    /// Reports an event to whoever still listens.
    pub fn report(&self, mut event: Event) {
        if let Some(object) = &self.object {
            match &mut event {
                Event::Planned { stages } => {
                    stages.iter_mut().for_each(|p| p.stage = format!("{object}/{}", p.stage));
                }
                Event::StageStarted { stage, .. }
                | Event::Step { stage, .. }
                | Event::Count { stage, .. }
                | Event::StageFinished { stage, .. } => {
                    // Done here, as the stages know nothing of other objects.
                    *stage = format!("{object}/{stage}");
                }
                Event::Warning { message, .. }
                | Event::Note { message, .. }
                | Event::Failed { message }
                | Event::Error { message, .. } => {
                    *message = format!("{object}: {message}");
                }
                Event::Artifact { .. } => {}
            }
        }
        // A run continues without its listener.
        self.events.send(event).ok();
    }

    /// Reports that the run is degraded.
    pub fn warn(&self, note: &Note) {
        self.report(Event::Warning { code: note.code, message: note.text.clone() });
    }

    /// Reports a note.
    pub fn note(&self, note: &Note) {
        self.report(Event::Note { code: note.code, message: note.text.clone() });
    }

    /// The handle through which long work is asked to stop.
    pub fn stop(&self) -> Stop {
        Stop::by(Arc::clone(&self.cancel))
    }

    /// Returns early from a loop once a stop was requested.
    ///
    /// # Errors
    /// [`Cancelled`], so that `monitor.check()?` ends the stage.
    pub fn check(&self) -> Result<(), Cancelled> {
        if self.cancel.load(Ordering::Relaxed) { Err(Cancelled::default()) } else { Ok(()) }
    }
}
