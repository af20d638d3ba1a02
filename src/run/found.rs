//! Finds the parts and motions of two or more states.

use super::{
    RunError, Stages,
    articulation::{Articulation, articulate, register_state, unite_states},
    scene::Scene,
    stage::stage_of,
    state::State,
};
use articulate::{EvidencePoint, Registration};
use common::note::{Note, NoteCode};
use geometry::Pose;
use model::ArticulatedModel;

/// Joint positions within this many standard deviations of each other count as equal.
///
/// chosen: three, 0.3 % of a normal distribution
const ALIKE_SIGMAS: f64 = 3.0;

/// Parts and motions, and notes about them.
pub(super) struct Found {
    /// Parts and motions.
    pub articulation: Articulation,
    /// Motions to the last state from registration, in its own order.
    pub registered: Vec<Pose>,
    /// Evidence by number of parts, most parts first.
    pub curve: Vec<EvidencePoint>,
    /// Notes about choices, such as the number of parts.
    pub notes: Vec<Note>,
    /// Warnings about weak evidence.
    pub warnings: Vec<Note>,
}

impl Found {
    /// Contains only the starts of the moving parts' motions.
    pub(crate) fn of_starts(starts: &[Pose]) -> Self {
        let starts = std::iter::once(Pose::identity()).chain(starts.iter().copied()).collect();
        let articulation = Articulation::new(Vec::new(), Vec::new(), starts);
        let registered = Vec::new();
        let curve = Vec::new();
        Self { articulation, registered, curve, notes: Vec::new(), warnings: Vec::new() }
    }
}

/// Parts and motions: registers state 0 with every other state, and makes the parts of all pairs.
///
/// # Errors
/// No motion, no overlap, fewer parts than asked for; those of the search for consistency.
pub(super) fn find_parts(states: &[State], scene: &Scene, stages: &mut Stages) -> Result<Found, RunError> {
    // With more states, each shows only some of the parts.
    let parts = scene.config.run.parts.filter(|_| states.len() == 2);
    let mut registrations = Vec::with_capacity(states.len());
    for state in 1..states.len() {
        let stage = stage_of("register", state, states.len());
        // All are registered with state 0, whose samples carry the labels of every pair.
        let checkpoint = stages.checkpoint;
        registrations.push(stages.kept(&stage, None, |monitor| {
            register_state(states, state, &stage, parts, scene, checkpoint, monitor)
        })?);
    }
    match (states, registrations.as_slice()) {
        ([state0, state1], [one]) => found_in_pair([state0, state1], one, scene, stages),
        (_, several) => found_in_all(states, several, scene, stages),
    }
}

/// Reports choices and weak evidence.
fn report(notes: &[Note], warnings: &[Note], stages: &Stages) {
    warnings.iter().for_each(|w| stages.monitor.warn(w));
    notes.iter().for_each(|n| stages.monitor.note(n));
}

/// Parts and motions of two states.
fn found_in_pair(
    states: [&State; 2],
    registration: &Registration,
    scene: &Scene,
    stages: &mut Stages,
) -> Result<Found, RunError> {
    let Registration { motions, curve, notes, warnings, .. } = registration.clone();
    report(&notes, &warnings, stages);
    let articulation = articulate(states, registration, scene, stages)?;
    Ok(Found { articulation, registered: motions[1..].to_vec(), curve, notes, warnings })
}

/// Parts and motions of more than two states.
fn found_in_all(
    states: &[State],
    registrations: &[Registration],
    scene: &Scene,
    stages: &mut Stages,
) -> Result<Found, RunError> {
    let united = stages.kept("unite", None, |_| unite_states(states, registrations, scene))?;
    let notes = [of_pairs(registrations, |r| &r.notes), united.notes].concat();
    let warnings = [of_pairs(registrations, |r| &r.warnings), united.warnings].concat();
    report(&notes, &warnings, stages);
    // The report compares with the last state, the only other one of two.
    let last = united.motions.last().cloned().unwrap_or_default();
    let articulation = Articulation::new(united.motions, united.labels, last.clone());
    Ok(Found { articulation, registered: last[1..].to_vec(), curve: united.curve, notes, warnings })
}

/// Notes of all pairs of states with a motion.
fn of_pairs(registrations: &[Registration], notes: fn(&Registration) -> &Vec<Note>) -> Vec<Note> {
    let mut all = Vec::new();
    for (k, found) in registrations.iter().enumerate().filter(|(_, r)| r.motions.len() > 1) {
        all.extend(notes(found).iter().map(|n| n.about(format_args!("states 0 and {}", k + 1))));
    }
    all
}

/// Notes on states in which every joint is as in an earlier one.
pub(super) fn more_views(model: &ArticulatedModel) -> Vec<Note> {
    let mut notes = Vec::new();
    for b in 1..model.states.len() {
        if let Some(a) = (0..b).find(|&a| alike(model, a, b)) {
            let text =
                format!("state {b} shows all joints where state {a} does: it adds views, and no motion");
            notes.push(Note::new(NoteCode::StateAddsNoMotion, text));
        }
    }
    notes
}

/// Whether every joint has the same position in two states, within its standard deviation.
fn alike(model: &ArticulatedModel, a: usize, b: usize) -> bool {
    (0..model.joints.len()).all(|joint| is_joint_alike(model, joint, a, b))
}

/// The same for one joint.
fn is_joint_alike(model: &ArticulatedModel, joint: usize, a: usize, b: usize) -> bool {
    let apart = (model.states[a][joint] - model.states[b][joint]).abs();
    let [std_a, std_b] = [a, b].map(|state| position_std(model, joint, state));
    // A state without a position of the joint equals no other.
    apart <= ALIKE_SIGMAS * std_a.hypot(std_b) && std_a.max(std_b).is_finite()
}

/// Standard deviation of a joint's position in a state, meters or radians: 0 in state 0.
fn position_std(model: &ArticulatedModel, joint: usize, state: usize) -> f64 {
    let std = &model.joints[joint].evidence.position_std;
    state.checked_sub(1).and_then(|k| std.get(k)).copied().unwrap_or_default()
}
