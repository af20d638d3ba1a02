//! The stage `align`: matches every state with state 0 and moves it into the world frame of state 0.

use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use super::{
    RunError, Stages,
    matching::{pairs, pixel_matches},
    scene::bounds,
    stage::stage_of,
};
use articulate::{AlignedBy, LiftedMatch, StateAlignment, align_states, lifted_matches, standing_shares};
use capture::{Capture, NoiseConfig, PoseNoise, RgbdFrame, align_worlds, match_states};
use common::{
    note::{Note, NoteCode},
    stop::{Stop, Stopped},
};
use config::Config;
use geometry::{Pose, SceneBox};
use io::OnnxMatcher;
use numeric::random::stage_rng;

/// How a state was brought into the world frame of state 0.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Drift {
    /// Motion of still surfaces from state 0's world frame to the state's, as recorded.
    pub world_from_world0: Pose,
    /// Covariance of a left perturbation (translation 3, rotation 3) of still surfaces in the state after
    /// this correction, square meters and radians; `None` if surfaces do not show it.
    pub covariance: Option<Matrix6<f64>>,
    /// A note that describes the correction.
    pub note: Note,
}

impl Drift {
    /// Moves frames of the state into the world frame of state 0.
    fn undo(&self, frames: &mut [RgbdFrame]) {
        move_back(&self.world_from_world0, frames);
    }

    /// Moves the ends of matches in the state into that frame.
    fn undo_matches(&self, matches: &mut [LiftedMatch]) {
        let back = self.world_from_world0.inverse();
        matches.iter_mut().for_each(|m| m.point1 = back * m.point1);
    }
}

/// Moves frames by the inverse of a motion of their world.
fn move_back(world_from_world0: &Pose, frames: &mut [RgbdFrame]) {
    let back = world_from_world0.inverse();
    frames.iter_mut().for_each(|f| f.world_from_camera = back * f.world_from_camera);
}

/// Matches and drift of a state relative to state 0; empty for state 0 itself.
#[derive(Clone, Default)]
pub(super) struct Aligned {
    /// Matches with state 0, in its world frame.
    pub matches: Vec<LiftedMatch>,
    /// How the state was brought into that frame; none if it was recorded in it.
    pub drift: Option<Drift>,
}

/// Matches all states with state 0 and moves their frames into its world frame; also returns the box around
/// the object over all states.
///
/// # Errors
/// A failure of the matching model, an unresolved drift, a stop request.
pub(super) fn align(
    capture: &mut Capture,
    matcher: Option<&OnnxMatcher>,
    config: &Config,
    stages: &mut Stages,
) -> Result<(Vec<Aligned>, SceneBox), RunError> {
    // From the states as recorded: only scale and center are used.
    let scene = bounds(capture)?;
    let mut all = vec![Aligned::default()];
    // Every state is aligned with state 0, whose world is the twin's, so errors do not add up.
    for state in 1..capture.states.len() {
        let aligned = align_state(state, capture, matcher, &scene, config, stages)?;
        if let Some(drift) = &aligned.drift {
            stages.monitor.warn(&drift.note);
            drift.undo(&mut capture.states[state]);
        }
        all.push(aligned);
    }
    let moved = all.iter().any(|aligned| aligned.drift.is_some());
    Ok((all, if moved { bounds(capture)? } else { scene }))
}

/// Matches of state 0 with another state, in the world frame of state 0, and the motion of that state there.
fn align_state(
    state: usize,
    capture: &Capture,
    matcher: Option<&OnnxMatcher>,
    scene: &SceneBox,
    config: &Config,
    stages: &mut Stages,
) -> Result<Aligned, RunError> {
    let count = capture.states.len();
    let frames = [&capture.states[0][..], &capture.states[state][..]];
    let steps = matcher.map(|_| pairs(frames, &config.matching));
    let matches = stages.kept(&stage_of("match", state, count), steps, |m| {
        pixel_matches(frames, &capture.matches, matcher, &config.matching, m)
    })?;
    // Pixels are kept, not points: points follow from pixels and frames.
    let mut matches = lifted_matches(frames, &matches, &capture.noise);
    let drift = stages.kept(&stage_of("align", state, count), None, |monitor| {
        drift(state, frames, &matches, scene, &capture.noise, config, &monitor.stop())
    })?;
    if let Some(drift) = &drift {
        drift.undo_matches(&mut matches);
    }
    Ok(Aligned { matches, drift })
}

/// How far the world frame of state number `state`, the second of `frames`, is from that of state 0; `None`
/// if they are the same.
///
/// # Errors
/// An unresolved drift, a stop request.
fn drift(
    state: usize,
    frames: [&[RgbdFrame]; 2],
    matches: &[LiftedMatch],
    scene: &SceneBox,
    noise: &NoiseConfig,
    config: &Config,
    stop: &Stop,
) -> Result<Option<Drift>, RunError> {
    // Called only if the object's matches do not stand still, as it matches all frames once more.
    let around = || surroundings_matches(frames, noise, config);
    let mut rng = stage_rng(config.run.seed, "align", state as u64 - 1);
    let standing = |motion: &Pose| standing_shares(frames, motion, noise);
    let found = align_states(matches, around, standing, scene.extent_m(), &mut rng)
        .map_err(|e| RunError::stage("align", e))?;
    Ok(found.map(|alignment| refined(alignment, state, frames, scene, noise, stop)).transpose()?)
}

/// The drift of an alignment: matches bring the states near each other, then surfaces refine.
fn refined(
    alignment: StateAlignment,
    state: usize,
    frames: [&[RgbdFrame]; 2],
    scene: &SceneBox,
    noise: &NoiseConfig,
    stop: &Stop,
) -> Result<Drift, Stopped> {
    let StateAlignment { state1_from_state0: world_from_world0, by, cells } = alignment;
    // Surfaces are compared where they project, so they must already be near each other.
    let mut near = frames[1].to_vec();
    move_back(&world_from_world0, &mut near);
    // Rule 4 of docs/method.md 5: the surroundings did not move like this and must not pull.
    let only_object = by == AlignedBy::LargestPart;
    // docs/method.md (2.13) between the states, kept if held-out surfels gain by it (2.16).
    let fine = align_worlds([frames[0], &near], noise, &PoseNoise::EXPECTED, only_object, stop)?;
    let (motion, covariance) = match fine {
        Some(fine) => (world_from_world0 * fine.corrected_from_reported.inverse(), fine.covariance),
        None => (world_from_world0, None),
    };
    let center = scene.center;
    let by = match by {
        AlignedBy::Surroundings => "its surroundings",
        AlignedBy::LargestPart => "its largest part",
    };
    let text = format!(
        "state {state} was recorded in another world frame than state 0, or the object was moved as a whole: \
         by {:.1} mm and {:.2} deg, by {cells:.0} cells of matches on {by}; state {state} was moved back, \
         and the twin stands as in state 0",
        1e3 * (motion * center - center).norm(),
        motion.rotation.angle().to_degrees(),
    );
    let note = Note::new(NoteCode::WorldFrameDiffers, text);
    Ok(Drift { world_from_world0: motion, covariance, note })
}

/// Matches of the surroundings of the object in two states.
fn surroundings_matches(frames: [&[RgbdFrame]; 2], noise: &NoiseConfig, config: &Config) -> Vec<LiftedMatch> {
    let turned = frames.map(|f| f.iter().map(surroundings).collect::<Vec<_>>());
    let states = [&turned[0][..], &turned[1][..]];
    lifted_matches(states, &match_states(states, &config.matching), noise)
}

/// The frame with its mask inverted: the surroundings in place of the object.
fn surroundings(frame: &RgbdFrame) -> RgbdFrame {
    let others = (0..frame.depth_m.len()).map(|i| frame.depth_m[i] > 0.0 && !frame.is_object(i)).collect();
    RgbdFrame { mask: Some(others), ..frame.clone() }
}
