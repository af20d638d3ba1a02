//! The step that brings a state into the world frame of state 0.

use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use super::{RunError, stage_rng};
use crate::{
    articulate::{AlignedBy, LiftedMatch, StateAlignment, align_states, lift, match_states, standing_share},
    capture::{PoseNoise, RgbdFrame, align_worlds},
    config::Config,
    geometry::{Pose, SceneBox},
};

/// How a state is brought into the frame of state 0; [`moved_back`] moves its frames.
#[derive(Serialize, Deserialize)]
pub(super) struct Aligned {
    /// Matches with state 0, their ends in the state moved along.
    pub matches: Vec<LiftedMatch>,
    /// Takes what stands still from state 0's world frame to the state's, as recorded.
    pub world_from_world0: Pose,
    /// Covariance of a left perturbation (translation 3, rotation 3) of what stands still in the state so moved, square metres and
    /// radians, where surfaces tell.
    pub covariance: Option<Matrix6<f64>>,
    /// What was corrected, in words.
    pub note: String,
}

/// State number `state`, the second of `frames`, as it would have been recorded in the world frame of state 0; `None` where
/// it was.
///
/// # Errors
/// A drift that cannot be resolved.
pub(super) fn align(
    state: usize,
    frames: [&[RgbdFrame]; 2],
    matches: &[LiftedMatch],
    scene: &SceneBox,
    config: &Config,
) -> Result<Option<Aligned>, RunError> {
    let extent_m = scene.extent_m();
    let around = || {
        let turned = frames.map(|f| f.iter().map(surroundings).collect::<Vec<_>>());
        let states = [&turned[0][..], &turned[1][..]];
        lift(states, &match_states(states, &config.matching), &config.capture.noise)
    };
    let mut rng = stage_rng(config.run.seed, "align", state as u64 - 1);
    let standing = |motion: &Pose| standing_share(frames, motion, &config.capture.noise);
    let found =
        align_states(matches, around, standing, extent_m, &config.register.ransac, &mut rng).map_err(|e| RunError::stage("align", e))?;
    Ok(found.map(|mut a| {
        let mut covariance = None;
        // Matches bring the states near to each other, surfaces bring them together.
        let near = moved_back(frames[1], &a.state1_from_state0);
        let only_object = a.by == AlignedBy::LargestPart;
        if let Some(fine) = align_worlds([frames[0], &near], &config.capture.noise, &PoseNoise::EXPECTED, only_object) {
            a.state1_from_state0 *= fine.right_from_told.inverse();
            covariance = fine.covariance;
        }
        apply(&a, covariance, state, matches, scene)
    }))
}

/// The frame with what is not the object for its object.
fn surroundings(frame: &RgbdFrame) -> RgbdFrame {
    let others = (0..frame.depth_m.len()).map(|i| frame.depth_m[i] > 0.0 && !frame.is_object(i)).collect();
    RgbdFrame { mask: Some(others), ..frame.clone() }
}

/// Frames of a state in the world frame of state 0.
pub(super) fn moved_back(frames: &[RgbdFrame], world_from_world0: &Pose) -> Vec<RgbdFrame> {
    let back = world_from_world0.inverse();
    frames.iter().map(|f| RgbdFrame { world_from_camera: back * f.world_from_camera, ..f.clone() }).collect()
}

fn apply(alignment: &StateAlignment, covariance: Option<Matrix6<f64>>, state: usize, matches: &[LiftedMatch], scene: &SceneBox) -> Aligned {
    let back = alignment.state1_from_state0.inverse();
    let center = scene.center;
    let shift_mm = 1e3 * (alignment.state1_from_state0 * center - center).norm();
    let turn_deg = alignment.state1_from_state0.rotation.angle().to_degrees();
    let by = match alignment.by {
        AlignedBy::Surroundings => "its surroundings",
        AlignedBy::LargestPart => "its largest part",
    };
    let note = format!(
        "state {state} was recorded in another world frame than state 0, or the object was moved as a whole: by {shift_mm:.1} mm and \
         {turn_deg:.2} deg, told by {:.0} cells of matches on {by}; state {state} was moved back, and the twin stands as in state 0",
        alignment.cells
    );
    let matches = matches.iter().map(|m| LiftedMatch { point1: back * m.point1, ..*m }).collect();
    Aligned { matches, world_from_world0: alignment.state1_from_state0, covariance, note }
}
