//! The twin as its runs show it: joints that stand still are fixed where they stand, followers move with
//! their leaders, and angles go on over the jumps of their encoders.

use common::note::{Note, NoteCode};
use gap::{
    model::plant::{LEAST_CHANGE, Plant},
    record::{
        recording::{JointSamples, Recording},
        standing::standing_position,
        wrapped::unwrap_turns,
    },
    twin_tree::{Motion, TwinJoint, TwinTree},
};

/// The twin as its runs show it, and notes on what was changed. Positions of the runs become continuous, and
/// followers (`<mimic>`) without positions get those of their leaders.
pub(super) fn recorded_twin(tree: &TwinTree, recordings: &mut [(Recording, bool)]) -> (TwinTree, Vec<Note>) {
    let mut notes = notes_on_text(tree);
    for joint in tree.joints.iter().filter(|j| j.motion == Motion::Turn) {
        if unwrap_turns(recordings.iter_mut().map(|(run, _)| run), &joint.name) {
            let text = format!(
                "joint '{}': its angle jumps by a turn; positions go on over the jumps, counted from the \
                 first run",
                joint.name
            );
            notes.push(Note::new(NoteCode::PositionsWrapped, text));
        }
    }
    for (run, _) in recordings.iter_mut() {
        add_followers(tree, run);
    }
    let runs: Vec<&Recording> = recordings.iter().map(|(run, _)| run).collect();
    let mut posed = tree.clone();
    let standing: Vec<Option<f64>> = tree.joints.iter().map(|j| standing_joint(&runs, j)).collect();
    let mut is_moving = Vec::with_capacity(tree.joints.len());
    for (joint, standing) in tree.joints.iter().zip(&standing) {
        let may_move = joint.is_independent() && standing.is_none();
        is_moving.push(may_move && is_recorded(&runs, &joint.name));
    }
    // Where nothing moves, the verdict of each joint says so.
    if !is_moving.contains(&true) {
        return (posed, notes);
    }
    for (j, standing) in standing.iter().enumerate() {
        if let Some(position) = standing {
            fix_joint(&mut posed.joints[j], *position);
            let text = format!(
                "joint '{}' stands still in all runs: it is taken as fixed at {position:.4} and not \
                 diagnosed",
                tree.joints[j].name
            );
            notes.push(Note::new(NoteCode::JointFixed, text));
        }
    }
    for j in 0..tree.joints.len() {
        let joint = &tree.joints[j];
        if posed.joints[j].motion == Motion::Fixed || is_recorded(&runs, &joint.name) {
            continue;
        }
        let above: Vec<usize> = posed.chain_joints(j).into_iter().filter(|k| is_moving[*k]).collect();
        if !above.is_empty() && above.iter().all(|k| is_hardly_felt(&posed, j, *k)) {
            fix_joint(&mut posed.joints[j], 0.0);
            let text = format!(
                "joint '{}' is not recorded, and where it stands hardly loads the others: it is taken as \
                 fixed at 0",
                joint.name
            );
            notes.push(Note::new(NoteCode::JointFixed, text));
        }
    }
    (posed, notes)
}

/// Notes on what the URDF says and a diagnosis reads in its own way.
fn notes_on_text(tree: &TwinTree) -> Vec<Note> {
    let mut notes = Vec::new();
    for joint in tree.joints.iter().filter(|j| j.is_free) {
        let text = format!("joint '{}' floats or is planar: it is taken as fixed at its origin", joint.name);
        notes.push(Note::new(NoteCode::JointFixed, text));
    }
    for link in tree.links.iter().filter(|l| l.inertia_excess > 0.0) {
        let text = format!(
            "link '{}': no body can have its inertia; it counts where a joint hardly feels it",
            link.name
        );
        notes.push(Note::new(NoteCode::InertiaImpossible, text));
    }
    notes
}

fn is_recorded(runs: &[&Recording], joint: &str) -> bool {
    runs.iter().filter_map(|run| run.samples(joint)).any(JointSamples::has_positions)
}

fn standing_joint(runs: &[&Recording], joint: &TwinJoint) -> Option<f64> {
    if joint.motion == Motion::Fixed { None } else { standing_position(runs, &joint.name) }
}

/// Makes a joint a fixed one at a position.
fn fix_joint(joint: &mut TwinJoint, position: f64) {
    joint.parent_from_joint *= joint.motion_to(position);
    joint.motion = Motion::Fixed;
}

/// Adds positions of followers that a run has none of, from those of their leaders.
fn add_followers(tree: &TwinTree, run: &mut Recording) {
    // A leader may follow another one; no chain of followers is longer than the list of joints.
    for _ in 0..tree.joints.len() {
        let mut added = Vec::new();
        for joint in &tree.joints {
            let Some(mimic) = &joint.mimic else { continue };
            if run.samples(&joint.name).is_some_and(JointSamples::has_positions) {
                continue;
            }
            let Some(leader) = run.samples(&mimic.joint) else { continue };
            if !leader.has_positions() {
                continue;
            }
            let unknown = vec![f64::NAN; leader.time_s.len()];
            added.push(JointSamples {
                name: joint.name.clone(),
                time_s: leader.time_s.clone(),
                position: leader.position.iter().map(|q| mimic.multiplier * q + mimic.offset).collect(),
                effort: unknown.clone(),
                velocity: unknown,
            });
        }
        if added.is_empty() {
            return;
        }
        run.joints.retain(|s| !added.iter().any(|a| a.name == s.name));
        run.joints.extend(added);
        run.joints.sort_by(|a, b| a.name.cmp(&b.name));
    }
}

/// Whether the position of joint `loose` hardly changes the inertia and the load of joint `felt`.
fn is_hardly_felt(tree: &TwinTree, loose: usize, felt: usize) -> bool {
    let Ok(plant) = Plant::of_joint(tree, felt) else { return false };
    let (low, high) = tree.joints[loose].limit.unwrap_or((-std::f64::consts::PI, std::f64::consts::PI));
    let mut at_zero = vec![0.0; tree.joints.len()];
    let inertia = tree.mass_matrix(&at_zero)[(felt, felt)];
    let load = tree.gravity_effort(&at_zero)[felt];
    [low, 0.5 * (low + high), high].into_iter().all(|position| {
        at_zero[loose] = position;
        (tree.mass_matrix(&at_zero)[(felt, felt)] - inertia).abs() <= LEAST_CHANGE * plant.inertia
            && (tree.gravity_effort(&at_zero)[felt] - load).abs() <= LEAST_CHANGE * plant.most_load
    })
}
