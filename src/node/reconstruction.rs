//! Runs the pipeline of the command line on the recordings of a session, on a thread of its own.

use std::{
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Instant,
};

use tokio::sync::{mpsc, watch};

use super::{collection::Shared, progress::RunProgress};
use crate::{
    config::{Config, Origins},
    io::{
        RunSummary, read_run_summary,
        ros2msg::status::{ReconstructFeedback, ReconstructGoal},
    },
    run::{self, Event, Monitor, Outcome, ReconstructRequest, RunError},
};

/// A finished twin, as it is published.
#[derive(Clone, Debug, PartialEq)]
pub struct Twin {
    /// What its run folder tells.
    pub summary: RunSummary,
    /// The observed state that is shown.
    pub state: usize,
    /// Frame in which it stands.
    pub world_frame: String,
}

/// Starts runs.
pub struct Reconstructor {
    /// Settings but for what a goal gives.
    pub config: Config,
    /// Where they come from.
    pub origins: Origins,
    /// Name of a twin that a goal does not name.
    pub name: String,
    /// What the core tells.
    pub shared: Arc<Shared>,
    /// Gets the twin of every run that succeeds.
    pub twins: watch::Sender<Option<Arc<Twin>>>,
    /// Whether a run goes on.
    pub busy: AtomicBool,
}

/// How a run ended.
#[derive(Debug)]
pub enum Finished {
    /// With a twin; a sentence about it.
    Twin(Arc<Twin>, String),
    /// It was asked to stop.
    Canceled,
    /// Without a twin; why.
    Failed(String),
}

/// What a run tells.
#[derive(Debug)]
pub enum News {
    /// How far it is.
    Feedback(ReconstructFeedback),
    /// It is over. The last news.
    Ended(Finished),
}

/// A run that goes on.
pub struct Reconstruction {
    news: mpsc::Receiver<News>,
    cancel: Arc<AtomicBool>,
}

impl Reconstruction {
    /// Waits for news.
    pub async fn next(&mut self) -> News {
        let lost = || News::Ended(Finished::Failed("the run ended without a word".into()));
        self.news.recv().await.unwrap_or_else(lost)
    }

    /// Asks it to stop after its present step.
    pub fn cancel(&self) {
        self.cancel.store(true, Ordering::Relaxed);
    }
}

impl Drop for Reconstruction {
    fn drop(&mut self) {
        self.cancel();
    }
}

impl Reconstructor {
    /// Starts a run on what was collected.
    ///
    /// # Errors
    /// A sentence: a state is missing, or the number of parts.
    pub fn begin(self: &Arc<Self>, goal: &ReconstructGoal) -> Result<Reconstruction, String> {
        let request = self.request(goal)?;
        if self.busy.swap(true, Ordering::AcqRel) {
            return Err("another run goes on; wait for it or cancel it".into());
        }
        let cancel = Arc::new(AtomicBool::new(false));
        let (send, news) = mpsc::channel(256);
        let (events, listener) = std::sync::mpsc::channel();
        let mut progress = RunProgress::new(request.config.trains_fields());
        let feedback = send.clone();
        std::thread::spawn(move || {
            let start = Instant::now();
            for event in listener {
                if let Event::Warning { message } = &event {
                    log::warn!("{message}");
                }
                if progress.take(&event) {
                    // A client that is slow misses some; the end is sent apart.
                    feedback.try_send(News::Feedback(progress.feedback(start.elapsed()))).ok();
                }
            }
        });
        let (this, stop) = (Arc::clone(self), Arc::clone(&cancel));
        std::thread::spawn(move || {
            let result = run::reconstruct(&request, &Monitor::new(events, stop));
            let finished = this.finish(result);
            this.busy.store(false, Ordering::Release);
            send.blocking_send(News::Ended(finished)).ok();
        });
        Ok(Reconstruction { news, cancel })
    }

    fn request(&self, goal: &ReconstructGoal) -> Result<ReconstructRequest, String> {
        let snapshot = self.shared.snapshot();
        let Some(recordings) = snapshot.recordings else {
            let [zero, one] = snapshot.kept;
            return Err(format!(
                "both states must be collected first; state 0 has {zero} views, state 1 has {one}, or one is not finished"
            ));
        };
        let mut config = self.config.clone();
        if goal.parts > 0 {
            config.run.parts = Some(goal.parts as usize);
        }
        let name = if goal.name.is_empty() { self.name.clone() } else { goal.name.clone() };
        let out = snapshot.session;
        write_settings(&out.join("settings.yaml"), &config)?;
        Ok(ReconstructRequest { sources: recordings.into(), out, name: Some(name), config, origins: self.origins.clone(), resume: false })
    }

    fn finish(&self, result: Result<Outcome, RunError>) -> Finished {
        let outcome = match result {
            Ok(outcome) => outcome,
            Err(RunError::Cancelled(_)) => return Finished::Canceled,
            Err(error) => return Finished::Failed(chain(&error)),
        };
        let summary = match read_run_summary(&outcome.folder) {
            Ok(summary) => summary,
            Err(error) => return Finished::Failed(error.to_string()),
        };
        let message = match outcome.warnings.first() {
            None => format!("{} joints", summary.joints.len()),
            Some(first) => format!("{} joints; {} warnings, the first: {first}", summary.joints.len(), outcome.warnings.len()),
        };
        let world_frame = self.shared.snapshot().world_frame.unwrap_or_else(|| "world".into());
        let twin = Arc::new(Twin { summary, state: 1, world_frame });
        self.twins.send_replace(Some(Arc::clone(&twin)));
        Finished::Twin(twin, message)
    }
}

/// Keeps the settings beside the recordings, so that `artitwin reconstruct --config` repeats the run.
fn write_settings(path: &Path, config: &Config) -> Result<(), String> {
    let text = serde_norway::to_string(config).map_err(|e| e.to_string())?;
    std::fs::write(path, text).map_err(|e| format!("cannot write `{}`: {e}", path.display()))
}

/// An error and what led to it, on one line.
fn chain(error: &RunError) -> String {
    let mut text = error.to_string();
    let mut cause = std::error::Error::source(error);
    while let Some(error) = cause {
        let told = error.to_string();
        if !text.ends_with(&told) {
            text = format!("{text}: {told}");
        }
        cause = error.source();
    }
    text
}
