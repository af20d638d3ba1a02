//! The action `~/reconstruct`: the pipeline of the command line, on the recordings of a session.

use std::{fs, io::Write as _, path::Path, sync::Arc, time::Duration};

use tokio::sync::watch;

use super::{
    collection::Shared,
    goal_error::GoalError,
    job::{Finished, Job, Work},
    last_results::note_twin,
    live_parameters::LiveParameters,
    twin::Twin,
};
use crate::requests::{ReconstructFeedback, ReconstructGoal, ReconstructResult};
use common::ahead::Ahead;
use config::Config;
use io::read_run_summary;
use run::{self, Event, Outcome, ReconstructRequest, RunError, RunProgress};

/// Runs reconstructions.
pub(crate) struct Reconstructor {
    /// Parameters and settings before those of a goal.
    pub parameters: Arc<LiveParameters>,
    /// Data shared with the collection.
    pub shared: Arc<Shared>,
    /// Results computed during collection.
    pub ahead: Arc<Ahead>,
    /// Receives the twin of every successful run.
    pub twins: watch::Sender<Option<Arc<Twin>>>,
}

impl Job for Reconstructor {
    type Goal = ReconstructGoal;
    type Result = ReconstructResult;
    type Feedback = ReconstructFeedback;
    const NAME: &'static str = "~/reconstruct";
    const TYPE: &'static str = "Reconstruct";

    fn begin_work(
        self: &Arc<Self>,
        goal: &ReconstructGoal,
    ) -> Result<Work<ReconstructResult, ReconstructFeedback>, GoalError> {
        // First, so that no state can start between checking the states and the run.
        let read = self.shared.read_session();
        let request = self.request_of_goal(goal)?;
        let this = Arc::clone(self);
        let mut progress = RunProgress::default();
        Ok(Work::start_thread(
            move |event, elapsed| feedback_of_event(&mut progress, event, elapsed),
            move |monitor| {
                let result = run::reconstruct(&request, monitor);
                // The bags are read, so the next state may start while the result is processed.
                drop(read);
                this.finished_result(&request.out, result)
            },
        ))
    }

    fn failed_result(message: String) -> ReconstructResult {
        ReconstructResult { message, ..ReconstructResult::default() }
    }
}

impl Reconstructor {
    fn request_of_goal(&self, goal: &ReconstructGoal) -> Result<ReconstructRequest, GoalError> {
        let snapshot = self.shared.snapshot();
        let recordings = snapshot.both_recordings()?;
        let current = self.parameters.current();
        let mut config = current.resolved.config.clone();
        if goal.parts > 0 {
            // Messages have no optional fields: 0 means the parameter.
            config.run.parts = Some(goal.parts as usize);
        }
        let name = if goal.name.is_empty() { &current.parameters.twin_name } else { &goal.name };
        let out = snapshot.session;
        // Before the run, so that a failed one can be repeated from the command line, too.
        write_settings(&out, &config)?;
        Ok(ReconstructRequest {
            sources: recordings.into(),
            out,
            name: Some(name.clone()),
            config,
            origins: current.resolved.origins.clone(),
            resume: false,
            keep: false,
            stages: None,
            ahead: Arc::clone(&self.ahead),
            force: false,
            rerun: None,
            beside: Vec::new(),
        })
    }

    fn finished_result(
        &self,
        session: &Path,
        result: Result<Outcome, RunError>,
    ) -> Finished<ReconstructResult> {
        let outcome = match result {
            Ok(outcome) => outcome,
            Err(RunError::Cancelled(_)) => return Finished::Canceled,
            Err(error) => return Finished::Failed(run::chain(&error)),
        };
        // From the files, so that a later node publishes the same.
        let summary = match read_run_summary(&outcome.folder) {
            Ok(summary) => summary,
            Err(error) => return Finished::Failed(error.to_string()),
        };
        let message = match outcome.warnings.first() {
            None => format!("{} joints", summary.joints.len()),
            Some(first) => format!(
                "{} joints; {} warnings, the first: {first}",
                summary.joints.len(),
                outcome.warnings.len()
            ),
        };
        log::info!("{}: {message}", Self::NAME);
        let mut motions = Vec::with_capacity(summary.joints.len());
        for joint in &summary.joints {
            let first = joint.states.first().copied().unwrap_or_default();
            motions.push(joint.states.last().copied().unwrap_or_default() - first);
        }
        let done = ReconstructResult {
            success: true,
            message,
            folder: summary.folder.display().to_string(),
            joints: summary.joints.iter().map(|j| j.name.clone()).collect(),
            motions,
        };
        let snapshot = self.shared.snapshot();
        // A tracked twin has its own world frame, found by the pipeline.
        let own = snapshot.twin_frame.map(str::to_owned);
        let world_frame = own.or(snapshot.world_frame).unwrap_or_else(|| "world".into());
        let twin = Twin { summary, state: 1, world_frame };
        // Saved before publishing, so that a killed node publishes it again.
        note_twin(session, &twin);
        self.twins.send_replace(Some(Arc::new(twin)));
        Finished::Done(done)
    }
}

/// Feedback of a goal after an event at a time since its start; `None` between two stages.
fn feedback_of_event(
    progress: &mut RunProgress,
    event: &Event,
    elapsed: Duration,
) -> Option<ReconstructFeedback> {
    if !progress.take(event, elapsed) {
        return None;
    }
    let (stage, _) = progress.stage()?;
    let (fraction, left) = progress.at(elapsed).unzip();
    Some(ReconstructFeedback {
        stage: stage.to_owned(),
        fraction: fraction.unwrap_or_default() as f32,
        // Messages have no optional fields.
        loss: progress.loss().unwrap_or(f64::NAN),
        seconds_left: left.map_or(f64::NAN, |left| left.as_secs_f64()),
    })
}

/// Writes the settings next to the recordings, so that `artitwin reconstruct --config` repeats the run.
/// Earlier ones are renamed to `settings_replaced<K>.yaml`.
fn write_settings(session: &Path, config: &Config) -> Result<(), GoalError> {
    let text = serde_norway::to_string(config)?;
    let path = session.join("settings.yaml");
    if fs::read_to_string(&path).is_ok_and(|old| old == text) {
        return Ok(());
    }
    let is_there = |path: &Path| fs::symlink_metadata(path).is_ok();
    let spare = (1..).map(|k| session.join(format!("settings_replaced{k}.yaml"))).find(|p| !is_there(p));
    let moved = spare.filter(|_| is_there(&path)).map_or(Ok(()), |spare| fs::rename(&path, spare));
    let written = moved.and_then(|()| fs::File::create_new(&path)?.write_all(text.as_bytes()));
    written.map_err(|source| GoalError::Settings { path, source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_feedback_names_its_stage() {
        let mut progress = RunProgress::default();
        let stage = "surface/state0".to_owned();
        let mut at = |event| feedback_of_event(&mut progress, &event, Duration::from_secs(1));
        let begun = at(Event::StageStarted { stage: stage.clone(), steps: None }).unwrap();
        assert_eq!(begun.stage, stage);
        assert!(at(Event::StageFinished { stage, seconds: 1.0 }).is_none());
    }

    #[test]
    fn settings_that_are_there_stay() {
        let folder = tempfile::tempdir().unwrap();
        let session = folder.path().to_owned();
        let read = |name: &str| fs::read_to_string(session.join(name)).unwrap();
        fs::write(session.join("settings.yaml"), "# mine").unwrap();
        let config = Config::default();
        for _ in 0..2 {
            write_settings(&session, &config).unwrap();
            assert_eq!(read("settings_replaced1.yaml"), "# mine");
        }
        let own = read("settings.yaml");
        let mut other = Config::default();
        other.run.parts = Some(3);
        write_settings(&session, &other).unwrap();
        assert!(read("settings_replaced2.yaml") == own && read("settings.yaml") != own);
    }
}
