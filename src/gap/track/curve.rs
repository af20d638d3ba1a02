//! A line or a circle in space, by parameters in which a line is the circle without bend.

use geometry::normals_of;
use nalgebra::{Matrix2xX, Unit, UnitQuaternion, Vector2, Vector3};

/// Number of parameters of a line: offset and tilt across.
pub const LINE: usize = 4;
/// Number of parameters of a circle: the same and its bend.
pub const CIRCLE: usize = 6;
/// Step of numeric derivatives, meters, radians and 1/m.
/// chosen: between rounding and curvature, for lengths of 0.01 to 10 m.
const STEP: f64 = 1e-6;
/// Bend below which a curve has no center, 1/m.
/// chosen: a circle of 10,000 km.
const STRAIGHT: f64 = 1e-7;

/// A curve through a point: its direction there, two directions across, and how it bends towards them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathCurve {
    /// Point of the curve, meters.
    pub point: Vector3<f64>,
    /// Unit direction of the curve in this point.
    pub tangent: Vector3<f64>,
    /// Two unit directions across; the three are right-handed.
    pub across: [Vector3<f64>; 2],
    /// Inverse radius times the direction to the center, in the directions across, 1/m.
    pub bend: Vector2<f64>,
}

impl PathCurve {
    /// The line through a point; `None` where the direction is zero.
    #[must_use]
    pub fn line(point: Vector3<f64>, direction: &Vector3<f64>) -> Option<Self> {
        let tangent = Unit::try_new(*direction, f64::MIN_POSITIVE)?.into_inner();
        Some(Self { point, tangent, across: normals_of(&tangent), bend: Vector2::zeros() })
    }

    /// The circle through three points, from the middle one; their line where they are on one.
    #[must_use]
    pub fn circle(points: [&Vector3<f64>; 3]) -> Option<Self> {
        let a = points[0] - points[1];
        let b = points[2] - points[1];
        let normal = a.cross(&b);
        let square = normal.norm_squared();
        let sides = a.norm_squared() * b.norm_squared();
        if !(square > STRAIGHT * STRAIGHT * sides) {
            return Self::line(*points[1], &(points[2] - points[0]));
        }
        let to_center = (a * b.norm_squared() - b * a.norm_squared()).cross(&normal) / (-2.0 * square);
        let mut curve = Self::line(*points[1], &normal.cross(&to_center))?;
        let bend = to_center / to_center.norm_squared();
        curve.bend = Vector2::new(curve.across[0].dot(&bend), curve.across[1].dot(&bend));
        Some(curve)
    }

    /// The curve changed by a step of its first [`LINE`] or of all [`CIRCLE`] parameters.
    #[must_use]
    pub fn stepped(&self, step: &[f64]) -> Self {
        let [first, second] = self.across;
        let tangent = (self.tangent + first * step[2] + second * step[3]).normalize();
        let first_across = (first - tangent * first.dot(&tangent)).normalize();
        let bend = match step.get(4..CIRCLE) {
            Some(change) => self.bend + Vector2::new(change[0], change[1]),
            None => self.bend,
        };
        Self {
            point: self.point + first * step[0] + second * step[1],
            tangent,
            across: [first_across, tangent.cross(&first_across)],
            bend,
        }
    }

    /// The same curve from another of its points, at a length along it, meters.
    #[must_use]
    pub fn from_point_at(&self, along: f64) -> Self {
        let Some((axis, center)) = self.axis_and_center() else {
            return Self { point: self.point + self.tangent * along, ..*self };
        };
        let turn = UnitQuaternion::from_axis_angle(&Unit::new_unchecked(axis), along * self.bend.norm());
        Self {
            point: center + turn * (self.point - center),
            tangent: turn * self.tangent,
            across: self.across.map(|a| turn * a),
            bend: self.bend,
        }
    }

    /// Unit axis of the circle, about which the curve turns from its point on, and its center; `None` for a
    /// line.
    #[must_use]
    pub fn axis_and_center(&self) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let bend = self.bend.norm();
        if bend < STRAIGHT {
            return None;
        }
        let to_center = self.bend_vector() / bend;
        Some((self.tangent.cross(&to_center), self.point + to_center / bend))
    }

    /// The bend as a vector in space, 1/m.
    fn bend_vector(&self) -> Vector3<f64> {
        self.across[0] * self.bend.x + self.across[1] * self.bend.y
    }

    /// Turn of a part that moves along the curve, radians per meter.
    #[must_use]
    pub fn spin(&self) -> Vector3<f64> {
        self.tangent.cross(&self.bend_vector())
    }

    /// Distances of a point from the curve in the directions across, meters, and the length along the curve
    /// to the nearest point, meters, less than half a turn from [`Self::point`].
    #[must_use]
    pub fn residual(&self, position: &Vector3<f64>) -> (Vector2<f64>, f64) {
        let off = position - self.point;
        let along = off.dot(&self.tangent);
        let across = Vector2::new(off.dot(&self.across[0]), off.dot(&self.across[1]));
        let bend = self.bend.norm();
        if bend < STRAIGHT {
            return (across, along);
        }
        let inward = self.bend / bend;
        let in_plane = across.dot(&inward);
        let out_of_plane = inward.perp(&across);
        let square = along * along + in_plane * in_plane;
        // derived: the distance from the center in radii; written so that nothing cancels where the bend is
        // small.
        let radii = (bend * bend * square - 2.0 * bend * in_plane + 1.0).max(0.0).sqrt();
        let radial = (2.0 * in_plane - bend * square) / (radii + 1.0);
        let angle = (bend * along).atan2(1.0 - bend * in_plane);
        (inward * radial + Vector2::new(-inward.y, inward.x) * out_of_plane, angle / bend)
    }

    /// Residuals of all positions, and their lengths along the curve without jumps by full turns.
    #[must_use]
    pub fn residuals(&self, positions: &[Vector3<f64>]) -> (Matrix2xX<f64>, Vec<f64>) {
        let mut residuals = Matrix2xX::zeros(positions.len());
        let mut along: Vec<f64> = Vec::with_capacity(positions.len());
        let bend = self.bend.norm();
        let round = if bend < STRAIGHT { f64::INFINITY } else { std::f64::consts::TAU / bend };
        for (k, position) in positions.iter().enumerate() {
            let (residual, mut length) = self.residual(position);
            if let Some(last) = along.last().filter(|_| round.is_finite()) {
                length += ((last - length) / round).round() * round;
            }
            residuals.set_column(k, &residual);
            along.push(length);
        }
        (residuals, along)
    }

    /// Slopes of the residuals in one parameter.
    #[must_use]
    pub fn slopes(&self, positions: &[Vector3<f64>], parameter: usize) -> Matrix2xX<f64> {
        let [up, down] = [STEP, -STEP].map(|step| self.stepped(&unit_step(parameter, step)));
        let mut slopes = Matrix2xX::zeros(positions.len());
        for (k, position) in positions.iter().enumerate() {
            slopes.set_column(k, &((up.residual(position).0 - down.residual(position).0) / (2.0 * STEP)));
        }
        slopes
    }

    /// Slopes of a list of numbers that follow from the curve, one column a parameter.
    #[must_use]
    pub fn slopes_of(
        &self,
        parameters: usize,
        numbers: &dyn Fn(&Self) -> nalgebra::DVector<f64>,
    ) -> nalgebra::DMatrix<f64> {
        let columns: Vec<_> = (0..parameters)
            .map(|p| {
                let [up, down] = [STEP, -STEP].map(|step| numbers(&self.stepped(&unit_step(p, step))));
                (up - down) / (2.0 * STEP)
            })
            .collect();
        nalgebra::DMatrix::from_columns(&columns)
    }
}

/// A step of one parameter.
fn unit_step(parameter: usize, step: f64) -> [f64; CIRCLE] {
    let mut steps = [0.0; CIRCLE];
    steps[parameter] = step;
    steps
}
