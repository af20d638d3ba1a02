//! The effort that answers an imposed motion: inverse dynamics.
//!
//! Where a hand or a robot pulls slowly, it imposes the motion, and the effort is what friction and springs
//! answer; the accelerations say nothing of it. Then p(effort | motion) is the likelihood: a regression of
//! the efforts on what the effects would need, under noise that wanders. See docs/method.md 14.17.

use nalgebra::{DMatrix, DVector};

use super::{
    evidence::effective_share,
    problem::MIN_EFFORT_NOISE,
    stretch::{Moved, mean_signal, one_way_stretches},
};
use crate::{
    model::{
        effect::{At, Place, Response},
        joint_model::{Catalogue, Term},
        plant::Plant,
    },
    record::{
        drive::Hold,
        jitter::reading_noise,
        log::{JointLog, rms},
        motion::SmoothMotion,
        off_axis::MAX_LEFT,
        reading_noise::ReadingNoise,
    },
    wander::{Gate, Wander},
};

/// Most moments of a regression; of longer logs every second, third ... one is used.
/// chosen: a slow pull holds no more that is independent.
const MOST_MOMENTS: usize = 1000;
/// Places at which an arbitrary effort of position is known, where the question is what acceleration adds.
/// chosen: as narrow as the effects that doors have.
const PLACES: usize = 12;
/// Distance of two runs on the clock, in lengths of the longest run.
/// chosen: nothing that wanders is remembered so long.
const RUN_DISTANCE: f64 = 1e6;
/// Rounds of the fixed point for the noise's size.
/// chosen: it converges by a digit a round.
const ROUNDS: usize = 8;

/// A stretch of one-way motion with its mean effort.
#[derive(Clone, Copy, Debug)]
struct PulledMoment {
    position: f64,
    velocity: f64,
    acceleration: f64,
    effort: f64,
}

/// A joint's motion and the efforts that were measured with it.
pub struct ImposedMotion<'c> {
    catalogue: &'c Catalogue,
    plant: Plant,
    moments: Vec<PulledMoment>,
    /// Time of each moment, in lengths of the longest run.
    clock: Vec<f64>,
    /// Root mean square effort, N m or N.
    pub effort_rms: f64,
}

/// What remains of an effort: its correlation and its size.
#[derive(Clone, Copy, Debug)]
pub struct EffortRemainder {
    /// Correlation in time.
    pub wander: Wander,
    /// Standard deviation, N m or N.
    pub deviation: f64,
}

impl EffortRemainder {
    /// Standard deviation of the white part, N m or N.
    #[must_use]
    pub fn white_deviation(&self) -> f64 {
        self.deviation * self.wander.white.sqrt()
    }
}

/// Efforts explained by columns.
#[derive(Clone, Debug)]
pub struct Explanation {
    /// Log evidence: amplitudes integrated out, noise at its most likely.
    pub log_evidence: f64,
    /// Amplitudes of the columns.
    pub amplitudes: Vec<f64>,
    /// What remains.
    pub remainder: EffortRemainder,
}

impl<'c> ImposedMotion<'c> {
    /// Motion and efforts of the logs of one joint. `None` where commands, a chain or other joints act with
    /// the efforts, or nothing moves.
    #[must_use]
    pub fn of_logs(catalogue: &'c Catalogue, plant: &Plant, logs: &[JointLog], hold: Hold) -> Option<Self> {
        let is_alone = |l: &JointLog| l.commanded.is_empty() && l.others.is_empty() && l.carried.is_empty();
        if logs.is_empty() || !logs.iter().all(is_alone) || plant.actuator.is_found[0] {
            return None;
        }
        let noise = reading_noise(logs);
        let runs: Vec<_> = logs.iter().map(|log| vec![Some(moved_log(log, &noise))]).collect();
        let stretches = one_way_stretches(&runs, 0);
        let longest = logs.iter().map(JointLog::duration_s).fold(0.0, f64::max);
        let mut moments = Vec::new();
        let mut clock = Vec::new();
        for (run, log) in logs.iter().enumerate() {
            let own: Vec<_> = stretches.iter().filter(|s| s.key.0 == run).collect();
            let efforts = mean_signal(log, &log.effort, &own, hold, 0.0);
            for (s, effort) in own.iter().zip(efforts) {
                let Some(effort) = effort.filter(|u| u.is_finite()) else { continue };
                let [position, velocity, acceleration] = [s.position[0], s.velocity[0], s.acceleration[0]];
                moments.push(PulledMoment { position, velocity, acceleration, effort });
                clock.push(RUN_DISTANCE * run as f64 + s.time_s.0 / longest);
            }
        }
        let every = moments.len().div_ceil(MOST_MOMENTS).max(1);
        let moments: Vec<PulledMoment> = moments.into_iter().step_by(every).collect();
        let clock: Vec<f64> = clock.into_iter().step_by(every).collect();
        let effort_rms = rms(&moments.iter().map(|m| m.effort).collect::<Vec<f64>>());
        (moments.len() > 2 * PLACES && effort_rms > 0.0).then_some(Self {
            catalogue,
            plant: plant.clone(),
            moments,
            clock,
            effort_rms,
        })
    }

    /// Number of moments.
    #[must_use]
    pub fn moment_count(&self) -> usize {
        self.moments.len()
    }

    /// Efforts less what the twin needs for the motion, N m or N.
    #[must_use]
    pub fn unexplained_efforts(&self) -> Vec<f64> {
        self.moments.iter().map(|m| m.effort - self.needed_by_twin(m)).collect()
    }

    fn needed_by_twin(&self, moment: &PulledMoment) -> f64 {
        let plant = &self.plant;
        plant.inertia * moment.acceleration
            + plant.damping * moment.velocity
            + plant.friction * moment.velocity.signum()
            + plant.load_at(None, moment.position).0
    }

    /// Whether something imposes the motion: the twin's inertia needs little of the effort, and the efforts
    /// do not show it, whatever the law of position and velocity.
    #[must_use]
    pub fn is_imposed(&self) -> bool {
        let inertial: Vec<f64> = self.moments.iter().map(|m| self.plant.inertia * m.acceleration).collect();
        let is_small = rms(&inertial) <= MAX_LEFT * self.effort_rms;
        if !is_small {
            return false;
        }
        let target: Vec<f64> =
            self.unexplained_efforts().iter().zip(&inertial).map(|(left, own)| left + own).collect();
        let mut columns = self.arbitrary_law();
        let without = self.explanation(&target, &columns).log_evidence;
        columns.push(inertial);
        self.explanation(&target, &columns).log_evidence <= without
    }

    /// Share of the moments that is independent. What an arbitrary law leaves is smoother than noise that
    /// wanders, and its innovations correlate.
    #[must_use]
    pub fn independent_share(&self) -> f64 {
        let columns = self.arbitrary_law();
        let mut left = self.unexplained_efforts();
        let explained = self.explanation(&left, &columns);
        for (column, amplitude) in columns.iter().zip(&explained.amplitudes) {
            left.iter_mut().zip(column).for_each(|(left, x)| *left -= amplitude * x);
        }
        let rows = DMatrix::from_row_slice(1, left.len(), &left);
        let whitened = explained.remainder.wander.whitened(&self.clock, &rows, &Gate::open()).rows;
        let n = whitened.ncols();
        let product = whitened.columns(0, n - 1).dot(&whitened.columns(1, n - 1));
        effective_share(product / whitened.norm_squared().max(f64::MIN_POSITIVE))
    }

    /// Columns of an arbitrary law of position, velocity and its sign.
    fn arbitrary_law(&self) -> Vec<Vec<f64>> {
        let positions = self.moments.iter().map(|m| m.position);
        let low = positions.clone().fold(f64::INFINITY, f64::min);
        let high = positions.fold(f64::NEG_INFINITY, f64::max);
        let width = (high - low) / (PLACES - 1) as f64;
        let over_moments = |value: &dyn Fn(&PulledMoment) -> f64| self.moments.iter().map(value).collect();
        let mut columns: Vec<Vec<f64>> = vec![
            over_moments(&|_| 1.0),
            over_moments(&|m| m.velocity.signum()),
            over_moments(&|m| m.velocity),
            over_moments(&|m| m.velocity * m.velocity.abs()),
        ];
        for place in 0..PLACES {
            let center = low + width * place as f64;
            columns.push(over_moments(&|m| (-((m.position - center) / width).powi(2)).exp()));
        }
        columns
    }

    /// Whether the effort of an effect follows from the motion alone and is linear in its amplitudes.
    #[must_use]
    pub fn is_law_of_motion(&self, effect: usize) -> bool {
        let own = &self.catalogue[effect];
        let acts = matches!(own.place(), Place::Effort | Place::Friction) && !own.is_of_one_run();
        // A friction by the measured effort would explain the effort by itself.
        let p: Vec<f64> = own.parameters().iter().map(|p| p.neutral.map_or(1.0, |n| n + 1.0)).collect();
        acts && self.moments.iter().all(|m| self.response(effect, &p, m).u == 0.0)
    }

    fn response(&self, effect: usize, p: &[f64], moment: &PulledMoment) -> Response {
        let at = At {
            q: moment.position,
            v: moment.velocity,
            u: moment.effort,
            direction: moment.velocity.signum(),
            ..At::default()
        };
        let mut response = Response::default();
        self.catalogue[effect].write_response(&at, p, &mut response);
        response
    }

    /// Effort that a term needs at each moment, and its derivatives by all of the term's parameters.
    #[must_use]
    pub fn needed_by(&self, term: &Term) -> (Vec<f64>, Vec<Vec<f64>>) {
        let is_friction = self.catalogue[term.effect].place() == Place::Friction;
        let mut needed = Vec::with_capacity(self.moments.len());
        let mut slopes = vec![Vec::with_capacity(self.moments.len()); term.p.len()];
        for m in &self.moments {
            let response = self.response(term.effect, &term.p, m);
            // What pulls has to hold an effort back, and to overcome a friction.
            let sign = if is_friction { m.velocity.signum() } else { -1.0 };
            needed.push(sign * response.value);
            for (slope, p) in slopes.iter_mut().zip(response.p) {
                slope.push(sign * p);
            }
        }
        (needed, slopes)
    }

    /// Efforts explained by columns under the noise that makes them most likely. A priori each column is as
    /// large as the effort. See docs/method.md (14.22).
    #[must_use]
    pub fn explanation(&self, target: &[f64], columns: &[Vec<f64>]) -> Explanation {
        let sizes: Vec<f64> = columns.iter().map(|c| rms(c).max(f64::MIN_POSITIVE)).collect();
        let n = target.len();
        let rows = DMatrix::from_fn(1 + columns.len(), n, |row, k| match row {
            0 => target[k],
            _ => columns[row - 1][k] / sizes[row - 1],
        });
        let explained = Wander::all().map(|wander| self.explanation_under(wander, &rows));
        let best = explained.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence));
        let mut best = best.unwrap_or_else(|| self.explanation_under(WHITE, &rows));
        best.amplitudes.iter_mut().zip(sizes).for_each(|(amplitude, size)| *amplitude /= size);
        best
    }

    fn explanation_under(&self, wander: Wander, rows: &DMatrix<f64>) -> Explanation {
        let whitened = wander.whitened(&self.clock, rows, &Gate::open());
        let n = rows.ncols() as f64;
        let count = rows.nrows() - 1;
        let gram = &whitened.rows * whitened.rows.transpose();
        let square = gram[(0, 0)];
        let across = gram.view((1, 0), (count, 1)).into_owned();
        let own = gram.view((1, 1), (count, count)).into_owned();
        let prior = DMatrix::identity(count, count) / self.effort_rms.powi(2);
        let least = (MIN_EFFORT_NOISE * self.effort_rms).powi(2);
        let mut variance = (square / n).max(least);
        let mut amplitudes = DVector::zeros(count);
        let mut left = square;
        let mut log_volume = 0.0;
        for _ in 0..ROUNDS {
            let Some(posterior) = (&own / variance + &prior).cholesky() else { break };
            amplitudes = posterior.solve(&(&across / variance)).column(0).into_owned();
            left = square - 2.0 * across.column(0).dot(&amplitudes) + amplitudes.dot(&(&own * &amplitudes));
            log_volume = posterior.ln_determinant() + 2.0 * count as f64 * self.effort_rms.ln();
            variance = (left / n).max(least);
        }
        let misfit = left / variance + amplitudes.norm_squared() / self.effort_rms.powi(2);
        let log_density = n * (std::f64::consts::TAU * variance).ln() + whitened.log_det;
        Explanation {
            log_evidence: -0.5 * (log_density + misfit + log_volume),
            amplitudes: amplitudes.iter().copied().collect(),
            remainder: EffortRemainder { wander, deviation: variance.sqrt() },
        }
    }

    /// Log likelihood of efforts as what remains.
    #[must_use]
    pub fn log_likelihood(&self, efforts: &[f64], remainder: &EffortRemainder) -> f64 {
        let rows = DMatrix::from_row_slice(1, efforts.len(), efforts);
        let whitened = remainder.wander.whitened(&self.clock, &rows, &Gate::open());
        let variance = remainder.deviation.powi(2);
        let n = efforts.len() as f64;
        let log_density = n * (std::f64::consts::TAU * variance).ln() + whitened.log_det;
        -0.5 * (log_density + whitened.rows.norm_squared() / variance)
    }

    /// Covariance of parameters by the derivatives of the efforts, under what remains. `None` where the
    /// motion does not separate them.
    #[must_use]
    pub fn covariance(&self, slopes: &[Vec<f64>], remainder: &EffortRemainder) -> Option<DMatrix<f64>> {
        let rows = DMatrix::from_fn(slopes.len(), self.moments.len(), |row, k| slopes[row][k]);
        let whitened = remainder.wander.whitened(&self.clock, &rows, &Gate::open());
        let information = &whitened.rows * whitened.rows.transpose() / remainder.deviation.powi(2);
        information.cholesky().map(|c| c.inverse())
    }
}

/// A log with its smoothed motion.
fn moved_log(log: &JointLog, noise: &ReadingNoise) -> Moved {
    let motion = SmoothMotion::of_positions(&log.time_s, &log.position, noise, &[]);
    Moved { log: Some(log.clone()), motion }
}

/// No wandering part.
const WHITE: Wander = Wander { length: 1.0, white: 1.0 };
