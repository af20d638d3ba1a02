//! Parts and motions of two states, or of more.

use super::{
    Checkpoint, Event, RunError, Stages,
    articulation::{Articulation, Search, unite_states},
    state_surface::StateSurface,
};
use crate::{
    articulate::{EvidencePoint, LiftedMatch, Registration},
    config::Config,
    geometry::Pose,
    model::ArticulatedModel,
};

/// Positions of a joint within so many standard deviations, or within this share of what was observed of it, are the same.
const ALIKE_SIGMAS: f64 = 3.0;
const ALIKE_SHARE: f64 = 0.01;

/// Name of the stage of a state behind state 0, of so many states in all.
#[must_use]
pub(super) fn stage_of(name: &str, state: usize, count: usize) -> String {
    if count == 2 { name.to_owned() } else { format!("{name}/state{state}") }
}

/// Parts and motions, and what is told of them.
pub(super) struct Found {
    /// Parts and motions.
    pub articulation: Articulation,
    /// Motions to the last state that registration found, in its own order.
    pub registered: Vec<Pose>,
    /// Evidence by number of parts, most parts first.
    pub curve: Vec<EvidencePoint>,
    /// What was chosen, told already.
    pub notes: Vec<String>,
    /// What is weak, told already.
    pub warnings: Vec<String>,
}

/// Parts and motions of two states.
///
/// # Errors
/// Those of the search for consistency.
pub(super) fn found_in_pair(
    registration: &Registration,
    search: &Search,
    config: &Config,
    checkpoint: Option<&Checkpoint>,
    stages: &mut Stages,
) -> Result<Found, RunError> {
    let Registration { motions, curve, notes, warnings, .. } = registration.clone();
    warnings.iter().for_each(|w| stages.monitor.warn(w));
    notes.iter().for_each(|n| stages.monitor.tell(Event::Note { message: n.clone() }));
    let articulation = search.articulate(registration, config, checkpoint, stages)?;
    Ok(Found { articulation, registered: motions[1..].to_vec(), curve, notes, warnings })
}

/// Parts and motions of more than two states.
///
/// # Errors
/// Fewer parts than asked for.
pub(super) fn found_in_all(
    registrations: &[Registration],
    surfaces: &[StateSurface],
    matches: &[Vec<LiftedMatch>],
    config: &Config,
    checkpoint: Option<&Checkpoint>,
    stages: &mut Stages,
) -> Result<Found, RunError> {
    let united = stages.kept(checkpoint, "unite", None, |_| unite_states(surfaces, matches, registrations, config))?;
    let said = |of: fn(&Registration) -> &Vec<String>| {
        // Of a pair without motion nothing is told here.
        let moving = registrations.iter().enumerate().filter(|(_, r)| r.motions.len() > 1);
        moving.flat_map(move |(k, r)| of(r).iter().map(move |s| format!("states 0 and {}: {s}", k + 1))).collect::<Vec<_>>()
    };
    let notes = [said(|r| &r.notes), united.notes].concat();
    let warnings = [said(|r| &r.warnings), united.warnings].concat();
    warnings.iter().for_each(|w| stages.monitor.warn(w));
    notes.iter().for_each(|n| stages.monitor.tell(Event::Note { message: n.clone() }));
    let last = united.motions.last().cloned().unwrap_or_default();
    let articulation = Articulation { motions: united.motions, starts: last.clone(), labels: united.labels };
    Ok(Found { articulation, registered: last[1..].to_vec(), curve: united.curve, notes, warnings })
}

/// Sentences about states in which every joint stands as in an earlier one.
pub(super) fn more_views(model: &ArticulatedModel) -> Vec<String> {
    let std = |j: usize, state: usize| {
        let std = &model.joints[j].evidence.position_std;
        state.checked_sub(1).and_then(|k| std.get(k)).copied().filter(|s| s.is_finite()).unwrap_or_default()
    };
    let alike = |a: usize, b: usize| {
        let same = |j: usize| {
            let [lower, upper] = model.observed_interval(j);
            let apart = (model.states[a][j] - model.states[b][j]).abs();
            apart <= (ALIKE_SIGMAS * std(j, a).hypot(std(j, b))).max(ALIKE_SHARE * (upper - lower))
        };
        (0..model.joints.len()).all(same)
    };
    let said = |b: usize| {
        let a = (0..b).find(|&a| alike(a, b))?;
        Some(format!("state {b} shows all joints where state {a} does: it adds views, and no motion"))
    };
    (1..model.states.len()).filter_map(said).collect()
}
