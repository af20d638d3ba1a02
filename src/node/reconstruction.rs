//! The action `~/reconstruct`: the pipeline of the command line on the recordings of a session.

use std::{
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use ros2_client::Message;
use tokio::sync::watch;

use super::{
    collection::Shared,
    job::{Finished, Job, Work},
    progress::RunProgress,
};
use crate::{
    config::{Config, Origins},
    io::{
        RunSummary, SummaryJoint, read_run_summary,
        ros2msg::status::{ReconstructFeedback, ReconstructGoal, ReconstructResult},
    },
    run::{self, Outcome, ReconstructRequest, RunError},
};

impl Message for ReconstructGoal {}
impl Message for ReconstructResult {}
impl Message for ReconstructFeedback {}

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

/// Makes twins.
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

impl Job for Reconstructor {
    type Goal = ReconstructGoal;
    type Result = ReconstructResult;
    type Feedback = ReconstructFeedback;
    const NAME: &'static str = "~/reconstruct";
    const TYPE: &'static str = "Reconstruct";

    fn begin(self: &Arc<Self>, goal: &ReconstructGoal) -> Result<Work<ReconstructResult, ReconstructFeedback>, String> {
        let request = self.request(goal)?;
        let busy = Busy::new(self);
        let mut progress = RunProgress::new(request.config.trains_fields());
        Ok(Work::start(
            move |event, elapsed| progress.take(event).then(|| progress.feedback(elapsed)),
            move |monitor| busy.0.finish(run::reconstruct(&request, monitor)),
        ))
    }

    fn nothing(message: String) -> ReconstructResult {
        ReconstructResult { message, ..ReconstructResult::default() }
    }
}

/// Says that a run goes on, until it is dropped.
struct Busy(Arc<Reconstructor>);

impl Busy {
    fn new(reconstructor: &Arc<Reconstructor>) -> Self {
        reconstructor.busy.store(true, Ordering::Release);
        Self(Arc::clone(reconstructor))
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.busy.store(false, Ordering::Release);
    }
}

impl Reconstructor {
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
        Ok(ReconstructRequest {
            sources: recordings.into(),
            out,
            name: Some(name),
            config,
            origins: self.origins.clone(),
            resume: false,
            keep: false,
        })
    }

    fn finish(&self, result: Result<Outcome, RunError>) -> Finished<ReconstructResult> {
        let outcome = match result {
            Ok(outcome) => outcome,
            Err(RunError::Cancelled(_)) => return Finished::Canceled,
            Err(error) => return Finished::Failed(run::chain(&error)),
        };
        let summary = match read_run_summary(&outcome.folder) {
            Ok(summary) => summary,
            Err(error) => return Finished::Failed(error.to_string()),
        };
        let message = match outcome.warnings.first() {
            None => format!("{} joints", summary.joints.len()),
            Some(first) => format!("{} joints; {} warnings, the first: {first}", summary.joints.len(), outcome.warnings.len()),
        };
        log::info!("{}: {message}", Self::NAME);
        let motion = |j: &SummaryJoint| j.states.last().copied().unwrap_or_default() - j.states.first().copied().unwrap_or_default();
        let done = ReconstructResult {
            success: true,
            message,
            folder: summary.folder.display().to_string(),
            joints: summary.joints.iter().map(|j| j.name.clone()).collect(),
            motions: summary.joints.iter().map(motion).collect(),
        };
        let world_frame = self.shared.snapshot().world_frame.unwrap_or_else(|| "world".into());
        self.twins.send_replace(Some(Arc::new(Twin { summary, state: 1, world_frame })));
        Finished::Done(done)
    }
}

/// Keeps the settings beside the recordings, so that `artitwin reconstruct --config` repeats the run.
fn write_settings(path: &Path, config: &Config) -> Result<(), String> {
    let text = serde_norway::to_string(config).map_err(|e| e.to_string())?;
    std::fs::write(path, text).map_err(|e| format!("cannot write `{}`: {e}", path.display()))
}
