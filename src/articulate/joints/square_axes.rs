//! Common directions of the axes of one object: most mechanisms are built square. See docs/method.md (8.14).
//!
//! Hinges and slides are mostly parallel or perpendicular to each other and to the flat faces of the body. A
//! frame of three orthogonal directions is fitted to all axes, each with its covariance, and to the faces, by
//! the likelihood of a mixture: some directions lie along one of the frame's within a manufacturing
//! tolerance, some of them are tilted by degrees, and the rest are arbitrary. The frame from the other axes
//! is a prior of each axis, if it makes the axis likelier. The prior hardly moves an axis known better than
//! the tolerance; it moves an axis that a small motion or a narrow part leaves open.

use std::f64::consts::TAU;

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Matrix3x2, Unit, UnitQuaternion, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::joints::joint_motion::frame_across;

/// How square objects are assumed to be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SquareConfig {
    /// Share of the axes parallel or perpendicular to the others; 0 leaves every axis as its motion alone
    /// gives it.
    pub share: f64,
}

impl Default for SquareConfig {
    fn default() -> Self {
        Self { share: 0.8 }
    }
}

/// A direction without a sign, and how well it is known.
#[derive(Clone, Copy, Debug)]
pub struct SeenDirection {
    /// Unit direction.
    pub direction: Unit<Vector3<f64>>,
    /// Covariance, square radians.
    pub covariance: Matrix3<f64>,
}

/// Standard deviation of the angle of a square axis from square, degrees.
///
/// chosen: 2 mm across the width of a door, as furniture and devices are made
const TOLERANCE_DEG: f64 = 0.3;
/// Share of axes tilted on purpose or by error among the square ones: these are not drawn to square.
///
/// tuned: random objects (artitwin synth --skew)
const TILTED: f64 = 0.2;
/// Standard deviation of the angle of a tilted axis from square, degrees.
///
/// tuned: random objects (artitwin synth --skew)
const TILT_DEG: f64 = 2.0;
const ITERATIONS: usize = 20;
/// A direction whose cosine to all of the frame's is below this is unrelated to it.
///
/// derived: 45 degrees, half way between two directions of the frame
const LEAST_COSINE: f64 = 0.7;

/// A direction seen from the frame.
struct View {
    /// The frame's direction nearest to it, and two vectors perpendicular to that.
    along: Vector3<f64>,
    across: Matrix3x2<f64>,
    /// Offset from there, and its negative slope by a left rotation of the frame.
    offset: Vector2<f64>,
    slope: Matrix2x3<f64>,
    precision: Matrix2<f64>,
    likelihood: Likelihood,
}

impl View {
    fn new(frame: &Matrix3<f64>, seen: &SeenDirection, config: &SquareConfig) -> Option<Self> {
        let views = (0..3).filter_map(|k| Self::relative_to(frame.column(k).into_owned(), seen, config));
        // The likeliest, not the nearest: a direction may be known well in one plane and badly in the other.
        views.reduce(|a, b| if b.likelihood.square > a.likelihood.square { b } else { a })
    }

    /// The direction relative to one of the frame's; `None` where they are too far apart.
    fn relative_to(column: Vector3<f64>, seen: &SeenDirection, config: &SquareConfig) -> Option<Self> {
        // An axis has no sign.
        let along = if column.dot(&seen.direction) < 0.0 { -column } else { column };
        if along.dot(&seen.direction) < LEAST_COSINE {
            return None;
        }
        let (a, b) = frame_across(&Unit::new_unchecked(along));
        let across = Matrix3x2::from_columns(&[a, b]);
        let offset = across.transpose() * seen.direction.into_inner();
        let own = across.transpose() * seen.covariance * across;
        let precision = (own + square_deg(TOLERANCE_DEG)).try_inverse()?;
        let likelihood = Likelihood::new(&offset, &own, config)?;
        let slope = -across.transpose() * along.cross_matrix();
        Some(Self { along, across, offset, slope, precision, likelihood })
    }

    /// Information and gradient for the frame's rotation.
    fn rotation_information(&self) -> (Matrix3<f64>, Vector3<f64>) {
        // The expectation step: how likely the direction is a square one.
        let weight = 1.0 / (1.0 + (self.likelihood.other - self.likelihood.square).exp());
        let weighed = self.slope.transpose() * self.precision * weight;
        (weighed * self.slope, weighed * self.offset)
    }

    /// The prior of this direction from the information of the others; `None` where it is likelier to be
    /// arbitrary.
    fn prior_by_others(
        &self,
        others: impl Iterator<Item = (Matrix3<f64>, Vector3<f64>)>,
        seen: &SeenDirection,
        config: &SquareConfig,
    ) -> Option<SeenDirection> {
        // From the others alone: an axis must not confirm itself.
        let (h, g) = summed_information(others);
        let turn = h.try_inverse()?;
        let mean = self.slope * turn * g;
        let frame = self.slope * turn * self.slope.transpose();
        let own = self.across.transpose() * seen.covariance * self.across;
        let likelihood = Likelihood::new(&(self.offset - mean), &(frame + own), config)?;
        let spread = frame + square_deg(TOLERANCE_DEG);
        let direction = Unit::new_normalize(self.along + self.across * mean);
        let covariance = self.across * spread * self.across.transpose();
        (likelihood.square > likelihood.other).then_some(SeenDirection { direction, covariance })
    }
}

/// Logarithms of the probability density, per steradian, of a direction as a square one and as any other.
struct Likelihood {
    square: f64,
    other: f64,
}

impl Likelihood {
    /// For a direction `offset` from one of the frame's, with its covariance without the tolerance.
    fn new(offset: &Vector2<f64>, covariance: &Matrix2<f64>, config: &SquareConfig) -> Option<Self> {
        let [tilted, square] =
            [(config.share * TILTED, TILT_DEG), (config.share * (1.0 - TILTED), TOLERANCE_DEG)]
                .map(|(share, std_deg)| component_log_density(offset, covariance, share, std_deg));
        // Tilted axes count with the arbitrary ones: they must not be drawn to square.
        Some(Self { square: square?, other: log_sum(tilted?, any_log_density(config)) })
    }
}

/// Logarithm of the density of a component of docs/method.md (8.14) at one of the frame's three directions,
/// each with a third of the component's share.
fn component_log_density(
    offset: &Vector2<f64>,
    covariance: &Matrix2<f64>,
    share: f64,
    std_deg: f64,
) -> Option<f64> {
    let information = (covariance + square_deg(std_deg)).try_inverse()?;
    let density = (share / 3.0).ln() - 0.5 * offset.dot(&(information * offset))
        + 0.5 * information.determinant().ln()
        - TAU.ln();
    Some(density)
}

/// The isotropic 2 x 2 covariance, square radians, for a standard deviation in degrees.
fn square_deg(std_deg: f64) -> Matrix2<f64> {
    Matrix2::identity() * std_deg.to_radians().powi(2)
}

/// Logarithm of the density of an arbitrary direction without a sign.
fn any_log_density(config: &SquareConfig) -> f64 {
    (1.0 - config.share).ln() - TAU.ln()
}

fn log_sum(a: f64, b: f64) -> f64 {
    a.max(b) + (-(a - b).abs()).exp().ln_1p()
}

/// The prior of each axis from the other axes and the faces; `None` where the axis is likelier to be
/// arbitrary, or is not known at all.
pub(crate) fn square_priors(
    axes: &[Option<SeenDirection>],
    faces: &[SeenDirection],
    config: &SquareConfig,
) -> Vec<Option<SeenDirection>> {
    let known: Vec<SeenDirection> = axes.iter().flatten().chain(faces).copied().collect();
    let Some(frame) = (config.share > 0.0).then(|| fitted_frame(&known, config)).flatten() else {
        return vec![None; axes.len()];
    };
    let views: Vec<Option<View>> = known.iter().map(|seen| View::new(&frame, seen, config)).collect();
    let information: Vec<_> = views.iter().map(|v| v.as_ref().map(View::rotation_information)).collect();
    let mut priors = Vec::with_capacity(axes.len());
    // Only known axes have a view; the views of the faces follow them.
    let mut own = 0;
    for axis in axes {
        let Some(seen) = axis else {
            priors.push(None);
            continue;
        };
        let others = information.iter().enumerate().filter(|(k, _)| *k != own).filter_map(|(_, t)| *t);
        priors.push(views[own].as_ref().and_then(|view| view.prior_by_others(others, seen, config)));
        own += 1;
    }
    priors
}

/// Information and gradient of all directions for the frame's rotation. Even without any, the rotation to the
/// nearest of the 24 equivalent frames is known to about a radian.
fn summed_information(
    all: impl Iterator<Item = (Matrix3<f64>, Vector3<f64>)>,
) -> (Matrix3<f64>, Vector3<f64>) {
    all.fold((Matrix3::identity(), Vector3::zeros()), |(h, g), (i, r)| (h + i, g + r))
}

/// The likeliest frame; its columns are the directions.
fn fitted_frame(known: &[SeenDirection], config: &SquareConfig) -> Option<Matrix3<f64>> {
    // The likelihood has a peak for each way to align the frame with the directions: every pair of them
    // starts one fit.
    let starts =
        known.iter().flat_map(|a| known.iter().filter_map(|b| start_frame(&a.direction, &b.direction)));
    let fits = starts.map(|start| polished_frame(start, known, config));
    let valued = fits.map(|frame| (log_likelihood(&frame, known, config), frame));
    valued.reduce(|a, b| if b.0 > a.0 { b } else { a }).map(|(_, frame)| frame)
}

/// Log likelihood of a frame given all directions.
fn log_likelihood(frame: &Matrix3<f64>, known: &[SeenDirection], config: &SquareConfig) -> f64 {
    let views = known.iter().map(|seen| View::new(frame, seen, config));
    views
        .map(|view| {
            view.map_or(any_log_density(config), |v| log_sum(v.likelihood.square, v.likelihood.other))
        })
        .sum()
}

/// A frame along a direction and the perpendicular part of another (or the same).
fn start_frame(first: &Unit<Vector3<f64>>, second: &Unit<Vector3<f64>>) -> Option<Matrix3<f64>> {
    let a = first.into_inner();
    let b = if first == second { frame_across(first).0 } else { second.into_inner() };
    let b = Unit::try_new(b - a * a.dot(&b), LEAST_COSINE)?;
    Some(Matrix3::from_columns(&[a, b.into_inner(), a.cross(&b)]))
}

fn polished_frame(mut frame: Matrix3<f64>, known: &[SeenDirection], config: &SquareConfig) -> Matrix3<f64> {
    for _ in 0..ITERATIONS {
        // Expectation with the weights from the current frame, then one step of maximization.
        let all =
            known.iter().filter_map(|seen| View::new(&frame, seen, config)).map(|v| v.rotation_information());
        let (h, g) = summed_information(all);
        let Some(turn) = h.cholesky().map(|c| c.solve(&g)) else { break };
        frame = UnitQuaternion::from_scaled_axis(turn).to_rotation_matrix() * frame;
        if turn.norm() < 1e-10 {
            break;
        }
    }
    frame
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(direction: [f64; 3], std_deg: f64) -> SeenDirection {
        let direction = Unit::new_normalize(Vector3::from(direction));
        let across = Matrix3::identity() - direction.into_inner() * direction.transpose();
        SeenDirection { direction, covariance: across * std_deg.to_radians().powi(2) }
    }

    fn turned(all: &[SeenDirection]) -> Vec<Option<SeenDirection>> {
        let turn = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.0);
        let rotation = turn.to_rotation_matrix();
        let covariance = |s: &SeenDirection| rotation * s.covariance * rotation.transpose();
        all.iter()
            .map(|s| Some(SeenDirection { direction: turn * s.direction, covariance: covariance(s) }))
            .collect()
    }

    fn off_deg(prior: &SeenDirection, direction: [f64; 3]) -> f64 {
        let truth = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.0) * Vector3::from(direction);
        prior.direction.cross(&truth).norm().asin().to_degrees()
    }

    fn std_deg(prior: &SeenDirection) -> f64 {
        prior.covariance.trace().sqrt().to_degrees()
    }

    #[test]
    fn an_axis_takes_the_direction_of_its_likes() {
        // Two hinges and a slide that are known, a hinge that is hardly.
        let all = turned(&[
            seen([0.0, 0.0, 1.0], 0.05),
            seen([0.0, 0.001, -1.0], 0.05),
            seen([1.0, 0.0, 0.0], 0.05),
            seen([0.05, 0.03, 1.0], 2.0),
        ]);
        let priors = square_priors(&all, &[], &SquareConfig::default());
        let open = priors[3].expect("square");
        assert!(
            off_deg(&open, [0.0, 0.0, 1.0]) < 0.05 && std_deg(&open) < 0.6,
            "{} {}",
            off_deg(&open, [0.0, 0.0, 1.0]),
            std_deg(&open)
        );
        // What is known well hardly learns from what is not.
        let without = square_priors(&all[..3], &[], &SquareConfig::default());
        for (a, b) in priors.iter().zip(&without) {
            assert!(a.unwrap().direction.angle(&b.unwrap().direction) < 2e-3);
        }
    }

    #[test]
    fn one_face_is_a_prior_of_what_is_across_it_and_no_more() {
        let face = turned(&[seen([0.0, 0.0, 1.0], 0.1)])[0].unwrap();
        let all = turned(&[seen([1.0, 0.2, 0.04], 1.5)]);
        let prior = square_priors(&all, &[face], &SquareConfig::default())[0].expect("square");
        let normal = face.direction.into_inner();
        assert!(prior.direction.dot(&normal).abs() < 2e-3);
        assert!(normal.dot(&(prior.covariance * normal)).sqrt().to_degrees() < 0.5);
        assert!(std_deg(&prior) > 20.0);
    }

    #[test]
    fn a_tilted_axis_is_left_alone() {
        let all = turned(&[
            seen([0.0, 0.0, 1.0], 0.05),
            seen([1.0, 0.0, 0.0], 0.05),
            seen([0.05, 0.0, 1.0], 0.2),
            seen([0.5, 0.5, 0.7], 2.0),
        ]);
        let priors = square_priors(&all, &[], &SquareConfig::default());
        assert!(priors[0].is_some() && priors[1].is_some() && priors[2].is_none() && priors[3].is_none());
        let none = SquareConfig { share: 0.0 };
        assert!(square_priors(&all, &[], &none).iter().all(Option::is_none));
    }

    #[test]
    fn an_axis_that_is_not_known_has_no_prior_and_keeps_its_place() {
        let mut all =
            turned(&[seen([0.0, 0.0, 1.0], 0.05), seen([0.0, 0.0, 1.0], 0.05), seen([0.0, 1.0, 0.0], 0.05)]);
        all[0] = None;
        let priors = square_priors(&all, &[], &SquareConfig::default());
        assert!(priors[0].is_none());
        assert!(
            off_deg(&priors[1].unwrap(), [0.0, 0.0, 1.0]) < 1e-6
                && off_deg(&priors[2].unwrap(), [0.0, 1.0, 0.0]) < 1e-6
        );
    }
}
