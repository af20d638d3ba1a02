//! Turns the world of recorded poses upright, where z is not up in it.

use ::capture::{Capture, CaptureConfig, RgbdFrame, world_up};
use common::note::{Note, NoteCode};
use common::stop::{Stop, Stopped};

/// Turns all frames upright, unless the settings name places in the world of the poses.
pub(super) fn turned_upright(
    capture: &mut Capture,
    config: &CaptureConfig,
    stop: &Stop,
) -> Result<(), Stopped> {
    let frames: Vec<&RgbdFrame> = capture.states.iter().flatten().collect();
    let Some(found) = world_up(&frames, &capture.noise, stop)? else { return Ok(()) };
    let [x, y, z] = found.up.into();
    let text = format!(
        "z is not up in the world of the poses: ({x:.2}, {y:.2}, {z:.2}) is, by the normal of what the \
         object stands on and by how the images were held"
    );
    let has_places = config.isolate.workspace.is_some() || config.isolate.at.is_some();
    if has_places {
        let text =
            format!("{text}; it was not turned, as places in it are given, so the twin lies on its side");
        capture.warnings.push(Note::new(NoteCode::WorldTurned, text));
        return Ok(());
    }
    for frame in capture.states.iter_mut().flatten() {
        frame.world_from_camera = found.upright_from_world * frame.world_from_camera;
    }
    let turn = found.upright_from_world;
    let axis = turn.axis().map_or([0.0; 3], |a| a.into_inner().into());
    let text = format!(
        "{text}; the twin's world is turned against that of the poses by {:.1} deg about ({:.2}, {:.2}, \
         {:.2})",
        turn.angle().to_degrees(),
        axis[0],
        axis[1],
        axis[2]
    );
    capture.warnings.push(Note::new(NoteCode::WorldTurned, text));
    Ok(())
}
