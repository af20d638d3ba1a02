//! Further positions of the joints of an object, beyond the two of its recordings.

use rand_core::Rng;

use super::{Object, SynthConfig, clearance};
use numeric::random::{self, stage_rng};

/// Tried positions of every state.
const TRIES: usize = 200;
/// Least distance of a position from those of the states before, as a share of the joint's range.
/// chosen: clearly different states
const APART: f64 = 0.08;

/// No further positions were found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no further positions of the joints of this {family} keep its parts clear; give another seed")]
pub struct NoPositions {
    family: &'static str,
}

/// The object with a further position of every joint as its state 1, once for every further state. Parts keep
/// clear of each other on the way from state 0.
///
/// # Errors
/// Where no such positions were found.
pub fn further_states(
    object: &Object,
    count: usize,
    config: &SynthConfig,
) -> Result<Vec<Object>, NoPositions> {
    let mut states: Vec<Object> = Vec::new();
    for state in 0..count {
        let rng = &mut stage_rng(config.seed, "synth/further", state as u64);
        let drawn = (0..TRIES).find_map(|_| drawn_positions(object, &states, rng));
        // Many joints leave little room: positions between those of the two states are always clear.
        let next = drawn.or_else(|| object_between(object, (state as f64 + 1.0) / (count as f64 + 1.0)));
        states.push(next.ok_or(NoPositions { family: object.family })?);
    }
    Ok(states)
}

/// The object with positions drawn away from those of all states so far; `None` where one is too near or
/// parts meet.
fn drawn_positions(object: &Object, states: &[Object], rng: &mut impl Rng) -> Option<Object> {
    let mut next = object.clone();
    for (k, part) in next.parts.iter_mut().enumerate() {
        let Some(joint) = part.joint.as_mut() else { continue };
        let first = object.parts[k].joint.iter().flat_map(|j| j.positions);
        let mut filmed = states.iter().filter_map(|s| s.parts[k].joint.map(|j| j.positions[1])).chain(first);
        let [low, high] = joint.limits;
        joint.positions[1] = random::uniform_in(rng, low, high);
        // A state near a filmed one shows nothing new.
        if filmed.any(|q| (q - joint.positions[1]).abs() < APART * (high - low)) {
            return None;
        }
    }
    clearance::is_free(&next).then_some(next)
}

/// The object with every joint a share of its way on; `None` where parts meet.
fn object_between(object: &Object, share: f64) -> Option<Object> {
    let mut next = object.clone();
    for joint in next.parts.iter_mut().filter_map(|p| p.joint.as_mut()) {
        joint.positions[1] = joint.positions[0] + share * (joint.positions[1] - joint.positions[0]);
    }
    clearance::is_free(&next).then_some(next)
}
