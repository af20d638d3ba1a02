//! Probability of recorded motion given recorded efforts under a twin, and of the efforts given the motion:
//! two linear regressions with proper priors, one for an error in each of the two. See docs/method.md 14.14.

use nalgebra::{SMatrix, SVector};

/// Known columns: the twin's inertia times the acceleration, the rest of its effort, the recorded effort.
const KNOWN: usize = 3;
/// Possible missing effects: a constant, velocity, its sign, position, sine and cosine of it, and a friction
/// by the effort, or by the twin's effort beside its inertia.
const MISSING: usize = 8;
/// Of these, friction by the effort and by the twin's need: an erring signal cannot explain itself.
const BY_EFFORT: usize = 6;
const BY_NEED: usize = 7;
/// Of these, the columns of another axis.
const TILTING: [usize; 3] = [0, 4, 5];
const COLUMNS: usize = KNOWN + MISSING;

/// Tried noises, as shares of the size of the erring signal: each half the one before.
/// derived: from as large as it to 2^-13, the noise of a good encoder over a stretch.
const NOISES: i32 = 14;
/// Most further noises, for an erring signal of several sizes.
/// chosen: from a load to the inertia of a twin with lengths a thousand times too long.
const MOST_NOISES: f64 = 40.0;

/// A stretch of motion of a joint under a twin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SeenStretch {
    /// Position, rad or m.
    pub position: f64,
    /// Velocity.
    pub velocity: f64,
    /// The twin's inertia times the acceleration, N m or N.
    pub inertial: f64,
    /// Other efforts of the twin for the motion, N m or N: load, damping, friction, efforts by other joints.
    pub rest: f64,
    /// The twin's inertia: the effort by the acceleration in its recorded unit.
    pub inertia: f64,
}

/// Stretches and efforts of a joint, ready to be regressed.
#[derive(Clone, Debug)]
pub struct Regression {
    gram: SMatrix<f64, COLUMNS, COLUMNS>,
    /// Independent numbers in the rows.
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
    /// Remaining share of the squares.
    pub left: f64,
}

/// The known columns without possible missing effects, under one noise.
struct Projected {
    /// Products of the remaining columns, by the variance of the noise.
    products: SMatrix<f64, KNOWN, KNOWN>,
    /// Share of the noise and the priors in minus twice the log evidence.
    twice: f64,
}

/// Root mean square of `n` values, above zero.
fn rms(values: impl Iterator<Item = f64>, n: f64) -> f64 {
    (values.map(|x| x.powi(2)).sum::<f64>() / n).sqrt().max(1e-300)
}

/// Columns of each stretch.
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

/// Share of independent stretches, by the correlation of the unexplained efforts from one stretch to the
/// next; known and possible missing efforts explain the rest. `follows` is true for each stretch right behind
/// the one before it.
#[must_use]
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
    // Of a first-order process.
    ((1.0 - alike) / (1.0 + alike)).clamp(0.0, 1.0)
}

/// A scaled row with zeros in the columns of the effort, and its effort: the explained column.
fn without_effort(
    row: &SVector<f64, COLUMNS>,
    scale: &SVector<f64, COLUMNS>,
) -> (SVector<f64, COLUMNS>, f64) {
    let mut row = row.component_mul(scale);
    let effort = std::mem::take(&mut row[2]);
    row[KNOWN + BY_EFFORT] = 0.0;
    (row, effort)
}

/// Ridge of a regression of columns of unit length.
/// chosen: rounding, for columns of zeros.
const RIDGE: f64 = 1e-12;

/// The recorded effort among the known columns.
fn effort_alone() -> SVector<f64, KNOWN> {
    SVector::<f64, KNOWN>::new(0.0, 0.0, 1.0)
}

impl Regression {
    /// Of rows with their efforts; `turns` where sine and cosine of the position mean something. `weight` is
    /// the number of independent numbers in them.
    #[must_use]
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

    /// Independent numbers in the rows.
    #[must_use]
    pub fn weight(&self) -> f64 {
        self.weight
    }

    /// Whether there are an effort and a motion to compare.
    #[must_use]
    pub fn is_telling(&self) -> bool {
        self.weight > 2.0 * COLUMNS as f64 && self.column_rms(0) > 0.0 && self.column_rms(2) > 0.0
    }

    /// Explanations of the accelerations by the efforts, in their recorded units. Each of the inertias is
    /// tried; gains are those of one range.
    #[must_use]
    pub fn of_motion(&self, inertias: &[f64], gain: (f64, f64)) -> Vec<Explained> {
        // Missing efforts are as large as the acting effort, and a tilt as the load.
        let effort = (gain.0 * gain.1).sqrt() * self.column_rms(2);
        // One grid of noises for all inertias, to share the work.
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
    #[must_use]
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

    /// Size of the twin's effort with an inertia.
    fn needed_effort(&self, inertia: f64) -> f64 {
        let needed = SVector::<f64, KNOWN>::new(inertia, 1.0, 0.0);
        let known = self.gram.fixed_view::<KNOWN, KNOWN>(0, 0);
        ((needed.transpose() * known * needed)[0] / self.weight).max(0.0).sqrt()
    }

    /// The known columns without the columns of missing effects, one entry for each noise. `effort` and
    /// `load` are prior deviations; `unused` is a column to leave out; `least` and `most` are the sizes of
    /// the erring signal.
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

    /// The best of the noises: `left` explained by a multiple of `right` in a range, by Laplace's
    /// approximation. The multiples are each as likely as any other on a logarithmic scale.
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
            // Of the range the posterior holds this share.
            let share = (std::f64::consts::TAU / own).sqrt() / (factor * (high / low).ln());
            let evidence = -0.5 * (one.twice + error) + share.min(1.0).ln();
            if evidence > best.evidence {
                best = Explained { evidence, factor, left: error.max(0.0) / square.max(1e-300) };
            }
        }
        best
    }
}
