//! Finds surface of the states that belongs to no part.

use super::{articulation::Articulation, scene::Scene, state::State};
use articulate::{OtherState, contradicted_points};
use common::note::{Note, NoteCode};
use geometry::{Pose, bounding_box};

/// Largest displacement of surface by errors of motions and depth, as a share of the truncation distance.
/// chosen: the truncation is four deviations of depth at least (docs/method.md 3.1)
const ERROR: f64 = 0.5;
/// Least share of a state's surface for which there is a warning.
/// derived: a smaller part is none either (docs/method.md 7)
const LEAST_SHARE: f64 = 0.004;

/// For each surface sample of each state, whether it belongs to no part (docs/method.md 9.1).
pub(super) fn left_out(states: &[State], articulation: &Articulation, scene: &Scene) -> Vec<Vec<bool>> {
    let error_m = ERROR * scene.band.truncation_m;
    let mut left_out = Vec::with_capacity(states.len());
    for (s, (state, parts)) in states.iter().zip(&articulation.states).enumerate() {
        let back: Vec<Pose> = parts.motions.iter().map(Pose::inverse).collect();
        let mut others = Vec::with_capacity(states.len());
        for t in (0..states.len()).filter(|t| *t != s) {
            let motions = articulation.states[t].motions.iter().zip(&back);
            let from_this = motions.map(|(to, back)| *to * *back).collect();
            others.push(OtherState { free: &states[t].surface.free, from_this });
        }
        left_out.push(contradicted_points(&state.surface.samples.points, &parts.labels, &others, error_m));
    }
    left_out
}

/// Warnings about left-out surface, one for each state with much of it.
pub(super) fn warnings(states: &[State], left_out: &[Vec<bool>]) -> Vec<Note> {
    let states = states.iter().zip(left_out).enumerate();
    states.filter_map(|(k, (state, out))| warning(k, state, out)).collect()
}

/// The warning about state number `k`; `None` if little of its surface is left out.
fn warning(k: usize, state: &State, out: &[bool]) -> Option<Note> {
    let share = out.iter().filter(|o| **o).count() as f64 / out.len().max(1) as f64;
    let points = &state.surface.samples.points;
    let places = points.iter().zip(out).filter(|(_, o)| **o).map(|(p, _)| *p);
    let (lower, upper) = bounding_box(places).filter(|_| share > LEAST_SHARE)?;
    let area_m2 = share * state.surface.mesh.area_m2();
    let [lower, upper] = [lower, upper].map(|p| format!("({:.2}, {:.2}, {:.2})", p.x, p.y, p.z));
    let text = format!(
        "{:.0} cm2 of the surface of state {k} ({:.1} %, from {lower} to {upper} m) are of no part and left \
         out: another state saw nothing where their part then is",
        1e4 * area_m2,
        100.0 * share,
    );
    Some(Note::new(NoteCode::SurfaceLeftOut, text))
}
