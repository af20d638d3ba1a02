//! Corrects camera poses together with the errors of the depth sensor.

use std::fmt::Display;

use ::capture::{Capture, CaptureError, PoseAgreement, PoseFindings, RgbdFrame, cameras, refine_poses};
use common::ahead::Ahead;
use common::note::{Note, NoteCode};
use common::stop::Stop;

/// Corrects the camera poses of each state, and places tracked frames on their board by the correction.
pub(super) fn corrected(capture: &mut Capture, ahead: &Ahead, stop: &Stop) -> Result<(), CaptureError> {
    let tracked = !capture.tracking.is_empty();
    capture.poses = refine_poses(&mut capture.states, &capture.noise, tracked, ahead, stop)?;
    for (state, found) in capture.poses.states.iter().enumerate() {
        capture.notes.extend(found.iter().map(|found| poses_checked(state, found)));
    }
    capture.notes.extend(
        capture.poses.sensor.iter().map(|found| Note::new(NoteCode::SensorChecked, found.to_string())),
    );
    capture.warnings.extend(beyond_expected(&capture.poses));
    capture.warnings.extend(several_sensors(&capture.states));
    // The worlds of the others are corrected to that of state 0.
    for (state, world) in (1..).zip(&capture.poses.worlds) {
        capture.notes.extend(world.iter().map(|found| poses_checked(state, found)));
    }
    if let Some(board) = &capture.board {
        let found = board.place_again(&mut capture.states, capture.poses.sensor.as_ref(), stop)?;
        capture.notes.extend(found.map(|found| Note::new(NoteCode::BoardSeen, found.to_string())));
    }
    Ok(())
}

/// Warnings about errors of poses and sensors that exceed the expected ones.
fn beyond_expected(poses: &PoseFindings) -> Vec<Note> {
    let mut notes = Vec::new();
    for (state, found) in poses.agreement.iter().enumerate() {
        notes.extend(found.as_ref().and_then(|found| disagreement(state, found)));
    }
    let lag = poses.sensor.as_ref().filter(|s| s.has_late_poses()).map(|s| {
        let [lag_s, sigma_s] = s.pose_lag_s;
        Note::new(
            NoteCode::PosesLate,
            format!(
                "camera poses are {:.0} ms (standard deviation {:.0} ms) {} than the images; they were \
                 corrected, but give both one clock, or set capture.pose_delay_secs={lag_s:.3}",
                1e3 * lag_s.abs(),
                1e3 * sigma_s,
                older(lag_s)
            ),
        )
    });
    let sensor = poses.sensor.as_ref().filter(|s| s.beyond_data_sheets()).map(|s| {
        Note::new(
            NoteCode::SensorFarOff,
            format!(
                "the depth sensor errs by {:.1} % in scale and {:.1} % over the image, more than data sheets \
                 allow; check its calibration and the unit of its images",
                100.0 * s.scale[0],
                100.0 * s.warp_rms
            ),
        )
    });
    notes.extend(lag);
    for (state, found) in poses.states.iter().enumerate() {
        notes.extend(found.as_ref().filter(|f| f.beyond_expected()).map(|_| far_off(state)));
    }
    notes.extend(sensor);
    notes
}

/// The note on a state whose poses are as far off as the search for corrections reaches.
fn far_off(state: usize) -> Note {
    Note::new(
        NoteCode::PosesFarOff,
        format!(
            "state {state}: camera poses err by as much as is looked for at most: 3 mm or 0.29 deg from \
             one view to the next; check that poses and images are of one clock and of one camera"
        ),
    )
}

/// The note on a state whose poses belong to another time or scene than its images; `None` if they agree.
fn disagreement(state: usize, found: &PoseAgreement) -> Option<Note> {
    let share = 100.0 * found.share;
    if let Some([delay_s, with_delay]) = found.delay {
        return Some(Note::new(
            NoteCode::PosesLate,
            format!(
                "state {state}: camera poses seem {:.2} s {} than the images: by their stamps {share:.0} \
                 % of the features that frames share lie where the poses say, with that delay {:.0} %{}; \
                 give both one clock, or set capture.pose_delay_secs={delay_s:.3}",
                delay_s.abs(),
                older(delay_s),
                100.0 * with_delay,
                match found.certain_delay_s() {
                    Some(_) => "; poses between those of the kept frames are used",
                    None => "",
                },
            ),
        ));
    }
    found.contradicts().then(|| {
        Note::new(
            NoteCode::PosesContradict,
            format!(
                "state {state}: camera poses contradict the images: {share:.0} % of the features that \
                 frames share lie where the poses say, and no delay of the poses explains it; check the \
                 frame of the poses (capture.pose_frame), the camera's calibration, and that the \
                 tracking was not lost"
            ),
        )
    })
}

fn older(delay_s: f64) -> &'static str {
    if delay_s > 0.0 { "older" } else { "younger" }
}

/// A warning about frames from several cameras, which share no errors.
fn several_sensors(states: &[Vec<RgbdFrame>]) -> Option<Note> {
    let cameras = cameras(states.iter().flatten());
    (cameras.len() > 1).then(|| {
        Note::new(
            NoteCode::SeveralSensors,
            format!(
                "frames come from {} cameras by their intrinsics; depth is not calibrated, as each errs in \
                 its own way; record all states with one camera at one resolution",
                cameras.len()
            ),
        )
    })
}

fn poses_checked(state: usize, found: &impl Display) -> Note {
    Note::new(NoteCode::PosesChecked, format!("state {state}: {found}"))
}
