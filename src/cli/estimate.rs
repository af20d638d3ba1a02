//! `reconstruct --estimate` and `diagnose --estimate`.

use std::path::PathBuf;

use serde::Serialize;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::{
    args::{DiagnoseArgs, ReconstructArgs},
    diagnose::diagnose_request,
    exit::{CliError, Exit},
    terminal,
};
use capture::CaptureError;
use io::{hex, name_of, sha256};
use run::Estimate;

/// The printed line.
#[derive(Serialize)]
struct Line<'a> {
    format: &'static str,
    version: &'static str,
    /// Name of the result.
    name: &'a str,
    /// A digest of all facts behind the result, beside inputs and name.
    settings: String,
    #[serde(flatten)]
    estimate: Estimate,
}

/// Prints the estimated cost of a reconstruction.
///
/// # Errors
/// Wrong settings; missing inputs.
pub(super) fn print_reconstruct_estimate(args: &ReconstructArgs) -> Result<Exit, CliError> {
    let config = args.resolved_config()?.config;
    require_inputs(&args.bags)?;
    let mut settings = serde_json::to_value(&config).unwrap_or_default();
    if let Some(matcher) = &config.matching.onnx {
        // Its content counts, not where it lies.
        let digest =
            sha256(matcher).map_err(|source| CaptureError::Read { path: matcher.clone(), source })?;
        settings["matching"]["onnx"] = digest.into();
    }
    let name = args.output.name.clone().unwrap_or_else(|| name_of(&args.bags));
    print_estimate("reconstruct", &name, &settings, Estimate::of_reconstruction(&args.bags, &config))
}

/// Prints the estimated cost of a diagnosis.
///
/// # Errors
/// Missing inputs.
pub(super) fn print_diagnose_estimate(args: &DiagnoseArgs) -> Result<Exit, CliError> {
    let request = diagnose_request(args);
    require_inputs(&[std::slice::from_ref(&args.twin), &args.runs, &args.held_out, &args.frames].concat())?;
    let settings = json!({
        "runs": [args.runs.len(), args.held_out.len(), args.frames.len()],
        // Held-out runs among the runs are read once.
        "held_out": args.held_out.iter().map(|h| args.runs.iter().position(|r| r == h)).collect::<Vec<_>>(),
        "gravity": request.gravity,
        "effort_hold": args.effort_hold,
        "seed": request.seed,
        "effects": request.effects,
        "streams": format!("{:?}", request.streams),
        "actuators": format!("{:?}", request.told),
        "accuracy": args.accuracy,
    });
    let name = args.output.name.as_deref().unwrap_or("diagnosis");
    print_estimate("diagnose", name, &settings, Estimate::of_diagnosis(&request, &args.frames))
}

/// Refuses missing inputs.
fn require_inputs(inputs: &[PathBuf]) -> Result<(), CaptureError> {
    match inputs.iter().find(|path| !path.exists()) {
        Some(path) => Err(CaptureError::Missing { path: path.clone() }),
        None => Ok(()),
    }
}

fn print_estimate(command: &str, name: &str, settings: &Value, estimate: Estimate) -> Result<Exit, CliError> {
    let version = env!("CARGO_PKG_VERSION");
    // Keys of a JSON object are sorted.
    let all = json!({ "command": command, "version": version, "settings": settings }).to_string();
    let settings = hex(&Sha256::digest(all));
    let line = Line { format: "artitwin-estimate/2", version, name, settings, estimate };
    terminal::print_result(&format!("{}\n", serde_json::to_string(&line).unwrap_or_default()))?;
    Ok(Exit::Done)
}
