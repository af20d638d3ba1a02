//! `artitwin track`.

use std::fmt::Write as _;

use super::{
    args::TrackArgs,
    exit::{CliError, Exit},
    terminal,
};
use capture::stamp_secs;
use run::{Monitor, capture::track_camera};

/// Prints the camera's poses, a line each: stamp, place, quaternion (x, y, z, w), in the world of the twin;
/// notes on them go to stderr.
///
/// # Errors
/// If the camera cannot be tracked.
pub(super) fn print_poses(args: &TrackArgs) -> Result<Exit, CliError> {
    let config = args.settings.resolved_config()?.config;
    let (states, [notes, warnings]) =
        track_camera(&args.sources, &config.capture, config.run.seed, &Monitor::silent())?;
    notes.iter().for_each(|n| terminal::print_line(&format!("note: {}", io::printable(&n.text))));
    warnings.iter().for_each(|w| terminal::print_line(&format!("warning: {}", io::printable(&w.text))));
    let mut text = String::new();
    for (state, poses) in states.iter().enumerate() {
        _ = writeln!(text, "# state {state}: stamp_s x_m y_m z_m qx qy qz qw, world_from_camera");
        for (stamp_nanos, pose) in poses {
            let t = pose.translation.vector;
            let q = pose.rotation.coords;
            _ = writeln!(
                text,
                "{:.9} {:.7} {:.7} {:.7} {:.8} {:.8} {:.8} {:.8}",
                stamp_secs(*stamp_nanos),
                t.x,
                t.y,
                t.z,
                q.x,
                q.y,
                q.z,
                q.w
            );
        }
    }
    terminal::print_result(&text)?;
    Ok(if warnings.is_empty() { Exit::Done } else { Exit::Degraded })
}
