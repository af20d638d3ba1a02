//! Further positions of the joints of an object, beyond the two of its recordings.

use super::{Object, SynthConfig, clearance, draw};
use crate::run::stage_rng;

/// Positions that are tried for every state.
const TRIES: usize = 200;
/// Least distance of a position from those of the states before, as a share of the joint's range.
const APART: f64 = 0.08;

/// The object with a further position of every joint as its state 1, once for every further state. Parts keep clear of
/// each other on the way from state 0.
///
/// # Errors
/// A sentence where no such positions were found.
pub fn further_states(object: &Object, count: usize, config: &SynthConfig) -> Result<Vec<Object>, String> {
    let joined = object.family != "cabinet";
    let parent = |part: usize| object.parts[part].joint.map(|j| j.parent);
    let hinge = |a: usize, b: usize| joined && (parent(a) == Some(b) || parent(b) == Some(a));
    let mut states: Vec<Object> = Vec::new();
    for state in 0..count {
        let rng = &mut stage_rng(config.seed, "synth/further", state as u64);
        let mut attempt = || {
            let mut next = object.clone();
            for k in 0..next.parts.len() {
                let before: Vec<f64> = object.parts[k].joint.iter().flat_map(|j| j.positions).collect();
                let filmed: Vec<f64> = states.iter().filter_map(|s| s.parts[k].joint.map(|j| j.positions[1])).chain(before).collect();
                let Some(joint) = next.parts[k].joint.as_mut() else { continue };
                let [low, high] = joint.limits;
                joint.positions[1] = draw::range(rng, low, high);
                if filmed.iter().any(|q| (q - joint.positions[1]).abs() < APART * (high - low)) {
                    return None;
                }
            }
            clearance::is_free(&next, &hinge).then_some(next)
        };
        let found = (0..TRIES).find_map(|_| attempt());
        // Many joints leave little room: positions between those of the two states are always clear.
        let between = || {
            let mut next = object.clone();
            let share = (state as f64 + 1.0) / (count as f64 + 1.0);
            for joint in next.parts.iter_mut().filter_map(|p| p.joint.as_mut()) {
                joint.positions[1] = joint.positions[0] + share * (joint.positions[1] - joint.positions[0]);
            }
            clearance::is_free(&next, &hinge).then_some(next)
        };
        let why = || format!("no further positions of the joints of this {} keep its parts clear; give another seed", object.family);
        states.push(found.or_else(between).ok_or_else(why)?);
    }
    Ok(states)
}
