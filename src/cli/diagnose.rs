//! `artitwin diagnose`.

use std::{
    path::PathBuf,
    sync::{Arc, atomic::AtomicBool},
};

use super::{
    args::DiagnoseArgs,
    exit::{CliError, Exit},
    progress::{Progress, Shown},
    terminal,
};
use common::note::{Note, NoteCode};
use gap::{
    camera::record::options::FrameOptions,
    judge::verdict::Verdict,
    record::{
        command::{EffortUnit, Told},
        drive::Hold,
        tracks::Streams,
    },
};
use run::{self, DiagnoseOutcome, DiagnoseRequest, Event, Monitor, RunError};

/// The request of the arguments.
pub(super) fn diagnose_request(args: &DiagnoseArgs) -> DiagnoseRequest {
    DiagnoseRequest {
        twin: args.twin.clone(),
        runs: args.runs.clone(),
        held_out: args.held_out.clone(),
        out: args.output.out.clone(),
        name: args.output.name.clone(),
        force: args.output.force,
        gravity: args.gravity,
        hold: args.effort_hold.as_deref().map(|hold| if hold == "zero" { Hold::Zero } else { Hold::Sampled }),
        seed: args.seed,
        effects: args.effects.clone(),
        streams: Streams {
            wrenches: args.wrench.clone(),
            poses: args.pose.clone(),
            commands: args.command.clone(),
            joints: args.joint.clone(),
            ..Streams::default()
        },
        told: Told {
            // Wrenches are measured by force sensors, which are calibrated.
            unit: args.effort_unit.unwrap_or(match args.wrench.is_empty() {
                true => EffortUnit::Assumed,
                false => EffortUnit::Calibrated,
            }),
            servos: args.servo.clone(),
        },
    }
}

/// The diagnosis, by motion or by frames.
///
/// # Errors
/// Those of [`run::diagnose`].
pub(super) fn diagnose_outcome(
    request: &DiagnoseRequest,
    frames: &[PathBuf],
    args: &DiagnoseArgs,
    monitor: &Monitor,
) -> Result<DiagnoseOutcome, RunError> {
    if frames.is_empty() {
        return run::diagnose(request, monitor);
    }
    let options = FrameOptions { accuracy_m: 1e-3 * args.accuracy, ..FrameOptions::default() };
    run::diagnose_frames(request, frames, &options, monitor)
}

/// The summary, and where the report is.
pub(super) fn summary_text(outcome: &DiagnoseOutcome) -> String {
    format!("{}report: {}\n", outcome.summary, outcome.folder.join("report.html").display())
}

/// Diagnoses a twin and prints the summary.
///
/// # Errors
/// If the twin or a run cannot be read, or the result cannot be written.
pub(super) fn run_diagnose(args: &DiagnoseArgs) -> Result<Exit, CliError> {
    let stop = Arc::<AtomicBool>::default();
    let shown = Shown { json: args.json, verbose: args.verbose };
    let (progress, events) = Progress::start(shown, Arc::clone(&stop));
    let monitor = Monitor::new(events.clone(), stop);
    let found =
        diagnose_outcome(&diagnose_request(args), &args.frames, args, &monitor).map_err(CliError::from);
    let event = match &found {
        Ok(found) => Event::Artifact { path: found.folder.display().to_string() },
        Err(error) => Event::Error { message: error.chain(), exit_code: error.exit() as u8 },
    };
    if args.json {
        events.send(event).ok();
    }
    progress.finish().map_err(CliError::Events)?;
    let found = found?;
    if !args.json {
        terminal::print_result(&summary_text(&found))?;
    }
    Ok(exit_of_verdict(found.verdict, &found.warnings))
}

/// Warnings for scripts, too: a file of a format stayed the twin, or numbers mean something else than
/// assumed.
const DEGRADING: [NoteCode; 4] = [
    NoteCode::FormatKeepsTwin,
    NoteCode::UnitsDoubtful,
    NoteCode::EffortSignTurned,
    NoteCode::EffortsOfOtherJoint,
];

/// Degraded where too little was recorded to say anything, too.
pub(super) fn exit_of_verdict(verdict: Verdict, warnings: &[Note]) -> Exit {
    let degrades = warnings.iter().any(|w| DEGRADING.contains(&w.code));
    if verdict == Verdict::Insufficient || degrades { Exit::Degraded } else { Exit::Done }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exit_code_says_that_a_file_keeps_the_twin() {
        let with = |code| exit_of_verdict(Verdict::Named, &[Note::new(code, "")]);
        assert_eq!(with(NoteCode::FormatKeepsTwin), Exit::Degraded);
        assert_eq!(with(NoteCode::UnitsDoubtful), Exit::Degraded);
        assert_eq!(with(NoteCode::FormatHoldsLess), Exit::Done);
        assert_eq!(exit_of_verdict(Verdict::Insufficient, &[]), Exit::Degraded);
    }
}
