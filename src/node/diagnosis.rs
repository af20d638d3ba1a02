//! The action `~/diagnose`: the diagnosis of the command line, on recorded runs.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
    time::Duration,
};

use tokio::sync::watch;

use super::{
    collection::Shared,
    goal_error::{GoalError, MAX_RUNS},
    job::{Finished, Job, Work},
    last_results::note_report,
    session_folder::free_folder,
    twin::Twin,
};
use crate::requests::{DiagnoseFeedback, DiagnoseGoal, DiagnoseResult};
use gap::record::{command::Told, drive::Hold, tracks::Streams};
use io::{GapReportError, read_gap_report, read_twin, ros2msg::gap::GapReport, twin_path};
use run::{self, DiagnoseOutcome, DiagnoseRequest, Event, RunError};

/// Gravity if a goal gives none, m/s^2. derived: the standard value, rounded
const GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];

/// Runs diagnoses.
pub(crate) struct Diagnoser {
    /// Data shared with the collection.
    pub shared: Arc<Shared>,
    /// The node's last twin.
    pub twins: watch::Receiver<Option<Arc<Twin>>>,
    /// Receives the report of every diagnosis.
    pub reports: watch::Sender<Option<Arc<GapReport>>>,
}

impl Job for Diagnoser {
    type Goal = DiagnoseGoal;
    type Result = DiagnoseResult;
    type Feedback = DiagnoseFeedback;
    const NAME: &'static str = "~/diagnose";
    const TYPE: &'static str = "Diagnose";

    fn begin_work(
        self: &Arc<Self>,
        goal: &DiagnoseGoal,
    ) -> Result<Work<DiagnoseResult, DiagnoseFeedback>, GoalError> {
        let request = self.request_of_goal(goal)?;
        // First, so that an unreadable twin fails the goal at once.
        let (tree, _) = read_twin(&request.twin, request.gravity)?;
        let joints = tree.joints.iter().filter(|j| j.is_independent()).count();
        let mut progress = JointProgress::new(joints);
        let this = Arc::clone(self);
        Ok(Work::start_thread(
            move |event, elapsed| progress.feedback_of_event(event, elapsed),
            move |monitor| this.finished_result(&request, run::diagnose(&request, monitor)),
        ))
    }

    fn failed_result(message: String) -> DiagnoseResult {
        DiagnoseResult { message, ..DiagnoseResult::default() }
    }
}

impl Diagnoser {
    fn request_of_goal(&self, goal: &DiagnoseGoal) -> Result<DiagnoseRequest, GoalError> {
        if goal.runs.is_empty() || goal.runs.len() + goal.held_out.len() > MAX_RUNS {
            return Err(GoalError::Runs(goal.runs.len() + goal.held_out.len()));
        }
        if goal.gravity.iter().any(|g| !g.is_finite()) {
            return Err(GoalError::Gravity);
        }
        let made = || self.twins.borrow().as_ref().map(|t| t.summary.urdf_path());
        let twin = match goal.twin.as_str() {
            // Messages have no optional fields: an empty path means the last twin.
            "" => made().ok_or(GoalError::NoTwin)?,
            path => twin_path(Path::new(path))?,
        };
        let paths = |list: &[String]| list.iter().map(PathBuf::from).collect();
        Ok(DiagnoseRequest {
            twin,
            runs: paths(&goal.runs),
            held_out: paths(&goal.held_out),
            // Earlier diagnoses are kept.
            out: free_folder(&self.shared.snapshot().session, "gap"),
            name: None,
            force: false,
            // Messages have no optional fields: clients without gravity send zeros.
            gravity: if goal.gravity == [0.0; 3] { GRAVITY } else { goal.gravity },
            hold: goal.linear_effort.then_some(Hold::Sampled),
            seed: goal.seed,
            effects: Vec::new(),
            streams: Streams::default(),
            told: Told::default(),
        })
    }

    fn finished_result(
        &self,
        request: &DiagnoseRequest,
        result: Result<DiagnoseOutcome, RunError>,
    ) -> Finished<DiagnoseResult> {
        let outcome = match result {
            Ok(outcome) => outcome,
            Err(RunError::Cancelled(_)) => return Finished::Canceled,
            Err(error) => return Finished::Failed(run::chain(&error)),
        };
        match read_report(&outcome, &request.twin) {
            Ok(report) => {
                log::info!("{}: {} ({})", Self::NAME, report.verdict, report.folder);
                let message = report.summary.clone();
                let folder = report.folder.clone();
                let verdict = report.verdict.clone();
                // Saved before publishing, so that a killed node publishes it again.
                note_report(request.out.parent().unwrap_or(Path::new("")), &report);
                self.reports.send_replace(Some(Arc::new(report)));
                Finished::Done(DiagnoseResult { success: true, message, folder, verdict })
            }
            Err(error) => Finished::Failed(error.to_string()),
        }
    }
}

fn read_report(outcome: &DiagnoseOutcome, twin: &Path) -> Result<GapReport, GapReportError> {
    let report = read_gap_report(&outcome.folder)?;
    Ok(GapReport { twin: twin.display().to_string(), summary: outcome.summary.clone(), ..report })
}

/// Progress of a diagnosis, with one stage per joint.
struct JointProgress {
    joints: usize,
    begun: usize,
}

impl JointProgress {
    fn new(joints: usize) -> Self {
        Self { joints, begun: 0 }
    }

    fn feedback_of_event(&mut self, event: &Event, elapsed: Duration) -> Option<DiagnoseFeedback> {
        let Event::StageStarted { stage, .. } = event else { return None };
        // A stage is reported as it starts, so the earlier ones are done.
        let done = (self.begun as f64 / self.joints.max(1) as f64).min(1.0);
        self.begun += 1;
        let seconds_left = if done > 0.0 { elapsed.as_secs_f64() * (1.0 - done) / done } else { f64::NAN };
        Some(DiagnoseFeedback { stage: stage.clone(), fraction: done as f32, seconds_left })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_counts_joints() {
        let mut progress = JointProgress::new(2);
        let mut at = |stage: &str, secs| {
            let event = Event::StageStarted { stage: stage.into(), steps: None };
            progress.feedback_of_event(&event, Duration::from_secs(secs)).unwrap()
        };
        let first = at("diagnose/a", 1);
        assert!(first.fraction == 0.0 && first.seconds_left.is_nan() && first.stage == "diagnose/a");
        let second = at("diagnose/b", 4);
        assert!(second.fraction == 0.5 && second.seconds_left == 4.0);
    }
}
