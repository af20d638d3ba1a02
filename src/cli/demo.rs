//! `artitwin demo`.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use super::{
    args::{DemoArgs, OutputArgs},
    exit::{CliError, Exit},
    terminal,
};
use io::Place;
use run::{DemonstrateRequest, demonstrate};

/// Demonstrates a twin and prints the table of its joints.
///
/// # Errors
/// A folder without a twin, a Python without a package, a folder without write access, a request to stop.
pub(super) fn run_demo(args: &DemoArgs) -> Result<Exit, CliError> {
    let OutputArgs { out, name, force, .. } = args.output.clone();
    let request = DemonstrateRequest {
        twin: args.twin.clone(),
        place: Place { out, name, force, inputs: vec![args.twin.clone()] },
        python: args.python.clone(),
        robot: args.robot.clone(),
        film: !args.no_film,
    };
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if asked.swap(true, Ordering::Relaxed) {
            std::process::exit(Exit::Cancelled as i32);
        }
    })?;
    let done = demonstrate(&request, &stop, terminal::print_line)?;
    done.note.iter().for_each(|note| terminal::print_line(&note.text));
    terminal::print_result(&format!("{}\n{}", done.folder.display(), done.table))?;
    Ok(if done.whole { Exit::Done } else { Exit::Degraded })
}
