//! Makes the twin of a recording that ships here: `cargo run --release --example reconstruct_bag`.

use artitwin::{Config, Monitor, ReconstructRequest, reconstruct};

#[allow(clippy::print_stdout, missing_docs, reason = "an example prints")]
pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut request = ReconstructRequest::new(["bags/drawer"], "target/twins");
    request.config = Config::preset("preview")?;
    let outcome = reconstruct(&request, &Monitor::silent())?;
    for joint in &outcome.joints {
        println!("{}, {}: moved by {:.3}", joint.name, joint.kind.name(), joint.motion);
    }
    println!("open {}", outcome.folder.join("report.html").display());
    Ok(())
}
