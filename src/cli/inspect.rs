//! `artitwin inspect`.

use std::{fmt::Write as _, path::Path};

use super::{
    args::InspectArgs,
    exit::{CliError, Exit},
    terminal,
};
use capture::{Capture, coverage};
use common::ahead::Ahead;
use export::contact_sheet;
use run::{Monitor, capture::open_inspected};

/// Prints the contents of a recording; fails if `reconstruct` could not use it.
///
/// # Errors
/// If it cannot be read at all, or the picture cannot be written.
pub(super) fn print_contents(args: &InspectArgs) -> Result<Exit, CliError> {
    let config = args.resolved_config()?.config;
    let (mut found, recorded) = io::inspected(&args.bags, &config.capture)?;
    let mut opened = None;
    if found.is_reconstructible() {
        // What a run does until it has the object; what follows refuses nothing.
        let capture = match &args.picture {
            Some(_) => config.capture.clone(),
            None => config.capture.until_isolated(),
        };
        let ahead = Ahead::default();
        match open_inspected(&args.bags, recorded, &capture, config.run.seed, &ahead, &Monitor::silent()) {
            Ok(capture) => {
                found.warn(&capture.warnings);
                opened = Some(capture);
            }
            Err(error) => found.problem = Some(error.to_string()),
        }
    }
    terminal::print_result(&found.to_text())?;
    // A script can ask by the exit code.
    if !found.is_usable() {
        return Ok(Exit::Failed);
    }
    match (&args.picture, opened) {
        (Some(picture), Some(capture)) => print_coverage(&capture, picture),
        _ => Ok(Exit::Done),
    }
}

/// Prints the images' coverage of the object and advice, and writes a picture of them.
fn print_coverage(capture: &Capture, picture: &Path) -> Result<Exit, CliError> {
    let states = coverage(capture);
    let mut text = String::new();
    for note in &capture.notes {
        _ = writeln!(text, "note: {}", note.text);
    }
    for (state, coverage) in states.iter().enumerate() {
        match coverage {
            Some(coverage) => _ = writeln!(text, "state {state}: {coverage}"),
            None => _ = writeln!(text, "state {state}: no view shows the object"),
        }
    }
    let mut advice: Vec<String> = capture.warnings.iter().map(|w| w.text.clone()).collect();
    for (state, coverage) in states.iter().enumerate() {
        let of_state = coverage.iter().flat_map(|c| c.advice());
        advice.extend(of_state.map(|advice| format!("state {state}: {advice}")));
    }
    for advice in &advice {
        _ = writeln!(text, "to do better: {advice}");
    }
    io::write_new(picture, &contact_sheet(capture, &states))
        .map_err(|source| CliError::File { path: picture.to_owned(), source })?;
    _ = writeln!(text, "picture: {}", picture.display());
    terminal::print_result(&text)?;
    Ok(if advice.is_empty() { Exit::Done } else { Exit::Degraded })
}
