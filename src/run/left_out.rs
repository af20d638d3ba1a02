//! Surface of the states that no part gets.

use nalgebra::Point3;

use super::{articulation::Articulation, scene::Scene, state::State};
use articulate::{OtherState, contradicted_points};
use common::note::{Note, NoteCode};
use geometry::{Pose, bounding_box};

/// Errors of motions and depth take surface by less than this share of the truncation.
/// chosen: the truncation is four deviations of depth at least (docs/method.md 3.1)
const ERROR: f64 = 0.5;
/// Less of a state's surface is not worth a warning.
/// derived: what explains less is no part either (docs/method.md 7)
const LEAST_SHARE: f64 = 0.004;

/// For each surface sample of each state whether no part gets it (docs/method.md 9.1).
pub(super) fn left_out(states: &[State], articulation: &Articulation, scene: &Scene) -> Vec<Vec<bool>> {
    let error_m = ERROR * scene.band.truncation_m;
    let of = |s: usize| {
        let back: Vec<Pose> = articulation.states[s].motions.iter().map(Pose::inverse).collect();
        let other = |t: usize| OtherState {
            free: &states[t].surface.free,
            from_this: articulation.states[t]
                .motions
                .iter()
                .zip(&back)
                .map(|(to, back)| *to * *back)
                .collect(),
        };
        let others: Vec<OtherState<'_>> = (0..states.len()).filter(|t| *t != s).map(other).collect();
        contradicted_points(
            &states[s].surface.samples.points,
            &articulation.states[s].labels,
            &others,
            error_m,
        )
    };
    (0..states.len()).map(of).collect()
}

/// What is said of it.
pub(super) fn warnings(states: &[State], left_out: &[Vec<bool>]) -> Vec<Note> {
    let warning = |(k, (state, out)): (usize, (&State, &Vec<bool>))| {
        let share = out.iter().filter(|o| **o).count() as f64 / out.len().max(1) as f64;
        let points = &state.surface.samples.points;
        let places = points.iter().zip(out).filter(|(_, o)| **o).map(|(p, _)| *p);
        let (lower, upper) = bounding_box(places).filter(|_| share > LEAST_SHARE)?;
        let area_m2 = share * state.surface.mesh.area_m2();
        let corner = |p: Point3<f64>| format!("({:.2}, {:.2}, {:.2})", p.x, p.y, p.z);
        let text = format!(
            "{:.0} cm2 of the surface of state {k} ({:.1} %, from {} to {} m) are of no part and left out: \
             another state saw nothing where their part then is",
            1e4 * area_m2,
            100.0 * share,
            corner(lower),
            corner(upper),
        );
        Some(Note::new(NoteCode::SurfaceLeftOut, text))
    };
    states.iter().zip(left_out).enumerate().filter_map(warning).collect()
}
