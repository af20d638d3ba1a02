//! What one track shows: whether anything moved, the odds of its types, and the joint of each.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Vector3, Vector6};

use crate::{
    track::{
        bend::BendLikelihood,
        curve::{CIRCLE, LINE, PathCurve},
        fit::CurveFit,
        joint::TraceFault,
        spin::Spin,
        trace::PointTrack,
    },
    wander::clock,
};
use common::note::{Note, NoteCode};
use numeric::statistics::{SIGMAS_PER_MAD, median};

/// Fewest samples of a track.
/// derived: a circle has six parameters, its noise four.
const LEAST_SAMPLES: usize = 10;
/// Most samples of a fit; of longer tracks medians of groups are used.
/// chosen: errors are alike over a hundredth of a track, so more samples know little more.
const MOST_SAMPLES: usize = 100;
/// Distance from the curve, in the root mean square of all, beyond which a sample is an outlier.
/// chosen: no error of a normal distribution is so large.
const OUTLIER: f64 = 6.0;
/// Turn along the way, as a share of the hinge's, below which rotations do not follow it.
/// chosen: half way between a hinge and a slide.
const FOLLOWS: f64 = 0.5;
/// Least length of a motion, in deviations of what lies off its curve and of the jitter along it.
/// chosen: a thousand readings of a thing at rest span 6.6 deviations.
const MOVED: f64 = 10.0;
/// Second differences of white noise, in its deviations.
/// derived: the root of 1 + 4 + 1.
const SECOND_DIFFERENCE: f64 = 2.449_49;
/// Logarithm of odds that are very strong evidence; half of the scores' (`articulate::joints::joint_type`).
/// chosen: the limit of Kass and Raftery (1995), section 3.2.
pub const DECISIVE: f64 = 5.0;
/// Logarithm of the odds of a part that turns and goes nowhere: no slide does.
/// chosen: beyond any doubt.
const IN_PLACE: f64 = 100.0;

/// Curves fitted to a track.
#[derive(Clone, Debug)]
enum Path {
    /// The point moved.
    Along { line: Box<CurveFit>, circle: Box<CurveFit>, spin: Option<Spin> },
    /// The part turned about the point.
    InPlace { spins: CurveFit },
    /// Neither.
    Still,
}

/// What one track shows.
#[derive(Clone, Debug)]
pub struct Opening {
    /// All samples.
    pub whole: PointTrack,
    /// The samples of the fit, medians of groups.
    trace: PointTrack,
    path: Path,
    /// Logarithm of the odds of a revolute joint against a prismatic one; 0 where nothing moved.
    pub log_odds: f64,
    /// Doubts.
    pub notes: Vec<Note>,
}

/// The joint of a track of known type.
#[derive(Clone, Debug)]
pub struct OpeningJoint {
    /// Unit axis; positions grow from the first sample to the farthest.
    pub axis: Vector3<f64>,
    /// Point of the axis, meters; of a slide, a point of the track.
    pub point: Vector3<f64>,
    /// Covariance of axis and point.
    pub covariance: Matrix6<f64>,
    /// Radius of the path and its deviation, meters; `None` of a slide.
    pub radius_m: Option<[f64; 2]>,
    /// Where the tracked point is at position 0, meters.
    pub attachment: Vector3<f64>,
    /// Root mean square of what lies off the curve, meters; radians for a part that turned in place.
    pub rms: f64,
    /// Time of each sample that is no outlier, seconds, or its number where there are no stamps.
    pub at: Vec<f64>,
    /// Positions of these samples from the first one, radians or meters.
    pub positions: Vec<f64>,
    /// Standard deviations of the positions.
    pub deviations: Vec<f64>,
    /// Number of outliers.
    pub outliers: usize,
}

impl OpeningJoint {
    /// -1 where its axis points against a direction, else 1.
    #[must_use]
    pub fn sign_along(&self, direction: &Vector3<f64>) -> f64 {
        if self.axis.dot(direction) < 0.0 { -1.0 } else { 1.0 }
    }
}

impl Opening {
    /// What a track shows.
    ///
    /// # Errors
    /// [`TraceFault`] for too few samples, or for samples without any extent.
    pub fn of_trace(trace: &PointTrack) -> Result<Self, TraceFault> {
        let whole = trace.clone();
        let trace = trace.grouped(MOST_SAMPLES);
        if trace.position.len() < LEAST_SAMPLES {
            return Err(TraceFault::Short {
                name: trace.name,
                count: trace.position.len(),
                least: LEAST_SAMPLES,
            });
        }
        let circle = CurveFit::of_trace(&trace, true);
        let moved = circle.filter(|c| is_moved(c, &trace));
        let Some(circle) = moved else {
            return Ok(Self::without_way(whole, trace));
        };
        let line = CurveFit::of_trace(&trace, false);
        let Some(line) = line else { return Ok(Self::without_way(whole, trace)) };
        let mut notes = Vec::new();
        let by_positions = circle_evidence(&circle, None) - line.log_evidence();
        let turns = trace.spins();
        let spins = (!turns.is_empty()).then_some(&turns);
        let on_line = spins.and_then(|s| Spin::along(s, &line.along, &line.clock));
        let on_circle = spins.and_then(|s| Spin::along(s, &circle.along, &circle.clock));
        let (Some(on_line), Some(on_circle)) = (on_line, on_circle) else {
            let path = Path::Along { line: line.into(), circle: circle.into(), spin: None };
            return Ok(Self { whole, trace, path, log_odds: by_positions, notes });
        };
        // Errors of rotations grow with the angle of view: the slope is as wrong as it shows.
        let misfit = spin_misfit(&circle, &on_circle).min(on_line.misfit(&Vector3::zeros()));
        let on_line = on_line.widened(misfit);
        let on_circle = on_circle.widened(misfit);
        let both = circle_evidence(&circle, Some(&on_circle))
            - line.log_evidence()
            - on_line.log_likelihood(&Vector3::zeros());
        // A hand that turns about the handle keeps its rotation on a hinge.
        let hinge_spin = circle.curve.spin();
        let follows = on_circle.slope.dot(&hinge_spin) > FOLLOWS * hinge_spin.norm_squared();
        if by_positions.abs() > DECISIVE && (both > 0.0) != (by_positions > 0.0)
            || by_positions > DECISIVE && !follows
        {
            notes.push(Note::new(
                NoteCode::JointContradicted,
                format!(
                    "{}: the rotations do not follow the path, as where a gripper turns about the handle; \
                     positions alone are used",
                    trace.name
                ),
            ));
            let path = Path::Along { line: line.into(), circle: circle.into(), spin: None };
            return Ok(Self { whole, trace, path, log_odds: by_positions, notes });
        }
        let path = Path::Along { line: line.into(), circle: circle.into(), spin: Some(on_circle) };
        Ok(Self { whole, trace, path, log_odds: both, notes })
    }

    /// The opening of a point that went nowhere.
    fn without_way(whole: PointTrack, trace: PointTrack) -> Self {
        let turned = PointTrack { position: trace.spins(), rotation: Vec::new(), ..trace.clone() };
        let spins = (!turned.position.is_empty()).then(|| CurveFit::of_trace(&turned, false)).flatten();
        let (path, log_odds) = match spins.filter(|s| is_moved(s, &turned)) {
            Some(spins) => (Path::InPlace { spins }, IN_PLACE),
            None => (Path::Still, 0.0),
        };
        Self { whole, trace, path, log_odds, notes: Vec::new() }
    }

    /// Whether anything moved.
    #[must_use]
    pub fn moved(&self) -> bool {
        !matches!(self.path, Path::Still)
    }

    /// Length of the path, meters, and what lies off it; of one that did not move, its extent and jitter.
    #[must_use]
    pub fn extent_m(&self) -> f64 {
        let mean = self.trace.position.iter().sum::<Vector3<f64>>() / self.trace.position.len() as f64;
        let off = self.trace.position.iter().map(|p| (p - mean).norm());
        median(off.collect()).unwrap_or(0.0)
    }

    /// The hinge of the track; `None` where nothing moved.
    #[must_use]
    pub fn hinge(&self) -> Option<OpeningJoint> {
        match &self.path {
            Path::Still => None,
            Path::InPlace { spins } => Some(in_place(&self.whole, &self.trace, spins)),
            Path::Along { circle, spin, .. } => {
                let information = circle.information.clone();
                let (curve, covariance) = with_spin(&circle.curve, information, spin.as_ref())?;
                curve.axis_and_center()?;
                let values = |c: &PathCurve| hinge_values(c);
                Some(opening_joint([&self.whole, &self.trace], circle, &curve, &covariance, &values, true))
            }
        }
    }

    /// The slide of the track; `None` where nothing moved along.
    #[must_use]
    pub fn slide(&self) -> Option<OpeningJoint> {
        let Path::Along { line, .. } = &self.path else { return None };
        let covariance = line.information.clone().cholesky()?.inverse();
        let values = |c: &PathCurve| stacked(&c.tangent, &c.point, 0.0);
        Some(opening_joint([&self.whole, &self.trace], line, &line.curve, &covariance, &values, false))
    }
}

/// Whether a path is longer than noise makes it.
fn is_moved(fit: &CurveFit, trace: &PointTrack) -> bool {
    let [low, high] = fit.ends();
    let jumps = fit.along.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).abs() / SECOND_DIFFERENCE);
    let jitter = SIGMAS_PER_MAD * median(jumps.collect()).unwrap_or(0.0);
    high - low > MOVED * jitter.max(fit.rms_m(trace)).max(crate::track::fit::ROUNDING)
}

/// Log evidence of a circle, by positions and by rotations.
fn circle_evidence(circle: &CurveFit, spin: Option<&Spin>) -> f64 {
    let whole = &circle.information;
    let common = whole.view((0, 0), (LINE, LINE)).clone_owned();
    let mixed = whole.view((0, LINE), (LINE, CIRCLE - LINE)).clone_owned();
    let own = whole.view((LINE, LINE), (CIRCLE - LINE, CIRCLE - LINE)).clone_owned();
    let Some(factor) = common.cholesky() else { return f64::NEG_INFINITY };
    let schur = own - mixed.transpose() * factor.solve(&mixed);
    let of_positions = BendLikelihood {
        mean: circle.curve.bend,
        information: nalgebra::Matrix2::from_fn(|r, c| schur[(r, c)]),
        peak: circle.log_likelihood - 0.5 * factor.determinant().ln(),
    };
    match spin.and_then(|s| s.bend_likelihood(&circle.curve)) {
        Some(of_rotations) => of_positions.times(&of_rotations).log_evidence(),
        None => of_positions.log_evidence(),
    }
}

/// Slopes of the spin of a circle in its parameters.
fn spin_slopes(curve: &PathCurve) -> DMatrix<f64> {
    curve.slopes_of(CIRCLE, &|c| DVector::from_column_slice(c.spin().as_slice()))
}

/// Squared distance of the rotations' spin from the circle's, in deviations of both.
fn spin_misfit(circle: &CurveFit, spin: &Spin) -> f64 {
    let Some(covariance) = circle.information.clone().cholesky().map(|c| c.inverse()) else { return 0.0 };
    let slopes = spin_slopes(&circle.curve);
    let of_circle = &slopes * covariance * slopes.transpose();
    let both = Spin { covariance: spin.covariance + Matrix3::from_fn(|r, c| of_circle[(r, c)]), ..*spin };
    both.misfit(&circle.curve.spin())
}

/// The circle of positions moved by what rotations say, and the covariance of its parameters.
fn with_spin(
    curve: &PathCurve,
    information: DMatrix<f64>,
    spin: Option<&Spin>,
) -> Option<(PathCurve, DMatrix<f64>)> {
    let Some(spin) = spin else { return Some((*curve, information.cholesky()?.inverse())) };
    let inverse = spin.covariance.try_inverse()?;
    let inverse = DMatrix::from_column_slice(3, 3, inverse.as_slice());
    let slopes = spin_slopes(curve);
    let off = DVector::from_column_slice((spin.slope - curve.spin()).as_slice());
    let covariance = (information + slopes.transpose() * &inverse * &slopes).cholesky()?.inverse();
    let step = &covariance * slopes.transpose() * inverse * off;
    Some((curve.stepped(step.as_slice()), covariance))
}

fn stacked(axis: &Vector3<f64>, point: &Vector3<f64>, radius: f64) -> DVector<f64> {
    DVector::from_iterator(7, axis.iter().chain(point).copied().chain([radius]))
}

/// Rotation vectors of all samples from the middle rotation of the groups.
fn whole_spins(whole: &PointTrack, trace: &PointTrack) -> PointTrack {
    let from = |t: &PointTrack| t.rotation.get(t.rotation.len() / 2).copied().unwrap_or_default();
    let shift = geometry::log_so3(&(from(whole) * from(trace).inverse()));
    PointTrack { position: whole.spins().iter().map(|w| w + shift).collect(), ..whole.clone() }
}

/// Axis, center and radius of a circle.
fn hinge_values(curve: &PathCurve) -> DVector<f64> {
    let (axis, center) = curve.axis_and_center().unwrap_or((curve.tangent, curve.point));
    stacked(&axis, &center, 1.0 / curve.bend.norm())
}

/// The joint of a curve with the covariance of its parameters, from all samples and those of the fit.
fn opening_joint(
    [whole, trace]: [&PointTrack; 2],
    fit: &CurveFit,
    curve: &PathCurve,
    covariance: &DMatrix<f64>,
    values: &dyn Fn(&PathCurve) -> DVector<f64>,
    turns: bool,
) -> OpeningJoint {
    let rms = fit.rms_m(trace);
    let farthest = OUTLIER * rms.max(crate::track::fit::ROUNDING);
    let is_near = |p: &Vector3<f64>| curve.residual(p).0.norm() <= farthest;
    let inliers: Vec<usize> = (0..whole.position.len()).filter(|k| is_near(&whole.position[*k])).collect();
    let points: Vec<Vector3<f64>> = inliers.iter().map(|k| whole.position[*k]).collect();
    let lengths = |c: &PathCurve| -> DVector<f64> { positions_on(c, &points, turns) };
    let mut positions: Vec<f64> = lengths(curve).iter().copied().collect();
    let sign = sign_of(&positions);
    positions.iter_mut().for_each(|q| *q *= sign);
    let found = values(curve);
    let slopes = curve.slopes_of(covariance.nrows(), values);
    let joint = &slopes * covariance * slopes.transpose();
    let mut signs = Vector6::repeat(1.0);
    signs.fixed_rows_mut::<3>(0).fill(sign);
    let radius_m = turns.then(|| [found[6], joint[(6, 6)].sqrt()]);
    let scale = radius_m.map_or(1.0, |[radius, _]| radius);
    let slopes = curve.slopes_of(covariance.nrows(), &lengths);
    // What lies along the curve is taken to be like what lies across.
    let variance = 0.5 * fit.spread.trace() / (scale * scale);
    let clock = clock(&whole.shares_of_time(), &curve.residuals(&whole.position).1);
    let mut deviations = Vec::with_capacity(inliers.len());
    for (row, k) in inliers.iter().enumerate() {
        let slope = slopes.row(row);
        let apart = clock[*k] - clock[inliers[0]];
        // The first sample is position 0 by definition.
        let noise = if row == 0 { 0.0 } else { 2.0 * variance * (1.0 - fit.wander.correlation(apart)) };
        deviations.push(((slope * covariance * slope.transpose())[(0, 0)] + noise).sqrt());
    }
    let start = points.first().map_or(0.0, |p| curve.residual(p).1);
    OpeningJoint {
        axis: sign * Vector3::new(found[0], found[1], found[2]),
        point: Vector3::new(found[3], found[4], found[5]),
        covariance: Matrix6::from_fn(|r, c| signs[r] * signs[c] * joint[(r, c)]),
        radius_m,
        attachment: curve.from_point_at(start).point,
        rms,
        at: inliers.iter().map(|k| whole.time_s.get(*k).copied().unwrap_or(*k as f64)).collect(),
        deviations,
        positions,
        outliers: whole.position.len() - inliers.len(),
    }
}

/// Positions on a curve from the first of some points, meters or, where it turns, radians.
fn positions_on(curve: &PathCurve, points: &[Vector3<f64>], turns: bool) -> DVector<f64> {
    let scale = if turns { curve.bend.norm() } else { 1.0 };
    let along = curve.residuals(points).1;
    let first = along.first().copied().unwrap_or(0.0);
    DVector::from_iterator(along.len(), along.iter().map(|a| scale * (a - first)))
}

/// 1 or -1, so that the farthest position becomes positive.
fn sign_of(positions: &[f64]) -> f64 {
    let farthest = positions.iter().copied().fold(0.0, |m: f64, q| if q.abs() > m.abs() { q } else { m });
    if farthest < 0.0 { -1.0 } else { 1.0 }
}

/// The hinge of a part that turned about the tracked point: rotations about one axis lie on a line.
fn in_place(whole: &PointTrack, trace: &PointTrack, spins: &CurveFit) -> OpeningJoint {
    let inverse = spins.information.clone().cholesky().map(|c| c.inverse());
    let covariance = inverse.unwrap_or_else(|| DMatrix::identity(LINE, LINE));
    let turned = PointTrack { position: trace.spins(), ..trace.clone() };
    let all = whole_spins(whole, trace);
    let values = |c: &PathCurve| stacked(&c.tangent, &c.point, 0.0);
    let joint = opening_joint([&all, &turned], spins, &spins.curve, &covariance, &values, false);
    let count = trace.position.len() as f64;
    let mean = trace.position.iter().sum::<Vector3<f64>>() / count;
    let scatter: Matrix3<f64> = trace.position.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
    let mut whole = Matrix6::zeros();
    whole.fixed_view_mut::<3, 3>(0, 0).copy_from(&joint.covariance.fixed_view::<3, 3>(0, 0));
    // The axis may lie anywhere within the scatter of the point.
    whole.fixed_view_mut::<3, 3>(3, 3).copy_from(&(scatter / count));
    let radius_m = Some([0.0, (scatter.trace() / count).sqrt()]);
    OpeningJoint { point: mean, attachment: mean, covariance: whole, radius_m, ..joint }
}
