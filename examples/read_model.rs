//! Reads the twin that the example `reconstruct_bag` made: `cargo run --release --example read_model`.

use artitwin::read_run_summary;

#[allow(clippy::print_stdout, missing_docs, reason = "an example prints")]
pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    let twin = read_run_summary("target/twins/drawer".as_ref())?;
    for joint in &twin.joints {
        let [lower, upper] = joint.limits;
        println!("{} ({}) carries {}: {lower:.3} to {upper:.3}", joint.name, joint.kind.name(), joint.child);
        println!("  axis known to {:.2} deg", joint.axis_std_rad.to_degrees());
        println!("  at its upper limit: {:.3}", joint.parent_from_child(upper));
    }
    Ok(())
}
