//! How probable the recorded efforts make the recorded motion under a twin, and the motion the efforts: two
//! linear regressions with proper priors, one for errors of the motion, one for errors of the efforts. See
//! docs/method.md 14.14.

use nalgebra::{SMatrix, SVector};

/// Known columns: the twin's inertia times the acceleration, the rest of its effort, the recorded effort.
const KNOWN: usize = 3;
/// Columns of possible missing effects: a constant, the velocity, its sign, the position, its sine and
/// cosine, and friction proportional to the effort, or to the twin's effort beside its inertia.
const MISSING: usize = 8;
/// The two friction columns among these: an erring signal must not explain itself.
const BY_EFFORT: usize = 6;
const BY_NEED: usize = 7;
/// The columns among these for another direction of the axis.
const TILTING: [usize; 3] = [0, 4, 5];
const COLUMNS: usize = KNOWN + MISSING;

/// Tried noise levels, from the size of the erring signal downwards; each is half the one before.
/// derived: down to 2^-13, the noise of a good encoder over a stretch.
const NOISES: i32 = 14;
/// Most further noise levels, where the erring signal has several possible sizes.
/// chosen: from a load to the inertia of a twin with lengths a thousand times too long.
const MOST_NOISES: f64 = 40.0;

/// A stretch of a joint's motion under a twin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SeenStretch {
    /// Position, rad or m.
    pub position: f64,
    /// Velocity, rad/s or m/s.
    pub velocity: f64,
    /// The twin's inertia times the acceleration, N m or N.
    pub inertial: f64,
    /// The twin's other efforts for this motion, N m or N: load, damping, friction, coupling from other
    /// joints.
    pub rest: f64,
    /// The twin's inertia: effort over acceleration, the latter in its recorded unit.
    pub inertia: f64,
}

/// Stretches and efforts of a joint, prepared for regression.
#[derive(Clone, Debug)]
pub struct Regression {
    gram: SMatrix<f64, COLUMNS, COLUMNS>,
    /// Number of independent measurements in the rows.
    weight: f64,
    /// Mean logarithm of the inertia.
    log_inertia: f64,
}

/// Result of a regression.
#[derive(Clone, Copy, Debug)]
pub struct Explained {
    /// Log evidence.
    pub evidence: f64,
    /// Factor of the explaining signal.
    pub factor: f64,
    /// Share of the squares left unexplained.
    pub left: f64,
}

/// The known columns after projecting out the possible missing effects, for one noise level.
struct Projected {
    /// Products of the projected columns, divided by the noise variance.
    products: SMatrix<f64, KNOWN, KNOWN>,
    /// Contribution of the noise and the priors to minus twice the log evidence.
    twice: f64,
}

/// Root mean square of `n` values, at least 1e-300.
fn rms(values: impl Iterator<Item = f64>, n: f64) -> f64 {
    (values.map(|x| x.powi(2)).sum::<f64>() / n).sqrt().max(1e-300)
}

/// The regression's row for each stretch.
fn regression_rows(seen: &[SeenStretch], effort: &[f64], turns: bool) -> Vec<SVector<f64, COLUMNS>> {
    let n = seen.len().max(1) as f64;
    let mean = seen.iter().map(|s| s.position).sum::<f64>() / n;
    let speed = rms(seen.iter().map(|s| s.velocity), n);
    let travel = rms(seen.iter().map(|s| s.position - mean), n);
    let need = rms(seen.iter().map(|s| s.rest), n);
    let size = rms(effort.iter().copied(), n);
    let mut rows = Vec::with_capacity(seen.len());
    for (s, u) in seen.iter().zip(effort) {
        let (sine, cosine) = if turns { s.position.sin_cos() } else { (0.0, 0.0) };
        let v = s.velocity / speed;
        let q = (s.position - mean) / travel;
        let sign = s.velocity.signum();
        let by_effort = u.abs() / size * sign;
        let by_need = s.rest.abs() / need * sign;
        rows.push(SVector::from([s.inertial, s.rest, *u, 1.0, v, sign, q, sine, cosine, by_effort, by_need]));
    }
    rows
}

/// Share of independent stretches, from the correlation of the unexplained efforts of successive stretches.
/// The efforts are explained by the known columns and the possible missing effects. `follows` is true for
/// each stretch directly after the one before it.
pub fn independent_share(seen: &[SeenStretch], effort: &[f64], turns: bool, follows: &[bool]) -> f64 {
    let rows = regression_rows(seen, effort, turns);
    let scale = rows.iter().fold(SVector::<f64, COLUMNS>::zeros(), |sum, r| sum + r.component_mul(r));
    let scale = scale.map(|x| if x > 0.0 { 1.0 / x.sqrt() } else { 0.0 });
    let mut normal = SMatrix::<f64, COLUMNS, COLUMNS>::identity() * RIDGE;
    let mut right = SVector::<f64, COLUMNS>::zeros();
    for (r, own) in rows.iter().map(|r| without_effort(r, &scale)) {
        normal += r * r.transpose();
        right += r * own;
    }
    let Some(found) = normal.cholesky().map(|c| c.solve(&right)) else { return 0.0 };
    let scaled = rows.iter().map(|r| without_effort(r, &scale));
    let error: Vec<f64> = scaled.map(|(r, own)| own - r.dot(&found)).collect();
    let square: f64 = error.iter().map(|e| e * e).sum();
    let pairs = error.windows(2).zip(&follows[1.min(follows.len())..]).filter(|(_, f)| **f);
    let mut product = 0.0;
    let mut count = 0.0;
    for (pair, _) in pairs {
        product += pair[0] * pair[1];
        count += 1.0;
    }
    if !(square > 0.0) || count == 0.0 {
        return 0.0;
    }
    let alike = (product / count) / (square / error.len() as f64);
    effective_share(alike)
}

/// Share of samples that counts as independent, by the correlation of neighbors: the effective sample size of
/// a first-order autoregressive process.
pub fn effective_share(correlation: f64) -> f64 {
    ((1.0 - correlation) / (1.0 + correlation)).clamp(0.0, 1.0)
}

/// A scaled row with the effort's columns set to zero, and the effort, to be explained by the row.
fn without_effort(
    row: &SVector<f64, COLUMNS>,
    scale: &SVector<f64, COLUMNS>,
) -> (SVector<f64, COLUMNS>, f64) {
    let mut row = row.component_mul(scale);
    let effort = std::mem::take(&mut row[2]);
    row[KNOWN + BY_EFFORT] = 0.0;
    (row, effort)
}

/// Ridge for regressions with columns of unit length.
/// chosen: rounding error, for columns of zeros.
const RIDGE: f64 = 1e-12;

/// The combination of the known columns giving the recorded effort.
fn effort_alone() -> SVector<f64, KNOWN> {
    SVector::<f64, KNOWN>::new(0.0, 0.0, 1.0)
}

impl Regression {
    /// Sums rows and their efforts; `turns` where sine and cosine of the position are meaningful. `weight` is
    /// the number of independent measurements in the rows.
    pub fn of_rows(seen: &[SeenStretch], effort: &[f64], turns: bool, weight: f64) -> Self {
        let n = seen.len().max(1) as f64;
        let gram = regression_rows(seen, effort, turns)
            .iter()
            .fold(SMatrix::zeros(), |sum, r| sum + r * r.transpose());
        let log_inertia = seen.iter().map(|s| s.inertia.abs().max(1e-300).ln()).sum::<f64>() / n;
        Self { gram: gram * (weight / n), weight, log_inertia }
    }

    /// Root mean square of a known column.
    fn column_rms(&self, column: usize) -> f64 {
        (self.gram[(column, column)] / self.weight).sqrt()
    }

    /// Number of independent measurements in the rows.
    pub fn weight(&self) -> f64 {
        self.weight
    }

    /// Whether there are enough data with both an effort and a motion.
    pub fn is_telling(&self) -> bool {
        self.weight > 2.0 * COLUMNS as f64 && self.column_rms(0) > 0.0 && self.column_rms(2) > 0.0
    }

    /// Explanations of the accelerations by the efforts, in recorded units: one for each of the tried
    /// inertias, with a gain within one range.
    pub fn of_motion(&self, inertias: &[f64], gain: (f64, f64)) -> Vec<Explained> {
        // A priori, missing efforts are as large as the acting effort, and those of a tilt as the load.
        let effort = (gain.0 * gain.1).sqrt() * self.column_rms(2);
        // One grid of noise levels for all inertias saves work.
        let sizes = inertias.iter().map(|i| self.needed_effort(*i));
        let range = sizes.fold((f64::INFINITY, 0.0), |r: (f64, f64), s| (r.0.min(s), r.1.max(s)));
        let projected = self.projected_columns(effort, self.column_rms(1), BY_NEED, range.0, range.1);
        let mut all = Vec::with_capacity(inertias.len());
        for inertia in inertias {
            let needed = SVector::<f64, KNOWN>::new(*inertia, 1.0, 0.0);
            let mut best = self.best_explanation(&projected, &needed, &effort_alone(), gain.0, gain.1);
            best.evidence += self.weight * (inertia.ln() + self.log_inertia);
            all.push(best);
        }
        all
    }

    /// Explanations of the efforts by the motion.
    pub fn of_effort(&self, inertias: &[f64], gain: (f64, f64)) -> Vec<Explained> {
        let by = 1.0 / (gain.0 * gain.1).sqrt();
        let size = self.column_rms(2);
        let projected = self.projected_columns(size, by * self.column_rms(1), BY_EFFORT, size, size);
        let mut all = Vec::with_capacity(inertias.len());
        for inertia in inertias {
            let needed = SVector::<f64, KNOWN>::new(*inertia, 1.0, 0.0);
            all.push(self.best_explanation(&projected, &effort_alone(), &needed, 1.0 / gain.1, 1.0 / gain.0));
        }
        all
    }

    /// Root mean square effort needed by the twin with a given inertia factor.
    fn needed_effort(&self, inertia: f64) -> f64 {
        let needed = SVector::<f64, KNOWN>::new(inertia, 1.0, 0.0);
        let known = self.gram.fixed_view::<KNOWN, KNOWN>(0, 0);
        ((needed.transpose() * known * needed)[0] / self.weight).max(0.0).sqrt()
    }

    /// The known columns after projecting out the missing effects, for each noise level. `effort` and `load`
    /// are prior deviations; `unused` is the column to leave out; `least` and `most` are the smallest and
    /// largest size of the erring signal.
    fn projected_columns(
        &self,
        effort: f64,
        load: f64,
        unused: usize,
        least: f64,
        most: f64,
    ) -> Vec<Projected> {
        let mut sd = SVector::<f64, MISSING>::repeat(effort);
        sd[unused] = 0.0;
        TILTING.into_iter().for_each(|i| sd[i] += load);
        let deviation = SMatrix::<f64, MISSING, MISSING>::from_diagonal(&sd);
        let known = self.gram.fixed_view::<KNOWN, KNOWN>(0, 0);
        let missing = self.gram.fixed_view::<MISSING, MISSING>(KNOWN, KNOWN);
        let across = self.gram.fixed_view::<MISSING, KNOWN>(KNOWN, 0);
        let more = (most / least.max(1e-300)).log2().clamp(0.0, MOST_NOISES) as i32;
        let mut all = Vec::new();
        for i in 0..NOISES + more {
            let variance = (most * f64::from(-i).exp2()).powi(2).max(1e-300);
            let whole = SMatrix::identity() + deviation * missing * deviation / variance;
            let Some(cholesky) = whole.cholesky() else { continue };
            let right = deviation * across / variance;
            let products = known / variance - right.transpose() * cholesky.solve(&right);
            let log_determinant = 2.0 * (0..MISSING).map(|k| cholesky.l_dirty()[(k, k)].ln()).sum::<f64>();
            all.push(Projected { products, twice: self.weight * variance.ln() + log_determinant });
        }
        all
    }

    /// The best explanation over the noise levels: `left` as a multiple of `right`, the factor within a
    /// range, by Laplace's approximation. The prior of the factor is flat in its logarithm.
    fn best_explanation(
        &self,
        all: &[Projected],
        left: &SVector<f64, KNOWN>,
        right: &SVector<f64, KNOWN>,
        low: f64,
        high: f64,
    ) -> Explained {
        let mut best = Explained { evidence: f64::NEG_INFINITY, factor: 1.0, left: 1.0 };
        for one in all {
            let of = |a: &SVector<f64, KNOWN>, b: &SVector<f64, KNOWN>| (a.transpose() * one.products * b)[0];
            let square = of(left, left);
            let across = of(left, right);
            let own = of(right, right).max(1e-300);
            let factor = (across / own).clamp(low, high);
            let error = square - 2.0 * factor * across + factor * factor * own;
            // The share of the prior range occupied by the posterior.
            let share = (std::f64::consts::TAU / own).sqrt() / (factor * (high / low).ln());
            let evidence = -0.5 * (one.twice + error) + share.min(1.0).ln();
            if evidence > best.evidence {
                best = Explained { evidence, factor, left: error.max(0.0) / square.max(1e-300) };
            }
        }
        best
    }
}
