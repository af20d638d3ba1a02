//! The effects found, as laws (effort over their variable), and the twin's missing efforts from the motion;
//! for plots.

use std::collections::BTreeMap;

use crate::{
    fit::problem::Problem,
    judge::{
        locate::{STILL, Variable},
        observed::{Observed, observed_moments},
        spread::Spread,
        verdict::Diagnosis,
    },
    model::{
        effect::{At, Effect, Place, RUN_SPACING_S, Response},
        joint_model::{JointModel, Term},
    },
};
use numeric::statistics::HALF_WIDTH_95;

/// Number of points of a curve.
const GRID: usize = 160;
/// Number of bins over a range.
const BINS: usize = 24;
/// Fewest samples of a bin.
const LEAST_SAMPLES: usize = 12;
/// Fewest windows of a bin: its error is derived from their scatter.
const LEAST_WINDOWS: usize = 3;
/// Share of the samples left outside the bins at each end of a range: few, and the fastest.
/// chosen: a thousandth, three standard deviations.
const OUTLYING: f64 = 0.001;
/// A push is plotted for this many of its durations on either side.
/// chosen: the push has ended after five.
const PUSH_SHOWN: f64 = 8.0;

/// Direction of motion a law applies to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Way {
    /// Both directions.
    Both,
    /// Increasing position.
    Rising,
    /// Decreasing position.
    Falling,
}

impl Way {
    fn sign_of_motion(self) -> f64 {
        if self == Self::Falling { -1.0 } else { 1.0 }
    }
}

/// The effects depending on one variable.
#[derive(Clone, Debug)]
pub struct Law {
    /// The variable.
    pub variable: Variable,
    /// Names of the effects; empty where nothing was found.
    pub effects: Vec<String>,
    /// Curves of the sum of their efforts.
    pub curves: Vec<Curve>,
    /// The twin's missing efforts, minus the effects of other variables.
    pub points: Vec<Point>,
}

/// A law, or its branch for one direction.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Direction of motion.
    pub way: Way,
    /// Values of the variable.
    pub x: Vec<f64>,
    /// Effort, N m or N.
    pub effort: Vec<f64>,
    /// Half width of its 95 % interval, N m or N.
    pub half: Vec<f64>,
}

/// Mean of the missing efforts in a bin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Direction of motion.
    pub way: Way,
    /// Whether it is from held-out runs.
    pub is_held_out: bool,
    /// Value of the variable.
    pub x: f64,
    /// Effort, N m or N.
    pub effort: f64,
    /// Half width of its 95 % interval, from the scatter of windows.
    pub half: f64,
}

/// Laws of the findings, or of the nearest effects. Without either, the twin's missing efforts over velocity,
/// position and the variable with the strongest dependence.
#[must_use]
pub fn laws_of_diagnosis(fitted: &Problem, held_out: &Problem, diagnosis: &Diagnosis) -> Vec<Law> {
    let model = diagnosis.nearest.as_ref().map_or(&diagnosis.model, |n| &n.model);
    let seen = [observed_moments(fitted, model), observed_moments(held_out, model)];
    let all: Vec<&Observed> = seen.iter().flatten().collect();
    if all.is_empty() {
        return Vec::new();
    }
    let mut by_variable: BTreeMap<(Variable, i64), Vec<(usize, &Term)>> = BTreeMap::new();
    for (at, term) in model.placed_terms() {
        let effect = fitted.catalogue[term.effect].as_ref();
        if let Some(variable) = variable_of(effect, term, &all) {
            // Pushes of different runs have no common axis.
            let run = if variable == Variable::Time { run_of(term) } else { 0 };
            by_variable.entry((variable, run)).or_default().push((at, term));
        }
    }
    if by_variable.is_empty() {
        let strongest = diagnosis.before.first().map_or(Variable::Velocity, |d| axis_of(d.variable));
        for variable in [strongest, Variable::Velocity, Variable::Position] {
            by_variable.insert((variable, 0), Vec::new());
        }
    }
    let mut laws = Vec::with_capacity(by_variable.len());
    for ((variable, run), terms) in by_variable {
        let sum = VariableTerms { problem: fitted, model, terms, variable, run, middle: middle_state(&all) };
        laws.push(sum.law_of_terms(&seen, diagnosis.spread.as_ref()));
    }
    laws
}

/// The plotted axis of a dependence.
#[must_use]
fn axis_of(variable: Variable) -> Variable {
    match variable {
        Variable::PositionRising | Variable::PositionFalling => Variable::Position,
        Variable::Direction => Variable::Velocity,
        other => other,
    }
}

/// The variable an effect's effort depends on; `None` if it is not an effort.
fn variable_of(effect: &dyn Effect, term: &Term, seen: &[&Observed]) -> Option<Variable> {
    match effect.place() {
        Place::Effort if effect.is_of_one_run() => Some(Variable::Time),
        Place::Effort if effect.is_of_velocity() => Some(Variable::Velocity),
        Place::Effort | Place::Contact => Some(Variable::Position),
        Place::Friction if depends_on(effect, term, seen, |r| r.u) => Some(Variable::Effort),
        Place::Friction if depends_on(effect, term, seen, |r| r.q) => Some(Variable::Position),
        Place::Friction => Some(Variable::Velocity),
        Place::Inertia => Some(Variable::Acceleration),
        Place::Gain => Some(Variable::Effort),
        Place::Delay | Place::Bias | Place::Scale | Place::Play => None,
    }
}

/// Whether a derivative of an effect is nonzero at any moment.
fn depends_on(
    effect: &dyn Effect,
    term: &Term,
    seen: &[&Observed],
    derivative: fn(&Response) -> f64,
) -> bool {
    seen.iter().any(|o| {
        let mut r = Response::default();
        effect.write_response(&o.effect_state(), &term.p, &mut r);
        derivative(&r) != 0.0
    })
}

fn run_of(push: &Term) -> i64 {
    (push.p[1] / RUN_SPACING_S).round() as i64
}

/// Mean position of the joint and of the others, used while the law's variable is varied.
fn middle_state(seen: &[&Observed]) -> (f64, [f64; 8]) {
    let n = seen.len() as f64;
    let mean = |of: &dyn Fn(&Observed) -> f64| seen.iter().map(|o| of(o)).sum::<f64>() / n;
    (mean(&|o| o.q), std::array::from_fn(|i| mean(&|o| o.others[i])))
}

/// The terms depending on one variable.
struct VariableTerms<'a> {
    problem: &'a Problem<'a>,
    model: &'a JointModel,
    terms: Vec<(usize, &'a Term)>,
    variable: Variable,
    /// Run of the push, for the variable time.
    run: i64,
    middle: (f64, [f64; 8]),
}

impl VariableTerms<'_> {
    fn law_of_terms(&self, seen: &[Vec<Observed>; 2], spread: Option<&Spread>) -> Law {
        let names = self.terms.iter().map(|(_, t)| self.problem.catalogue[t.effect].name().to_owned());
        let mut law =
            Law { variable: self.variable, effects: names.collect(), curves: vec![], points: vec![] };
        let mut x: Vec<f64> =
            seen.iter().flatten().filter(|o| self.is_shown(o)).map(|o| self.sorted_by(o)).collect();
        x.sort_by(f64::total_cmp);
        let cut = (OUTLYING * x.len() as f64) as usize;
        let (Some(&low), Some(&high)) = (x.get(cut), x.get(x.len().saturating_sub(1 + cut))) else {
            return law;
        };
        let edges = self.bin_edges(low, high);
        for way in self.shown_ways() {
            for (is_held_out, seen) in [(false, &seen[0]), (true, &seen[1])] {
                // A push occurred in a fitted run only.
                if !(is_held_out && self.variable == Variable::Time && !self.terms.is_empty()) {
                    law.points.extend(self.mean_points(way, is_held_out, seen, &edges));
                }
            }
        }
        // A law is plotted where data were seen, and one bin beyond.
        let bin = (high - low) / BINS as f64;
        let ends = law.points.iter().map(|p| p.x).fold((high, low), |(l, h), x| (l.min(x), h.max(x)));
        let low = low.max(ends.0 - bin);
        let high = high.min(ends.1 + bin);
        if !self.terms.is_empty() && high > low {
            let curves =
                self.shown_ways().into_iter().flat_map(|way| self.law_curves(way, low, high, spread));
            law.curves = curves.collect();
        }
        law
    }

    /// Friction depends on the direction of motion: over any variable but the velocity the law has two
    /// branches.
    fn shown_ways(&self) -> Vec<Way> {
        let mut effects = self.terms.iter().map(|(_, t)| &self.problem.catalogue[t.effect]);
        let rubs = effects.any(|effect| effect.place() == Place::Friction);
        let bare = self.terms.is_empty() && self.variable == Variable::Position;
        if self.variable != Variable::Velocity && (bare || rubs) {
            vec![Way::Rising, Way::Falling]
        } else {
            vec![Way::Both]
        }
    }

    /// Whether a sample shows the twin's missing effort: at rest static friction balances any effort.
    fn is_shown(&self, o: &Observed) -> bool {
        let slow = STILL * self.problem.coverage.speed.1;
        let rests = o.v.abs() <= slow
            && (self.variable == Variable::Velocity
                || self.shown_ways().len() > 1
                || self.model.has_friction(self.problem.catalogue));
        let push = self.terms.first().filter(|_| self.variable == Variable::Time);
        let is_beside = push.is_some_and(|(_, t)| {
            o.log as i64 != self.run || (o.t - t.p[1]).abs() > PUSH_SHOWN * t.p[2].max(0.0)
        });
        !rests && !is_beside
    }

    fn variable_value(&self, o: &Observed) -> f64 {
        match self.variable {
            Variable::Velocity | Variable::Direction => o.v,
            Variable::Effort => o.u,
            Variable::Acceleration => o.a,
            Variable::Time => o.t - RUN_SPACING_S * o.log as f64,
            Variable::Position | Variable::PositionRising | Variable::PositionFalling => o.q,
        }
    }

    /// Value by which samples are sorted into bins. The error of an acceleration correlates with that of the
    /// effort over it; sorting by it would select large errors.
    fn sorted_by(&self, o: &Observed) -> f64 {
        if self.variable == Variable::Acceleration { o.about } else { self.variable_value(o) }
    }

    /// Edges of the bins; no bin spans zero velocity.
    fn bin_edges(&self, low: f64, high: f64) -> Vec<f64> {
        if self.variable == Variable::Velocity && low < 0.0 && high > 0.0 {
            let below = ((BINS as f64 * -low / (high - low)).round() as usize).clamp(2, BINS - 2);
            let mut edges = even_values(low, 0.0, below);
            edges.extend(&even_values(0.0, high, BINS - below)[1..]);
            return edges;
        }
        even_values(low, high, BINS)
    }

    fn law_curves(&self, way: Way, low: f64, high: f64, spread: Option<&Spread>) -> Vec<Curve> {
        let pieces = if self.variable != Variable::Velocity {
            vec![(way, even_values(low, high, GRID))]
        } else {
            let sides = [(Way::Falling, finer_near(0.0, low)), (Way::Rising, finer_near(0.0, high))];
            sides.into_iter().filter(|(w, x)| w.sign_of_motion() * x[GRID] > 0.0).collect()
        };
        let mut curves = Vec::with_capacity(pieces.len());
        for (side, x) in pieces {
            let mut effort = Vec::new();
            let mut half = Vec::new();
            for &x in &x {
                let (value, gradient) = self.value_and_gradient(x, side);
                effort.push(value);
                half.push(spread.map_or(0.0, |s| s.half_width(0, &gradient)));
            }
            curves.push(Curve { way, x, effort, half });
        }
        curves
    }

    /// Value of the law, and its gradient with respect to all free parameters.
    fn value_and_gradient(&self, x: f64, way: Way) -> (f64, Vec<f64>) {
        let mut gradient = vec![0.0; self.model.free_count()];
        let (q, others) = &self.middle;
        let mut at = At { q: *q, others, direction: way.sign_of_motion(), ..At::default() };
        match self.variable {
            Variable::Velocity | Variable::Direction => at.v = x,
            Variable::Effort => at.u = x,
            Variable::Acceleration => {}
            Variable::Time => at.t = RUN_SPACING_S * self.run as f64 + x,
            Variable::Position | Variable::PositionRising | Variable::PositionFalling => at.q = x,
        }
        let mut sum = 0.0;
        for (first, term) in &self.terms {
            let effect = self.problem.catalogue[term.effect].as_ref();
            let mut r = Response::default();
            let factor = match effect.place() {
                Place::Inertia => {
                    (r.value, r.p[0]) = (-term.p[0] * x, -x);
                    1.0
                }
                Place::Gain => {
                    (r.value, r.p[0]) = ((term.p[0] - 1.0) * x, x);
                    1.0
                }
                place => {
                    effect.write_response(&at, &term.p, &mut r);
                    if place == Place::Friction { -way.sign_of_motion() } else { 1.0 }
                }
            };
            sum += factor * r.value;
            for i in 0..term.p.len() {
                gradient[first + i] = factor * r.p[i];
            }
        }
        (sum, gradient)
    }

    fn mean_points(&self, way: Way, is_held_out: bool, seen: &[Observed], edges: &[f64]) -> Vec<Point> {
        let mut bins: Vec<BinSums> = vec![BinSums::new(); edges.len() - 1];
        for o in seen.iter().filter(|o| self.is_shown(o)) {
            let own = if o.v < 0.0 { Way::Falling } else { Way::Rising };
            let x = self.variable_value(o);
            let bin = edges.partition_point(|e| *e <= self.sorted_by(o));
            if (way != Way::Both && way != own) || bin == 0 || bin >= edges.len() {
                continue;
            }
            // Subtract the efforts of other effects; without any the rest is the twin's missing effort.
            let effort = o.lacking - o.found + self.value_and_gradient(x, own).0;
            let sums = bins[bin - 1].entry(o.window).or_default();
            sums.iter_mut().zip([1.0, x, effort]).for_each(|(s, x)| *s += x);
        }
        bins.iter().filter_map(|windows| self.mean_point(way, is_held_out, windows)).collect()
    }

    /// The mean of a bin; `None` if it has too few samples or windows.
    fn mean_point(&self, way: Way, is_held_out: bool, windows: &BinSums) -> Option<Point> {
        let total = windows.values().fold([0.0; 3], |t, w| [t[0] + w[0], t[1] + w[1], t[2] + w[2]]);
        let [count, x, effort] = total;
        // Around a push there are few samples, all of one window.
        let is_push = self.variable == Variable::Time;
        if count < 1.0 || !is_push && (count < LEAST_SAMPLES as f64 || windows.len() < LEAST_WINDOWS) {
            return None;
        }
        let mean = effort / count;
        // Samples of a window have correlated errors, so the scatter of windows is used.
        let n = windows.len() as f64;
        let squares: f64 = windows.values().map(|w| (w[2] - mean * w[0]).powi(2)).sum();
        let half = if n > 1.0 { HALF_WIDTH_95 * (squares * n / (n - 1.0)).sqrt() / count } else { 0.0 };
        Some(Point { way, is_held_out, x: x / count, effort: mean, half })
    }
}

/// Sums in a bin, for each window: count, variable, effort.
type BinSums = BTreeMap<usize, [f64; 3]>;

/// `n + 1` equally spaced values over a range.
fn even_values(from: f64, to: f64, n: usize) -> Vec<f64> {
    (0..=n).map(|i| from + (to - from) * i as f64 / n as f64).collect()
}

/// Values over a range, more closely spaced near its first end.
fn finer_near(from: f64, to: f64) -> Vec<f64> {
    (0..=GRID).map(|i| from + (to - from) * (i as f64 / GRID as f64).powi(3)).collect()
}
