//! `artitwin joint`.

use std::{fmt::Write as _, path::PathBuf};

use clap::Args;
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

use super::{
    exit::{CliError, Exit},
    terminal,
    wanted::local,
};
use common::note::Note;
use gap::track::{joint::TracedJoint, opening::OpeningJoint, repeats::SharedAxis};

/// Options of `joint`.
#[derive(Args, Clone, Debug)]
#[command(after_help = "Example: artitwin joint door_1.log door_2.log --urdf door.urdf\n\
    A text has a sample a line: x y z or x y z qx qy qz qw in meters, with or without a stamp in front.")]
pub(super) struct JointArgs {
    /// Path of a point of the part: a bag with poses, Odometry or /tf of it, or a text; several are openings
    /// of one mechanism, each with its own point
    #[arg(value_name = "TRACK", required = true, value_parser = local())]
    pub tracks: Vec<PathBuf>,
    /// Topic of poses or frame of /tf that is meant, where several move in a bag
    #[arg(long, value_name = "NAME")]
    pub of: Option<String>,
    /// File that gets a URDF of the joint; a file that is there is not replaced
    #[arg(long, value_name = "FILE.urdf")]
    pub urdf: Option<PathBuf>,
    /// Print one JSON object in place of text
    #[arg(long)]
    pub json: bool,
}

/// Finds the joint, prints it and writes its URDF.
///
/// # Errors
/// If a track cannot be read, or a URDF is wanted of a joint whose type is not known.
pub(super) fn print_joint(args: &JointArgs) -> Result<Exit, CliError> {
    let joint = run::joint_of_tracks(&args.tracks, args.of.as_deref())?;
    joint.notes.iter().for_each(|n| terminal::print_line(&format!("warning: {}", io::printable(&n.text))));
    if let Some(path) = &args.urdf {
        let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        let Some(text) = export::traced_urdf(&stem, &joint) else {
            return Err(CliError::NoJoint(format!("the type of the joint is {}", joint.kind.name())));
        };
        io::write_new(path, text.as_bytes())
            .map_err(|source| CliError::File { path: path.clone(), source })?;
    }
    let text = if args.json { json_of(&joint) } else { text_of(&joint) };
    terminal::print_result(&text)?;
    Ok(if joint.notes.is_empty() { Exit::Done } else { Exit::Degraded })
}

/// A few lines for people.
fn text_of(joint: &TracedJoint) -> String {
    let mut text = format!("type: {}, ln(revolute : prismatic) = {:.1}\n", joint.kind.name(), joint.log_odds);
    let Some(axis) = &joint.axis else { return text };
    let numbers = |v: &Vector3<f64>| format!("{:.4} {:.4} {:.4}", v.x, v.y, v.z);
    let tilt_deg = axis.axis_std_rad().to_degrees();
    _ = writeln!(text, "axis: {} (+- {tilt_deg:.2} deg)", numbers(&axis.axis));
    let off_mm = 1e3 * axis.origin_std_m();
    let line = if joint.kind.is_turning() { format!(" (+- {off_mm:.1} mm)") } else { String::new() };
    _ = writeln!(text, "origin: {} m{line}", numbers(&axis.origin));
    let [lower, upper] = joint.limits;
    let [lower_std, upper_std] = joint.limit_deviations;
    let unit = unit_of(joint);
    _ = writeln!(text, "limits: {lower:.4} (+- {lower_std:.4}) to {upper:.4} (+- {upper_std:.4}) {unit}");
    for (name, odds, opening) in &joint.openings {
        let Some(own) = opening else {
            _ = writeln!(text, "{name}: nothing moved");
            continue;
        };
        let radius =
            own.radius_m.map_or_else(String::new, |[r, std]| format!(", radius {r:.4} +- {std:.4} m"));
        _ = writeln!(
            text,
            "{name}: {} samples, {} outliers, {:.1} mm off the path{radius}, ln odds {odds:.1}",
            own.positions.len(),
            own.outliers,
            1e3 * own.rms
        );
    }
    text
}

fn unit_of(joint: &TracedJoint) -> &'static str {
    if joint.kind.is_turning() { "rad" } else { "m" }
}

/// The JSON object; what is not known is `null`.
#[derive(Serialize)]
struct JointJson<'a> {
    r#type: &'static str,
    /// Logarithm of the odds of a revolute joint against a prismatic one.
    log_odds_revolute: f64,
    unit: Option<&'static str>,
    axis: Option<[f64; 3]>,
    axis_std_rad: Option<f64>,
    axis_covariance: Option<[[f64; 3]; 3]>,
    origin: Option<[f64; 3]>,
    origin_std_m: Option<f64>,
    origin_covariance: Option<[[f64; 3]; 3]>,
    limits: Option<[f64; 2]>,
    limits_std: Option<[f64; 2]>,
    /// What the openings differ by, beyond their own deviations: radians of the axis, meters of the line.
    between_openings: Option<[f64; 2]>,
    openings: Vec<OpeningJson<'a>>,
    warnings: &'a [Note],
}

#[derive(Serialize)]
struct OpeningJson<'a> {
    track: &'a str,
    log_odds_revolute: f64,
    radius_m: Option<f64>,
    radius_std_m: Option<f64>,
    /// Where the tracked point is at position 0.
    attachment: Option<[f64; 3]>,
    /// Root mean square of what lies off the path.
    rms: Option<f64>,
    outliers: Option<usize>,
    /// Seconds, or the number of the sample where there are no stamps.
    at: &'a [f64],
    position: &'a [f64],
    position_std: &'a [f64],
}

fn json_of(joint: &TracedJoint) -> String {
    let axis = joint.axis.as_ref();
    let line = axis.filter(|_| joint.kind.is_turning());
    let rows = |m: &Matrix3<f64>| [0, 1, 2].map(|r| [0, 1, 2].map(|c| m[(r, c)]));
    let json = JointJson {
        r#type: joint.kind.name(),
        log_odds_revolute: joint.log_odds,
        unit: axis.map(|_| unit_of(joint)),
        axis: axis.map(|a| a.axis.into()),
        axis_std_rad: axis.map(SharedAxis::axis_std_rad),
        axis_covariance: axis.map(|a| rows(&a.axis_covariance)),
        origin: axis.map(|a| a.origin.into()),
        origin_std_m: line.map(SharedAxis::origin_std_m),
        origin_covariance: line.map(|a| rows(&a.origin_covariance)),
        limits: axis.map(|_| joint.limits),
        limits_std: axis.map(|_| joint.limit_deviations),
        between_openings: axis.map(|a| [a.between_rad, a.between_m]),
        openings: joint
            .openings
            .iter()
            .map(|(name, odds, own)| opening_json(name, *odds, own.as_ref()))
            .collect(),
        warnings: &joint.notes,
    };
    // Numbers and names alone: this cannot fail.
    serde_json::to_string(&json).unwrap_or_default() + "\n"
}

fn opening_json<'a>(track: &'a str, odds: f64, own: Option<&'a OpeningJoint>) -> OpeningJson<'a> {
    OpeningJson {
        track,
        log_odds_revolute: odds,
        radius_m: own.and_then(|o| o.radius_m).map(|[r, _]| r),
        radius_std_m: own.and_then(|o| o.radius_m).map(|[_, std]| std),
        attachment: own.map(|o| o.attachment.into()),
        rms: own.map(|o| o.rms),
        outliers: own.map(|o| o.outliers),
        at: own.map_or(&[][..], |o| &o.at[..]),
        position: own.map_or(&[][..], |o| &o.positions[..]),
        position_std: own.map_or(&[][..], |o| &o.deviations[..]),
    }
}
