//! Notes on the up direction of a tracked recording.

use ::capture::{Track, UpBy, Upright};
use common::note::{Note, NoteCode};

/// The world of a tracked state; adds notes and warnings about its up direction.
pub(super) fn upright_of(track: &Track, notes: &mut Vec<Note>, warnings: &mut Vec<Note>) -> Upright {
    let upright = track.upright_world();
    match &track.measured_up {
        Some(Err(why)) => {
            let text = format!("accelerations do not say which way is up: {why}");
            warnings.push(Note::new(NoteCode::ImuUnusable, text));
        }
        Some(Ok(measured)) => {
            let by = match upright.by {
                UpBy::Imu => "the accelerations, which know it better",
                _ => "what the object stands on, which shows it better",
            };
            let beside = upright.apart_rad.map_or_else(
                || "no plane was found to check that by".to_owned(),
                |apart| format!("gravity and that plane's normal are {:.2} deg apart", apart.to_degrees()),
            );
            let text = format!(
                "up is by {by}: known to {:.2} deg (one standard deviation); {beside}; a bias of {:.2} m/s² \
                 was taken off the accelerations",
                upright.sigma_rad.unwrap_or(f64::NAN).to_degrees(),
                measured.bias.norm()
            );
            notes.push(Note::new(NoteCode::GravityMeasured, text));
        }
        None => {}
    }
    if let Some(apart) = upright.apart_rad.filter(|_| upright.contradicted) {
        let text = format!(
            "gravity by the accelerations and the normal of what the object stands on are {:.1} deg apart, \
             more than both err by: the support is not level, or /tf_static has the IMU's axes wrong",
            apart.to_degrees()
        );
        warnings.push(Note::new(NoteCode::UprightContradicted, text));
    }
    if upright.by == UpBy::Images {
        warnings.push(Note::new(
            NoteCode::UprightByImages,
            "no plane was found that the object stands on: up is what is up in the images, by some degrees \
             at best; let the camera see the floor or the table, or record its IMU",
        ));
    }
    upright
}
