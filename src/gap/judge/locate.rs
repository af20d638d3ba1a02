//! Locates disagreement of a model with the measured motion: the variable the residual effort depends on, and
//! its region. See docs/method.md 14.10.

use rand_core::Rng;

use crate::{fit::problem::Problem, judge::screen::Screen};

/// Share of the top speed below which the sign of a velocity is noise.
/// chosen: only a small part of a motion is this slow.
pub(super) const STILL: f64 = 0.01;

/// A variable the residual effort may depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Variable {
    /// Position, in both directions of motion.
    Position,
    /// Position while it increases.
    PositionRising,
    /// Position while it decreases.
    PositionFalling,
    /// Velocity.
    Velocity,
    /// Sign of the velocity.
    Direction,
    /// Measured effort.
    Effort,
    /// Acceleration of the model.
    Acceleration,
    /// Time within a run.
    Time,
}

impl Variable {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Position,
        Self::PositionRising,
        Self::PositionFalling,
        Self::Velocity,
        Self::Direction,
        Self::Effort,
        Self::Acceleration,
        Self::Time,
    ];

    /// Name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::PositionRising => "position, rising",
            Self::PositionFalling => "position, falling",
            Self::Velocity => "velocity",
            Self::Direction => "direction",
            Self::Effort => "effort",
            Self::Acceleration => "acceleration",
            Self::Time => "time",
        }
    }

    /// Unit of the variable, for a turning or a sliding joint.
    #[must_use]
    pub fn unit(self, turns: bool) -> &'static str {
        match (self, turns) {
            (Self::Position | Self::PositionRising | Self::PositionFalling, true) => "rad",
            (Self::Position | Self::PositionRising | Self::PositionFalling, false) => "m",
            (Self::Velocity, true) => "rad/s",
            (Self::Velocity, false) => "m/s",
            (Self::Direction, _) => "1",
            (Self::Effort, true) => "N m",
            (Self::Effort, false) => "N",
            (Self::Acceleration, true) => "rad/s^2",
            (Self::Acceleration, false) => "m/s^2",
            (Self::Time, _) => "s",
        }
    }

    fn bin_count(self) -> usize {
        match self {
            Self::Direction => 2,
            Self::Position | Self::Velocity => 20,
            Self::Time => 30,
            _ => 14,
        }
    }
}

/// A bin of a variable and the mean residual effort in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bin {
    /// Edges.
    pub edges: (f64, f64),
    /// Residual effort estimated from this bin alone, N m or N.
    pub effort: f64,
    /// This effort in units of its standard error.
    pub sigmas: f64,
}

/// Dependence of the residual effort on one variable.
#[derive(Clone, Debug)]
pub struct Dependence {
    /// Variable.
    pub variable: Variable,
    /// Twice the log likelihood gained by a table of the residual over the variable.
    pub gain: f64,
    /// Number of bins with data.
    pub bins: Vec<Bin>,
    /// p value: share of sign-flipped residuals with at least this gain.
    pub p: f64,
    /// q value: p after control of the false discovery rate over all variables.
    pub q: f64,
    /// Interval around the strongest bin where the residual has the same sign and at least half its
    /// significance.
    pub region: (f64, f64),
}

/// Number of sign flips in a permutation test.
const FLIPS: usize = 999;

/// Tests every variable; the strongest dependence comes first.
#[must_use]
pub fn dependences_by_strength(problem: &Problem, screen: &Screen, rng: &mut impl Rng) -> Vec<Dependence> {
    let mut found: Vec<Dependence> =
        Variable::ALL.iter().filter_map(|v| tested_dependence(problem, screen, *v, rng)).collect();
    // Benjamini-Hochberg: docs/method.md (14.17).
    let mut order: Vec<usize> = (0..found.len()).collect();
    order.sort_by(|&a, &b| found[a].p.total_cmp(&found[b].p));
    let mut least = 1.0f64;
    for (rank, &i) in order.iter().enumerate().rev() {
        least = least.min(found[i].p * found.len() as f64 / (rank + 1) as f64);
        found[i].q = least;
    }
    // By chance a table gains one per bin; subtracting two per bin makes tables of different sizes
    // comparable.
    let strength = |d: &Dependence| d.gain - 2.0 * d.bins.len() as f64;
    found.sort_by(|a, b| strength(b).total_cmp(&strength(a)));
    found
}

/// Value of a variable at a sample; `None` where it does not apply.
fn variable_at_sample(
    screen: &Screen,
    problem: &Problem,
    variable: Variable,
    log: usize,
    k: usize,
) -> Option<f64> {
    let m = &screen.middle_states()[log];
    let still = STILL * problem.coverage.speed.1;
    let q = m.position[k];
    let v = m.velocity[k];
    match variable {
        Variable::Position => Some(q),
        Variable::PositionRising => (v > still).then_some(q),
        Variable::PositionFalling => (v < -still).then_some(q),
        Variable::Velocity => Some(v),
        Variable::Direction => (v.abs() > still).then_some(v.signum()),
        Variable::Effort => Some(m.effort[k]),
        Variable::Acceleration => Some(m.acceleration[k]),
        Variable::Time => Some(problem.logs[log].time_s[k]),
    }
}

/// Edges of the bins: equal widths for positions, equal counts for the others.
fn bin_edges_of(screen: &Screen, problem: &Problem, variable: Variable) -> Vec<f64> {
    let n = variable.bin_count();
    let logs = problem.logs.iter().enumerate();
    let mut values: Vec<f64> = logs
        .flat_map(|(i, l)| {
            (0..l.time_s.len()).filter_map(move |k| variable_at_sample(screen, problem, variable, i, k))
        })
        .collect();
    values.sort_by(f64::total_cmp);
    let (Some(&low), Some(&high)) = (values.first(), values.last()) else { return Vec::new() };
    let share = |i: usize| i as f64 / n as f64;
    let mut edges: Vec<f64> = match variable {
        // derived: half a unit beyond the two signs.
        Variable::Direction => vec![-1.5, 0.0, 1.5],
        Variable::Velocity | Variable::Effort | Variable::Acceleration => {
            (0..=n).map(|i| values[((values.len() - 1) as f64 * share(i)) as usize]).collect()
        }
        _ => (0..=n).map(|i| low + (high - low) * share(i)).collect(),
    };
    // A variable constant over many samples has equal quantiles there.
    edges.dedup_by(|a, b| *a - *b <= 1e-12);
    if let Some(last) = edges.last_mut() {
        // The highest value belongs to the last bin.
        *last += 1e-9 * (high - low).abs() + 1e-12;
    }
    edges
}

fn tested_dependence(
    problem: &Problem,
    screen: &Screen,
    variable: Variable,
    rng: &mut impl Rng,
) -> Option<Dependence> {
    let edges = bin_edges_of(screen, problem, variable);
    let runs = if variable == Variable::Time { problem.logs.len() } else { 1 };
    let per_run = (edges.len().saturating_sub(1)).min(30 / runs.min(30)).max(1);
    // Time bins of all runs are placed in sequence; with many runs there are fewer bins per run.
    let edges: Vec<f64> = if runs > 1 {
        let low = edges[0];
        let high = edges[edges.len() - 1];
        (0..=per_run).map(|i| low + (high - low) * i as f64 / per_run as f64).collect()
    } else {
        edges
    };
    let count = edges.len().checked_sub(1).filter(|c| *c > 0)?;
    let columns = (count * runs).min(30);
    let score = screen.score_columns(columns, |_, span, filled| {
        let first = if runs > 1 { count * span.log } else { 0 };
        for i in 0..span.len - 1 {
            let Some(x) = variable_at_sample(screen, problem, variable, span.log, span.start + i) else {
                continue;
            };
            // The last bin starting at or below the value.
            let bin = edges.partition_point(|e| *e <= x);
            if bin > 0 && bin < edges.len() && first + bin - 1 < columns {
                filled.effort[first + bin - 1][i] = 1.0;
                filled.active[first + bin - 1] = true;
            }
        }
    })?;
    let flipped = (0..FLIPS).filter(|_| flipped_gain(&score, rng) >= score.gain).count();
    // The recorded signs count as one of the draws, so p is never 0 and the test keeps its level.
    let p = (flipped + 1) as f64 / (FLIPS + 1) as f64;
    let bins: Vec<Bin> = (0..columns)
        .map(|c| {
            let z: f64 = score.products.iter().map(|w| w[c]).sum();
            let effort = if z == 0.0 { 0.0 } else { score.single[c] / z };
            Bin {
                edges: (edges[c % count], edges[c % count + 1]),
                effort,
                sigmas: score.single[c].sqrt().copysign(z),
            }
        })
        .collect();
    let peak = (0..columns).max_by(|&a, &b| bins[a].sigmas.abs().total_cmp(&bins[b].sigmas.abs()))?;
    let strength = 0.5 * bins[peak].sigmas.abs();
    let sign = bins[peak].sigmas.signum();
    // A region in time ends with its run.
    let is_alike = |c: &usize| bins[*c].sigmas * sign >= strength && c / count == peak / count;
    let low = (0..=peak).rev().take_while(is_alike).last().unwrap_or(peak);
    let high = (peak..columns).take_while(is_alike).last().unwrap_or(peak);
    let region = (bins[low].edges.0, bins[high].edges.1);
    Some(Dependence { variable, gain: score.gain, bins, p, q: p, region })
}

/// Gain of the same columns with randomly flipped signs of the windows' residuals.
fn flipped_gain(score: &crate::judge::screen::Score, rng: &mut impl Rng) -> f64 {
    let n = score.inverse.nrows();
    let mut z = nalgebra::DVector::zeros(n);
    let mut bits = 0u64;
    for (w, window) in score.products.iter().enumerate() {
        if w % 64 == 0 {
            bits = rng.next_u64();
        }
        // Whole windows are flipped, as samples within one have correlated errors; without a further effect
        // either sign is equally likely.
        let sign = if bits >> (w % 64) & 1 == 1 { 1.0 } else { -1.0 };
        for (sum, x) in z.iter_mut().zip(window) {
            *sum += sign * x;
        }
    }
    z.dot(&(&score.inverse * &z))
}
