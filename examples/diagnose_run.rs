//! Compares the twin that the example `reconstruct_bag` made with another recording of the same object:
//! `cargo run --release --example diagnose_run`.

use artitwin::{DiagnoseRequest, FrameOptions, Monitor, diagnose_frames};

#[allow(clippy::print_stdout, missing_docs, reason = "an example prints")]
pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    let request = DiagnoseRequest::new("target/twins/drawer/drawer.urdf", "target/twins/diagnosis");
    let frames = ["bags/drawer_raw/state0".into(), "bags/drawer_raw/state1".into()];
    let outcome = diagnose_frames(&request, &frames, &FrameOptions::default(), &Monitor::silent())?;
    println!("{}", outcome.summary);
    println!("open {}", outcome.folder.join("report.html").display());
    Ok(())
}
