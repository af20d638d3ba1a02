//! `artitwin synth`.

use std::fmt::Write as _;

use super::{
    args::{OutputArgs, SynthArgs},
    exit::{CliError, Exit},
    terminal,
};
use synth::{Family, HandleStyle, SynthConfig};

/// Makes an object, films it in two states and writes recordings and truth.
///
/// # Errors
/// If the options do not fit together or the folder cannot be written.
pub(super) fn write_object(args: &SynthArgs) -> Result<Exit, CliError> {
    let config = SynthConfig {
        seed: args.seed,
        parts: args.parts,
        family: args.family.as_deref().and_then(Family::by_name),
        handles: args.handles.as_deref().and_then(HandleStyle::by_name),
        textured: if args.plain || args.textured { Some(args.textured) } else { None },
        noise: args.noise,
        drift: args.drift,
        motion_scale: args.motion_scale,
        skew_deg: args.skew,
        lacquer: args.lacquer,
        // The option takes no less than 2.
        further: usize::from(args.states) - 2,
        views: args.views,
        rate_hz: args.rate,
        width: args.width,
        height: args.height,
        sensor: args.sensor,
        depth: args.depth,
        room: args.room,
        poses: args.poses,
        board: args.board,
        imu: args.imu,
    };
    let OutputArgs { out, name, force, .. } = args.output.clone();
    let place = io::Place { out, name, force, inputs: Vec::new() };
    let (committed, object) = match args.layout.as_deref().and_then(io::DatasetLayout::named) {
        Some(layout) => io::write_synth_dataset(&place, &config, layout)?,
        None => io::write_synth(&place, &config)?,
    };
    committed.note().iter().for_each(|note| terminal::print_line(&note.text));
    let mut text =
        format!("{}: {} of {} parts\n", committed.folder.display(), object.family, object.parts.len());
    for part in &object.parts {
        // Writing to a String cannot fail.
        match &part.joint {
            None => writeln!(text, "  {}: static", part.name),
            Some(joint) => {
                let parent = &object.parts[joint.parent].name;
                writeln!(
                    text,
                    "  {}: {} on {parent}, {:.4} to {:.4}",
                    part.name,
                    joint.kind.name(),
                    joint.positions[0],
                    joint.positions[1]
                )
            }
        }
        .unwrap_or_default();
    }
    terminal::print_result(&text)?;
    Ok(Exit::Done)
}
