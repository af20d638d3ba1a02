//! Camera poses corrected, with the errors of the depth sensor.

use std::fmt::Display;

use ::capture::{
    Capture, CaptureError, PoseAgreement, PoseCorrection, PoseFindings, RgbdFrame, cameras, refine_poses,
};
use common::ahead::Ahead;
use common::note::{Note, NoteCode};
use common::stop::Stop;

/// Corrects the camera poses of each state, and places tracked frames on their board by what was corrected.
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
    // State 0 is what the others' worlds are corrected to.
    for (state, world) in (1..).zip(&capture.poses.worlds) {
        capture.notes.extend(world.iter().map(|found| poses_checked(state, found)));
    }
    if let Some(board) = &capture.board {
        let found = board.place_again(&mut capture.states, capture.poses.sensor.as_ref(), stop)?;
        capture.notes.extend(found.map(|found| Note::new(NoteCode::BoardSeen, found.to_string())));
    }
    Ok(())
}

/// What goes beyond what errors of poses and sensors explain.
fn beyond_expected(poses: &PoseFindings) -> Vec<Note> {
    let far = |(state, found): (usize, &Option<PoseCorrection>)| {
        found.as_ref().filter(|f| f.beyond_expected())?;
        Some(Note::new(
            NoteCode::PosesFarOff,
            format!(
                "state {state}: camera poses err by as much as is looked for at most: 3 mm or 0.29 deg from \
                 one view to the next; check that poses and images are of one clock and of one camera"
            ),
        ))
    };
    let agreement = |(state, found): (usize, &Option<PoseAgreement>)| {
        let found = found.as_ref()?;
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
    };
    let agreement = poses.agreement.iter().enumerate().filter_map(agreement);
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
    let states = poses.states.iter().enumerate().filter_map(far);
    agreement.chain(lag).chain(states).chain(sensor).collect()
}

fn older(delay_s: f64) -> &'static str {
    if delay_s > 0.0 { "older" } else { "younger" }
}

/// Where frames come from several cameras, which share no errors.
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
