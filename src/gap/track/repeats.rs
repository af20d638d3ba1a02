//! Several openings as one joint: the mean of their axes, each weighed by its own covariance and by what the
//! openings differ beyond it (a random effect, after DerSimonian and Laird 1986).

use geometry::normals_of;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix3x2, Vector3};

use crate::track::opening::OpeningJoint;

/// Step of numeric derivatives, meters and parts of a unit vector.
/// chosen: between rounding and curvature.
const STEP: f64 = 1e-6;

/// The axis that several openings share.
#[derive(Clone, Debug, PartialEq)]
pub struct SharedAxis {
    /// Unit direction.
    pub axis: Vector3<f64>,
    /// Its covariance.
    pub axis_covariance: Matrix3<f64>,
    /// Point of the axis nearest to the middle of the openings' points, meters.
    pub origin: Vector3<f64>,
    /// Its covariance across the axis, square meters.
    pub origin_covariance: Matrix3<f64>,
    /// Deviation of an opening's direction from the shared one beyond its own covariance, radians.
    pub between_rad: f64,
    /// The same of its line, meters; 0 of a slide.
    pub between_m: f64,
}

impl SharedAxis {
    /// Standard deviation of the direction, radians: root of the mean variance of two directions across.
    #[must_use]
    pub fn axis_std_rad(&self) -> f64 {
        deviation_across(&self.axis_covariance)
    }

    /// The same of the line, meters.
    #[must_use]
    pub fn origin_std_m(&self) -> f64 {
        deviation_across(&self.origin_covariance)
    }
}

fn deviation_across(covariance: &Matrix3<f64>) -> f64 {
    (0.5 * covariance.trace()).sqrt()
}

/// The shared axis of openings of one type; `None` without any.
#[must_use]
pub fn shared_axis(openings: &[OpeningJoint], turns: bool) -> Option<SharedAxis> {
    let first = openings.first()?.axis;
    // An opening that went the other way has the opposite axis.
    let aligned = openings.iter().map(|o| o.sign_along(&first) * o.axis);
    let middle_axis = aligned.sum::<Vector3<f64>>().try_normalize(f64::MIN_POSITIVE)?;
    let origin = openings.iter().map(|o| o.point).sum::<Vector3<f64>>() / openings.len() as f64;
    let across = Matrix3x2::from_columns(&normals_of(&middle_axis));
    let plane = Plane { axis: middle_axis, origin, across };
    let count = if turns { 4 } else { 2 };
    let found: Vec<(DVector<f64>, DMatrix<f64>)> = openings
        .iter()
        .map(|o| {
            let sign = o.sign_along(&first);
            let place = plane.place_of(&(sign * o.axis), &o.point);
            let slopes = plane.slopes(&(sign * o.axis), &o.point, sign);
            let covariance =
                &slopes * DMatrix::from_column_slice(6, 6, o.covariance.as_slice()) * slopes.transpose();
            (place.rows(0, count).clone_owned(), covariance.view((0, 0), (count, count)).clone_owned())
        })
        .collect();
    let between = between_variances(&found);
    let (mean, covariance) = weighed_mean(&found, &between)?;
    let root = |pair: &[f64]| (0.5 * pair.iter().sum::<f64>()).sqrt();
    let directions = covariance.view((0, 0), (2, 2)).clone_owned();
    let lines = if turns { covariance.view((2, 2), (2, 2)).clone_owned() } else { DMatrix::zeros(2, 2) };
    let offset = if turns { across * mean.fixed_rows::<2>(2) } else { Vector3::zeros() };
    Some(SharedAxis {
        axis: (middle_axis + across * mean.fixed_rows::<2>(0)).normalize(),
        axis_covariance: in_space(&across, &directions),
        origin: origin + offset,
        origin_covariance: in_space(&across, &lines),
        between_rad: root(&between.as_slice()[..2]),
        between_m: if turns { root(&between.as_slice()[2..]) } else { 0.0 },
    })
}

/// A covariance across as one in space.
fn in_space(across: &Matrix3x2<f64>, covariance: &DMatrix<f64>) -> Matrix3<f64> {
    across * nalgebra::Matrix2::from_fn(|r, c| covariance[(r, c)]) * across.transpose()
}

/// A plane that all axes cross, by which they are compared.
struct Plane {
    axis: Vector3<f64>,
    origin: Vector3<f64>,
    across: Matrix3x2<f64>,
}

impl Plane {
    /// Tilt of an axis against the plane's normal, and where it crosses the plane.
    fn place_of(&self, axis: &Vector3<f64>, point: &Vector3<f64>) -> DVector<f64> {
        let steep = axis.dot(&self.axis);
        let crossing = point + axis * ((self.origin - point).dot(&self.axis) / steep) - self.origin;
        let tilt = self.across.transpose() * axis / steep;
        let offset = self.across.transpose() * crossing;
        DVector::from_column_slice(&[tilt.x, tilt.y, offset.x, offset.y])
    }

    /// Slopes of the place in the opening's own axis, which is `sign` times the given one, and in its point.
    fn slopes(&self, axis: &Vector3<f64>, point: &Vector3<f64>, sign: f64) -> DMatrix<f64> {
        let columns: Vec<DVector<f64>> = (0..6)
            .map(|k| {
                let step = Vector3::ith(k % 3, STEP);
                let [up, down] = [1.0, -1.0].map(|side| match k {
                    0..3 => self.place_of(&(axis + step * side * sign), point),
                    _ => self.place_of(axis, &(point + step * side)),
                });
                (up - down) / (2.0 * STEP)
            })
            .collect();
        DMatrix::from_columns(&columns)
    }
}

/// Variance between openings beyond their own, of each coordinate.
fn between_variances(found: &[(DVector<f64>, DMatrix<f64>)]) -> DVector<f64> {
    let count = found.first().map_or(0, |f| f.0.len());
    DVector::from_fn(count, |c, _| {
        let weights: Vec<f64> = found.iter().map(|(_, v)| 1.0 / v[(c, c)].max(f64::MIN_POSITIVE)).collect();
        let total: f64 = weights.iter().sum();
        let mean = found.iter().zip(&weights).map(|((x, _), w)| w * x[c]).sum::<f64>() / total;
        let misfit: f64 = found.iter().zip(&weights).map(|((x, _), w)| w * (x[c] - mean).powi(2)).sum();
        let squares: f64 = weights.iter().map(|w| w * w).sum();
        let freedom = found.len() as f64 - 1.0;
        if freedom < 1.0 { 0.0 } else { ((misfit - freedom) / (total - squares / total)).max(0.0) }
    })
}

/// Mean and covariance of coordinates under their own covariances and the variances between openings.
fn weighed_mean(
    found: &[(DVector<f64>, DMatrix<f64>)],
    between: &DVector<f64>,
) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let count = between.len();
    let mut information = DMatrix::zeros(count, count);
    let mut weighed = DVector::zeros(count);
    for (place, covariance) in found {
        let inverse = (covariance + DMatrix::from_diagonal(between)).try_inverse()?;
        weighed += &inverse * place;
        information += inverse;
    }
    let covariance = information.try_inverse()?;
    Some((&covariance * weighed, covariance))
}
