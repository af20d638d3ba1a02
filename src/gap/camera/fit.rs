//! Gauss-Newton over a hypothesis: compare, average, linearize, solve, advance.

use nalgebra::DVector;
use rayon::prelude::*;

use super::{
    assess::FrameOptions,
    cells::{Cell, cells},
    effects,
    frames::FrameRun,
    missing::Missing,
    mixed::{Column, Reduced, Sizes, Solution, System, best},
    parameter::{Parameter, Stage, advance},
    residual::{PixelSample, Pixels, compare},
    trial::{Trial, column, free_joints, twin_column},
    twin::{Hypothesis, SeenTwin},
};

/// Residuals beyond this are conflicts, metres.
pub const GATE_M: f64 = 0.05;
/// Priors of the object's placement in a run.
const ROOT: [f64; 2] = [0.03, 0.05];
/// Priors of a step of a joint's position, rad and m.
const STEP: [f64; 2] = [0.3, 0.05];
/// Errors of a told position, rad and m.
const TOLD: [f64; 2] = [0.002, 0.0005];
/// Sizes of the errors without names while a hypothesis is being moved.
pub const MIDDLE: Sizes = Sizes { patch_m: 0.002, frame_m: 0.001, cell_m: 0.002 };

/// What is diagnosed, and with which frames.
pub struct Work<'a> {
    /// Twin.
    pub twin: &'a SeenTwin,
    /// Recordings.
    pub runs: &'a [FrameRun],
    /// Their pixels.
    pub pixels: Pixels,
    /// All ways in which effects may act.
    pub trials: Vec<Trial>,
    /// What is always free: placements and positions.
    pub nuisance: Vec<Column>,
    /// What may be taken for granted.
    pub options: FrameOptions,
    /// Geometry that the twin is known to lack: readings of it are left out.
    pub lacks: Vec<Missing>,
}

/// A hypothesis, and the values of effects that it has.
#[derive(Clone, Debug)]
pub struct State {
    /// The hypothesis.
    pub hypothesis: Hypothesis,
    /// Values of parameters of effects in it.
    pub applied: Vec<(Parameter, f64)>,
}

/// A linear system about a state.
pub struct Linear {
    /// All samples.
    pub samples: Vec<PixelSample>,
    /// Cells in the order of the rows.
    pub cells: Vec<Cell>,
    /// The system: nuisance first, then the columns of all trials.
    pub system: System,
    /// Columns of each trial.
    pub of_trial: Vec<Vec<usize>>,
}

/// A set of trials with its solution.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// Trials.
    pub set: Vec<usize>,
    /// Logarithm of the evidence.
    pub evidence: f64,
    /// Solution: nuisance, then the trials' columns in order.
    pub solution: Solution,
}

impl<'a> Work<'a> {
    /// Prepares a diagnosis.
    #[must_use]
    pub fn new(twin: &'a SeenTwin, runs: &'a [FrameRun], options: &FrameOptions) -> Self {
        let mut nuisance = Vec::new();
        for r in 0..runs.len() {
            nuisance.extend((0..6).map(|k| column(Parameter::Root(r, k), ROOT[k / 3])));
            for j in free_joints(twin) {
                let i = usize::from(!twin.joints[j].hinge.turns());
                let told = runs[r].positions.contains_key(&twin.joints[j].name);
                nuisance.push(column(Parameter::Position(r, j), if told { TOLD[i] } else { STEP[i] }));
            }
        }
        for p in 1..twin.parts.len() {
            let turn = twin.parts[p].radius_m.max(0.01).recip();
            nuisance.extend((0..6).map(|k| twin_column(Parameter::Mesh(p, k), if k < 3 { 1.0 } else { turn })));
        }
        for j in free_joints(twin) {
            let turn = twin.parts[twin.joints[j].child].radius_m.max(0.01).recip();
            nuisance.extend((0..2).map(|k| twin_column(Parameter::AxisTurn(j, k), turn)));
            if twin.joints[j].hinge.turns() {
                nuisance.extend((0..2).map(|k| twin_column(Parameter::AxisShift(j, k), 1.0)));
            }
        }
        Self {
            twin,
            runs,
            pixels: Pixels::choose(runs),
            trials: effects::trials(twin, runs),
            nuisance,
            options: *options,
            lacks: Vec::new(),
        }
    }

    /// The same for another twin.
    #[must_use]
    pub fn of<'b>(&'b self, twin: &'b SeenTwin) -> Work<'b> {
        Work { lacks: self.lacks.clone(), ..Work::new(twin, self.runs, &self.options) }
    }

    /// Compares all runs with a hypothesis, without readings of what the twin is known to lack.
    #[must_use]
    pub fn compare(&self, hypothesis: &Hypothesis, gate_m: f64) -> Vec<PixelSample> {
        let mut samples = compare(self.twin, self.runs, &self.pixels, hypothesis, gate_m);
        if !self.lacks.is_empty() {
            let poses: Vec<_> = (0..self.runs.len()).map(|r| hypothesis.poses(self.twin, r).0).collect();
            samples.retain(|s| !self.lacks.iter().any(|m| m.covers(&poses[s.run], &s.sample.measured())));
        }
        samples
    }

    /// Whether a frame is left to the proof.
    #[must_use]
    pub fn is_held_out(&self, frame: usize) -> bool {
        let every = self.options.held_out_every;
        every > 0 && frame % every == every - 1
    }

    /// Linearizes about a state.
    #[must_use]
    pub fn linearize(&self, state: &State, gate_m: f64) -> Linear {
        let samples = self.compare(&state.hypothesis, gate_m);
        let stage = Stage::new(self.twin, self.runs, &state.hypothesis);
        let (cells, patches) = cells(self.twin, &stage.parts, &samples, |_, f| !self.is_held_out(f));
        let mut columns = self.nuisance.clone();
        let mut of_trial = Vec::new();
        for t in &self.trials {
            of_trial.push(
                t.columns
                    .iter()
                    .map(|c| {
                        columns.iter().position(|k| k == c).unwrap_or_else(|| {
                            columns.push(*c);
                            columns.len() - 1
                        })
                    })
                    .collect(),
            );
        }
        // What the state already explains counts as not explained.
        let with_residual = cells
            .into_iter()
            .map(|c| {
                let explained: f64 = state.applied.iter().map(|(p, x)| stage.derivative(*p, &c.seen) * x).sum();
                (c, c.residual_m + explained)
            })
            .collect();
        let (system, cells) = System::new(with_residual, patches, columns, self.twin.radius_m(), |p, c| stage.derivative(p, &c.seen));
        Linear { samples, cells, system, of_trial }
    }

    /// Columns of a set of trials behind the nuisance.
    #[must_use]
    pub fn subset(&self, linear: &Linear, set: &[usize]) -> Vec<usize> {
        (0..self.nuisance.len()).chain(set.iter().flat_map(|&t| linear.of_trial[t].iter().copied())).collect()
    }

    /// One step of a state with a set of trials free; all other effects go.
    pub fn step(&self, state: &mut State, set: &[usize], sizes: &Sizes, gate_m: f64) {
        let mut linear = self.linearize(state, gate_m);
        let subset = self.subset(&linear, set);
        for _ in 0..2 {
            let Some(solution) = linear.system.reduce(sizes).and_then(|r| r.solve(&subset)) else { return };
            let left = linear.system.left(&subset, &solution.values);
            linear.system.soften(&left);
        }
        if let Some(solution) = linear.system.reduce(sizes).and_then(|r| r.solve(&subset)) {
            self.apply(state, &linear, &subset, &solution.values);
        }
    }

    /// Moves a state to a solution.
    pub fn apply(&self, state: &mut State, linear: &Linear, subset: &[usize], values: &DVector<f64>) {
        let n = self.nuisance.len();
        let mut steps = Vec::new();
        for (&c, &x) in subset.iter().zip(values.iter()).take(n) {
            let parameter = linear.system.columns[c].parameter;
            let told = |r: usize, j: usize| self.runs[r].positions.contains_key(&self.twin.joints[j].name);
            let stays = match parameter {
                Parameter::Mesh(..) | Parameter::AxisTurn(..) | Parameter::AxisShift(..) => true,
                Parameter::Position(r, j) => told(r, j),
                _ => false,
            };
            if !stays {
                steps.push((parameter, x));
            }
        }
        let mut target: Vec<(Parameter, f64)> = Vec::new();
        for (&c, &x) in subset.iter().zip(values.iter()).skip(n) {
            target.push((linear.system.columns[c].parameter, x));
        }
        let of = |all: &[(Parameter, f64)], p: Parameter| all.iter().find(|a| a.0 == p).map_or(0.0, |a| a.1);
        for (p, x) in &target {
            steps.push((*p, x - of(&state.applied, *p)));
        }
        for (p, x) in state.applied.iter().filter(|a| !target.iter().any(|t| t.0 == a.0)) {
            steps.push((*p, -x));
        }
        advance(&mut state.hypothesis, self.twin, &steps);
        state.applied = target;
    }

    /// All sizes of the errors without names, eliminated.
    #[must_use]
    pub fn reduce_all(&self, linear: &mut Linear, around: &[usize]) -> Vec<Reduced> {
        // Outliers of the set known so far; without one, what an effect does would count as such.
        if around.len() > self.nuisance.len()
            && let Some(solution) = linear.system.reduce(&MIDDLE).and_then(|r| r.solve(around))
        {
            let left = linear.system.left(around, &solution.values);
            linear.system.soften(&left);
        }
        Sizes::grid(self.options.accuracy_m).par_iter().filter_map(|s| linear.system.reduce(s)).collect()
    }

    /// Evidence and solution of a set.
    #[must_use]
    pub fn judge(&self, linear: &Linear, reduced: &[Reduced], set: &[usize]) -> Option<Chosen> {
        let subset = self.subset(linear, set);
        let (evidence, i) = best(reduced, &subset);
        let evidence = evidence + self.log_odds(set);
        Some(Chosen { set: set.to_vec(), evidence, solution: reduced.get(i)?.solve(&subset)? })
    }

    /// Evidence of a set alone.
    #[must_use]
    pub fn evidence(&self, linear: &Linear, reduced: &[Reduced], set: &[usize]) -> f64 {
        best(reduced, &self.subset(linear, set)).0 + self.log_odds(set)
    }

    fn log_odds(&self, set: &[usize]) -> f64 {
        set.iter().map(|&t| self.trials[t].log_odds).sum()
    }
}
