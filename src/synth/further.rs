//! Further joint positions of an object, beyond those of the first two states.

use rand_core::Rng;

use super::{Object, SynthConfig, clearance};
use numeric::random::{self, stage_rng};

/// Most random positions tried per state.
const TRIES: usize = 200;
/// Least distance of a joint position from those of earlier states, share of the joint's range.
/// chosen: clearly different states
const APART: f64 = 0.08;

/// No collision-free joint positions were found for the further states.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no further positions of the joints of this {family} keep its parts clear; give another seed")]
pub struct NoPositions {
    family: &'static str,
}

/// For every further state, the object with these joint positions as its state 1. Parts do not collide on the
/// way from state 0.
///
/// # Errors
/// [`NoPositions`] if none were found.
pub fn further_states(
    object: &Object,
    count: usize,
    config: &SynthConfig,
) -> Result<Vec<Object>, NoPositions> {
    let mut states: Vec<Object> = Vec::new();
    for state in 0..count {
        let rng = &mut stage_rng(config.seed, "synth/further", state as u64);
        let drawn = (0..TRIES).find_map(|_| drawn_positions(object, &states, rng));
        // With many joints there is little space, but positions between the two states are always free.
        let next = drawn.or_else(|| object_between(object, (state as f64 + 1.0) / (count as f64 + 1.0)));
        states.push(next.ok_or(NoPositions { family: object.family })?);
    }
    Ok(states)
}

/// The object with random positions away from those of all earlier states; `None` if one is too close or
/// parts collide.
fn drawn_positions(object: &Object, states: &[Object], rng: &mut impl Rng) -> Option<Object> {
    let mut next = object.clone();
    for (k, part) in next.parts.iter_mut().enumerate() {
        let Some(joint) = part.joint.as_mut() else { continue };
        let first = object.parts[k].joint.iter().flat_map(|j| j.positions);
        let mut filmed = states.iter().filter_map(|s| s.parts[k].joint.map(|j| j.positions[1])).chain(first);
        let [low, high] = joint.limits;
        joint.positions[1] = random::uniform_in(rng, low, high);
        // A state close to a recorded one shows nothing new.
        if filmed.any(|q| (q - joint.positions[1]).abs() < APART * (high - low)) {
            return None;
        }
    }
    clearance::is_free(&next).then_some(next)
}

/// The object with every joint at a share of its way; `None` if parts collide.
fn object_between(object: &Object, share: f64) -> Option<Object> {
    let mut next = object.clone();
    for joint in next.parts.iter_mut().filter_map(|p| p.joint.as_mut()) {
        joint.positions[1] = joint.positions[0] + share * (joint.positions[1] - joint.positions[0]);
    }
    clearance::is_free(&next).then_some(next)
}
