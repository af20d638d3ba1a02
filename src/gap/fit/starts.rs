//! Start states of windows, searched window by window. In a window with a contact, a catch or play,
//! Gauss-Newton from a single state ends in the nearest minimum, and a wrong start state would be taken for
//! noise of the effort.

use nalgebra::{Matrix2, Vector2};

use crate::{
    fit::{
        acting::Row,
        damping,
        problem::Problem,
        rollout::{Start, roll_starts},
        shooting::FIRST_DAMPING,
        whiten::Filter,
        whitening::{Whitening, start_ridge},
    },
    model::joint_model::JointModel,
    record::{drive::Drive, log::Span},
};
use numeric::statistics::chi_square_99;

/// Number of start states refined in a searched window.
const POLISHED: usize = 4;
/// Most Gauss-Newton steps of a refinement.
const POLISH_STEPS: usize = 6;
/// Factor of the damping after a step without a lower cost.
/// chosen: more than a decade, as steps are few.
const RISE: f64 = 20.0;
/// Tried positions of the sensor in the play at the start of a window.
/// chosen: the ends, the middle, and the quarter points.
const PLAY: [f64; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];
/// Pairs of samples giving recorded slopes, counted from the start of a window: (first, last).
const SLOPES: [(i64, i64); 8] = [(0, 1), (0, 2), (0, 4), (0, 8), (-2, 2), (-4, 0), (4, 8), (8, 16)];

/// A window simulated from one start state.
#[derive(Clone, Copy, Debug)]
struct StartTrial {
    start: Start,
    /// Sum of the squared whitened residuals.
    cost: f64,
    normal: Matrix2<f64>,
    gradient: Vector2<f64>,
}

impl StartTrial {
    /// Predicted cost after one step of the start state.
    fn promised_cost(&self) -> f64 {
        // The right basin may start at a higher cost, so trials are ranked by the cost predicted after one
        // step.
        let step = self.normal.try_inverse().map_or(0.0, |i| self.gradient.dot(&(i * self.gradient)));
        if self.cost.is_finite() { self.cost - step } else { f64::INFINITY }
    }
}

/// Inputs common to all trials.
struct Bench<'a, 'c> {
    problem: &'a Problem<'c>,
    model: &'a JointModel,
    drives: &'a [Drive],
    whitening: &'a Whitening,
    ridge: Matrix2<f64>,
}

impl Bench<'_, '_> {
    fn try_start(&self, window: usize, start: Start) -> StartTrial {
        let span = self.problem.windows[window];
        let log = &self.problem.logs[span.log];
        let measured = &log.position[span.start..span.start + span.len];
        let mut whitening = measured
            .iter()
            .zip(&self.whitening.locals[span.log][span.start..])
            .zip(&self.whitening.gains[window]);
        let mut filter = Filter::<3>::default();
        let [mut cost, mut aa, mut ab, mut bb, mut ae, mut be] = [0.0; 6];
        let drive = &self.drives[span.log];
        roll_starts(
            self.model,
            self.problem.catalogue,
            log,
            drive,
            span,
            start,
            |predicted: f64, row: &Row| {
                let Some(((measured, local), gain)) = whitening.next() else { return };
                let mut white = [row[0], row[1], measured - predicted];
                filter.pass_row(&mut white, local, gain);
                let [a, b, e] = white;
                cost += e * e;
                (aa, ab, bb, ae, be) = (aa + a * a, ab + a * b, bb + b * b, ae + a * e, be + b * e);
            },
        );
        let normal = self.ridge + Matrix2::new(aa, ab, ab, bb);
        StartTrial {
            start,
            cost: if cost.is_finite() { cost } else { f64::INFINITY },
            normal,
            gradient: Vector2::new(ae, be),
        }
    }

    /// Damped Gauss-Newton on the start state alone.
    fn polished_start(&self, window: usize, from: StartTrial) -> StartTrial {
        let mut now = from;
        let mut damping = FIRST_DAMPING;
        for _ in 0..POLISH_STEPS {
            let mut normal = now.normal;
            normal[(0, 0)] *= 1.0 + damping;
            normal[(1, 1)] *= 1.0 + damping;
            let Some(step) = normal.try_inverse().map(|i| i * now.gradient) else { break };
            let start = Start {
                position: now.start.position + step[0],
                velocity: now.start.velocity + step[1],
                ..now.start
            };
            let trial = self.try_start(window, start);
            if trial.cost < now.cost {
                let gained = now.cost - trial.cost;
                (now, damping) = (trial, damping * damping::FALL);
                // A gain of half a squared standard deviation does not change the winner.
                if gained < 0.5 {
                    break;
                }
            } else {
                damping = (damping * RISE).max(damping::LEAST_RISEN);
            }
        }
        now
    }

    /// The start state for the next window, if it follows without a gap.
    fn hand_on(&self, window: usize, start: Start) -> Option<Start> {
        let span = self.problem.windows[window];
        let next = self.problem.windows.get(window + 1)?;
        if next.log != span.log || next.start != span.start + span.len {
            return None;
        }
        // Windows share no sample: the next one starts one interval later.
        let longer = Span { len: span.len + 1, ..span };
        let log = &self.problem.logs[span.log];
        let end = roll_starts(
            self.model,
            self.problem.catalogue,
            log,
            &self.drives[span.log],
            longer,
            start,
            |_, _| (),
        );
        (end.position.is_finite() && end.velocity.is_finite()).then_some(end)
    }
}

/// The best start states for the model. Candidates are the given states, those of the smoothed motion, and
/// the end of the preceding window; where none of them fits, also states over the play and over the recorded
/// slopes. With `all`, the given states are compared with the others in every window, not only in badly
/// fitting ones.
pub fn improve_starts(
    problem: &Problem,
    model: &JointModel,
    starts: &mut [Start],
    whitening: &Whitening,
    all: bool,
) {
    let drives = problem.model_drives(model);
    let fresh = problem.smoothed_starts(model);
    let half_gap = model.position_sensor(problem.catalogue).half_gap;
    let ridge = start_ridge(problem);
    let bench = Bench { problem, model, drives: &drives, whitening, ridge };
    let mut carried = None;
    for w in 0..starts.len() {
        // Of the windows that fit, one in a hundred is searched in vain.
        let most = chi_square_99(problem.windows[w].len as f64);
        let fits = |t: &StartTrial| t.cost <= most;
        let given = bench.try_start(w, starts[w]);
        let mut trials = vec![given];
        // These trials cost one rollout each; most windows need no others.
        if all || !fits(&given) {
            trials.extend(std::iter::once(fresh[w]).chain(carried).map(|s| bench.try_start(w, s)));
            if half_gap > 0.0 {
                let more = [fresh[w], starts[w]]
                    .into_iter()
                    .flat_map(|s| PLAY.map(|p| (p != s.play).then(|| at_play(s, p, half_gap))));
                trials.extend(more.flatten().map(|s| bench.try_start(w, s)).collect::<Vec<_>>());
            }
            trials.sort_by(|a, b| a.promised_cost().total_cmp(&b.promised_cost()));
        }
        let mut best = trials[0];
        if !fits(&best) {
            best = searched_start(&bench, w, trials, &fresh[w], half_gap, &fits);
        }
        starts[w] = best.start;
        // Motion is continuous: the end state of one window is a good start for the next.
        carried = bench.hand_on(w, best.start);
    }
}

/// The best start state of a badly fitting window.
fn searched_start(
    bench: &Bench,
    w: usize,
    mut trials: Vec<StartTrial>,
    fresh: &Start,
    half_gap: f64,
    fits: &dyn Fn(&StartTrial) -> bool,
) -> StartTrial {
    // A single refinement costs less than the search below and often suffices.
    let quick = bench.polished_start(w, trials[0]);
    if fits(&quick) {
        return quick;
    }
    let span = bench.problem.windows[w];
    let log = &bench.problem.logs[span.log];
    let scale = bench.model.position_sensor(bench.problem.catalogue).scale;
    let last = log.time_s.len() as i64 - 1;
    let places: &[f64] = if half_gap > 0.0 { &PLAY } else { &[0.0] };
    // The smoothed motion ignores contacts and catches: near one its velocity is wrong, and slopes of the
    // recording are better.
    for (from, to) in SLOPES {
        let at = |k: i64| (span.start as i64 + k).clamp(0, last) as usize;
        let a = at(from);
        let b = at(to);
        if a == b {
            continue;
        }
        let velocity = (log.position[b] - log.position[a]) / (log.time_s[b] - log.time_s[a]) / scale;
        for play in places {
            let start = Start { velocity, ..at_play(*fresh, *play, half_gap) };
            trials.push(bench.try_start(w, start));
        }
    }
    trials.push(quick);
    trials.sort_by(|a, b| a.promised_cost().total_cmp(&b.promised_cost()));
    trials.truncate(POLISHED);
    // The first refinement stays a candidate, whatever its rank.
    trials.push(quick);
    let polished: Vec<StartTrial> = trials.into_iter().map(|t| bench.polished_start(w, t)).collect();
    polished.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).unwrap_or(quick)
}

/// The start state at another position in the play, with the sensor's reading unchanged.
fn at_play(start: Start, play: f64, half_gap: f64) -> Start {
    if half_gap == 0.0 {
        return start;
    }
    Start { position: start.position + (start.play - play) * half_gap, play, ..start }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        fit::noise::EffortNoise,
        model::{
            actuator::Actuator,
            effects::catalogue,
            plant::{Load, Plant},
        },
        record::{drive::Hold, log::JointLog},
    };

    /// A joint that runs into its stop and through its play, from start states that are far off in every
    /// window.
    #[test]
    fn windows_with_contacts_and_play_find_their_start_states() {
        let effects = catalogue(0);
        let of = |name: &str| effects.iter().position(|e| e.name() == name).unwrap();
        let plant = Plant {
            inertia: 0.1,
            damping: 0.05,
            friction: 0.0,
            load: Load { sine: 4.0, ..Load::default() },
            most_load: 4.0,
            actuator: Actuator::default(),
        };
        let stop = JointModel::of_plant(&plant).with_effect(of("end_stop"), &[220.0, 7.0, 0.2, 0.9]);
        let play = JointModel::of_plant(&plant).with_effect(of("backlash"), &[0.02]);
        for model in [stop, play] {
            let time_s: Vec<f64> = (0..800).map(|k| 0.005 * f64::from(k)).collect();
            let effort: Vec<f64> =
                time_s.iter().map(|t| 0.9 * (7.0 * t).sin() + 0.3 * (23.0 * t).cos()).collect();
            let mut log =
                JointLog { run: "r".into(), position: vec![0.0; 800], effort, time_s, ..JointLog::default() };
            let drive = Drive::with_steps(&log, Hold::Zero, 0.0, 1);
            let mut position = Vec::new();
            let keep = |q: f64, _: &Row| position.push(q);
            roll_starts(
                &model,
                &effects,
                &log,
                &drive,
                Span { log: 0, start: 0, len: 800 },
                Start::default(),
                keep,
            );
            log.position = position
                .iter()
                .enumerate()
                .map(|(k, q)| q + 1e-4 * f64::from((k * 37 % 11) as u32) - 5e-4)
                .collect();
            let problem = Problem::new(&effects, &plant, true, vec![log], Hold::Zero);
            let whitening = Whitening::new(&problem, &model, &EffortNoise::white_noise(problem.min_sigma_u));
            let far: Vec<Start> = problem
                .smoothed_starts(&model)
                .iter()
                .map(|s| Start { position: s.position + 0.05, velocity: s.velocity - 2.0, ..*s })
                .collect();
            let mut starts = far.clone();
            improve_starts(&problem, &model, &mut starts, &whitening, true);
            let drives = problem.model_drives(&model);
            let ridge = start_ridge(&problem);
            let bench =
                Bench { problem: &problem, model: &model, drives: &drives, whitening: &whitening, ridge };
            let cost = |from: &[Start]| {
                from.iter().enumerate().map(|(w, s)| bench.try_start(w, *s).cost).sum::<f64>()
            };
            let before = cost(&far);
            let after = cost(&starts);
            assert!(after < 2.0 * 800.0 && before > 1e3 * after, "{before} {after}");
        }
    }
}
