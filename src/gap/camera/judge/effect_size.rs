//! Displacement of the surface due to effects; effects within the twin's own errors are dropped.

use crate::camera::{
    fit::problem::FrameProblem,
    judge::select::{Selected, with_set},
    model::displacement::made_m,
};
use common::note::{Note, NoteCode};

/// Drops effects moving the surface by less than the twin's errors.
pub(super) fn without_small(
    problem: &FrameProblem,
    mut selected: Selected,
    notes: &mut Vec<Note>,
) -> Selected {
    loop {
        let accuracy_m = selected.chosen.solution.components.surface_m;
        let own_m =
            |i: usize| accuracy_m.max(made_m(problem.twin, problem.trials[selected.chosen.set[i]].joint));
        let all = (0..selected.chosen.set.len()).map(|i| (i, moved_m(problem, &selected, i), own_m(i)));
        // One at a time, the smallest first: dropping it changes the displacement by the others.
        let least = all.min_by(|a, b| (a.1 / a.2).total_cmp(&(b.1 / b.2)));
        let Some((i, moved_m, own_m)) = least.filter(|(_, moved_m, own_m)| moved_m < own_m) else {
            return selected;
        };
        let mut set = selected.chosen.set.clone();
        let name = problem.trials[set.remove(i)].name;
        notes.push(Note::new(NoteCode::EffectTooSmall, format!(
            "{name} would move what is seen by {:.1} mm; too little for a twin whose own errors are {:.1} mm",
            1e3 * moved_m,
            1e3 * own_m
        )));
        let Some(next) = with_set(problem, &selected, &set) else { return selected };
        selected = next;
    }
}

/// Displacement across the surface by one effect of the set: root mean square without the largest 5 %,
/// meters.
fn moved_m(problem: &FrameProblem, selected: &Selected, which: usize) -> f64 {
    let linear = &selected.linear;
    let set = &selected.chosen.set;
    let own = &linear.of_trial[set[which]];
    let from = problem.nuisance.len() + set[..which].iter().map(|&t| linear.of_trial[t].len()).sum::<usize>();
    let values = selected.chosen.solution.values.rows(from, own.len());
    let concerned = (0..linear.system.matrix.nrows())
        .filter(|&i| own.iter().any(|&c| linear.system.matrix[(i, c)] != 0.0));
    let mut squares: Vec<f64> = Vec::new();
    for i in concerned {
        let moved: f64 = own.iter().zip(values.iter()).map(|(&c, x)| linear.system.matrix[(i, c)] * x).sum();
        squares.push(moved.powi(2));
    }
    squares.sort_unstable_by(f64::total_cmp);
    // A few conflicting patches must not count.
    let kept = squares.len() - squares.len() / 20;
    (squares[..kept].iter().sum::<f64>() / kept.max(1) as f64).sqrt()
}
