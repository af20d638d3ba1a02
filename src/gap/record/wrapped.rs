//! Angles that an encoder wraps, continued over the jumps.

use crate::record::recording::Recording;

/// Steps from whose median the first velocity is taken.
/// chosen: few of them jump.
const FIRST_STEPS: usize = 9;
/// Degrees of a turn, for positions that were recorded in degrees. derived: by definition
const DEGREES: f64 = 360.0;

/// Continues the angles of a joint over jumps of a turn, within runs and from run to run; returns whether
/// there was a jump. A jump is a step that is off the motion before it by more than half a turn: of 2 pi, or
/// of 360 where a step is too long for radians.
pub fn unwrap_turns<'r>(runs: impl Iterator<Item = &'r mut Recording>, joint: &str) -> bool {
    let samples = runs.filter_map(|run| run.joints.iter_mut().find(|s| s.name == joint));
    let mut all: Vec<_> = samples.map(|s| (&s.time_s[..], &mut s.position[..])).collect();
    let most = all.iter().map(|(time_s, q)| largest_jump(time_s, q)).fold(0.0, f64::max);
    let turn = if most > 0.5 * DEGREES { DEGREES } else { std::f64::consts::TAU };
    if most <= 0.5 * turn {
        return false;
    }
    let mut middle: Option<f64> = None;
    for (time_s, q) in &mut all {
        continue_angles(time_s, q, turn);
        let Some(own) = numeric::statistics::median(q.iter().copied().filter(|q| q.is_finite()).collect())
        else {
            continue;
        };
        // The first run says which of the turns is counted from.
        let turns = ((own - *middle.get_or_insert(own)) / turn).round();
        q.iter_mut().for_each(|q| *q -= turns * turn);
    }
    true
}

/// Steps between finite positions less the motion before them: index and size.
fn unforeseen_steps(time_s: &[f64], position: &[f64]) -> Vec<(usize, f64)> {
    let known: Vec<usize> = (0..position.len()).filter(|&k| position[k].is_finite()).collect();
    let mut steps = Vec::with_capacity(known.len());
    let first = known.windows(2).take(FIRST_STEPS);
    let rates =
        first.map(|pair| (position[pair[1]] - position[pair[0]]) / (time_s[pair[1]] - time_s[pair[0]]));
    let mut velocity = numeric::statistics::median(rates.filter(|r| r.is_finite()).collect()).unwrap_or(0.0);
    for pair in known.windows(2) {
        let width = time_s[pair[1]] - time_s[pair[0]];
        let step = position[pair[1]] - position[pair[0]];
        let unforeseen = step - velocity * width;
        steps.push((pair[1], unforeseen));
        // A jump says nothing of the velocity.
        if width > 0.0 && unforeseen.abs() < 0.5 * std::f64::consts::TAU {
            velocity = step / width;
        }
    }
    steps
}

/// Size of the largest unforeseen step.
fn largest_jump(time_s: &[f64], position: &[f64]) -> f64 {
    unforeseen_steps(time_s, position).iter().map(|(_, step)| step.abs()).fold(0.0, f64::max)
}

/// Subtracts from each position the whole turns of the jumps up to it.
fn continue_angles(time_s: &[f64], position: &mut [f64], turn: f64) {
    let jumps = unforeseen_steps(time_s, position);
    let mut turns = 0.0;
    let mut next = jumps.iter().peekable();
    for (k, q) in position.iter_mut().enumerate() {
        if let Some((_, step)) = next.next_if(|(at, _)| *at == k) {
            turns += (step / turn).round();
        }
        *q -= turns * turn;
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use super::*;
    use crate::record::recording::JointSamples;

    /// Two runs of a swing about an angle, in units of `turn / TAU` and wrapped from `-turn / 2` on.
    fn runs(about: f64, turn: f64) -> Vec<Recording> {
        let mut runs = Vec::new();
        for run in 0..2 {
            let time_s: Vec<f64> = (0..400).map(|k| 0.02 * f64::from(k)).collect();
            let angle = |t: &f64| about + (0.1 * f64::from(run)) + 1.5 * (2.0 * t).sin();
            let wrapped = |q: f64| ((q + PI).rem_euclid(TAU) - PI) * turn / TAU;
            let position: Vec<f64> = time_s.iter().map(|t| wrapped(angle(t))).collect();
            let n = time_s.len();
            let samples = JointSamples {
                name: "j".into(),
                time_s,
                position,
                effort: vec![0.0; n],
                velocity: vec![f64::NAN; n],
            };
            runs.push(Recording { joints: vec![samples], ..Recording::default() });
        }
        runs
    }

    fn largest_step(runs: &[Recording]) -> f64 {
        let steps = runs.iter().flat_map(|r| r.joints[0].position.windows(2)).map(|w| (w[1] - w[0]).abs());
        steps.fold(0.0, f64::max)
    }

    #[test]
    fn angles_go_on_over_jumps_and_runs_count_from_the_same_turn() {
        for turn in [TAU, 360.0] {
            let mut runs = runs(3.0, turn);
            assert!(largest_step(&runs) > 0.9 * turn);
            assert!(unwrap_turns(runs.iter_mut(), "j"));
            assert!(largest_step(&runs) < 0.02 * turn, "{turn}");
            let [a, b] = [0, 1].map(|r| runs[r].joints[0].position[0]);
            assert!((b - a - 0.1 * turn / TAU).abs() < 1e-9, "{turn}");
        }
    }

    #[test]
    fn a_fast_motion_in_degrees_is_no_jump() {
        // 8.6 degrees from sample to sample, more than half of 2 pi.
        let mut runs = runs(0.0, 360.0);
        let before = runs.clone();
        assert!(largest_step(&runs) > PI);
        assert!(!unwrap_turns(runs.iter_mut(), "j"));
        for (run, before) in runs.iter().zip(&before) {
            assert_eq!(run.joints[0].position, before.joints[0].position);
        }
    }
}
