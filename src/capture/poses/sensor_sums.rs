//! Normal equations of the sensor's parameters.

use nalgebra::{DMatrix, DVector};

use super::{depth_warp::ORDER, sensor_errors::SensorErrors, surfels::Residual};
use numeric::vectorized;

/// Contiguous pieces of parameters per residual: the rows of spline support at both pixels.
const PIECES: usize = 2 * ORDER;

/// Normal equations of the sensor's parameters.
#[derive(Clone)]
pub(crate) struct SensorSums {
    pub information: DMatrix<f64>,
    /// Cross terms between the poses (six rows each) and the sensor.
    pub between: DMatrix<f64>,
    pub gradient: DVector<f64>,
}

/// One residual with its derivatives.
pub(super) struct Row {
    /// By small motions of both cameras.
    pub poses: [f64; 12],
    pub sensor: BySensor,
    pub distance_m: f64,
    pub weight: f64,
}

/// Derivatives of a residual by the sensor's parameters, in contiguous pieces.
#[derive(Clone, Copy, Default)]
pub(super) struct BySensor {
    /// Per piece, the index of its first parameter and the derivatives.
    warp: [(usize, [f64; ORDER]); PIECES],
    color_shift: (usize, [f64; 2]),
}

#[cfg(test)]
impl BySensor {
    /// Parameter indices with their derivatives.
    pub fn iter(&self) -> impl Iterator<Item = (usize, f64)> {
        let warp = self.warp.iter().flat_map(|(first, piece)| (*first..).zip(piece.iter().copied()));
        warp.chain((self.color_shift.0..).zip(self.color_shift.1))
    }
}

impl SensorSums {
    /// Empty sums. Until `completed`, poses run along columns, so that sums are contiguous in memory.
    pub fn of_no_residuals(poses: usize, values: usize) -> Self {
        Self {
            information: DMatrix::zeros(values, values),
            between: DMatrix::zeros(values, 6 * poses),
            gradient: DVector::zeros(values),
        }
    }

    /// Adds the products of one piece of a residual's derivatives with itself and with `rest`.
    #[inline(always)]
    fn add_piece<const N: usize>(
        &mut self,
        frames: [usize; 2],
        row: &Row,
        first: usize,
        piece: &[f64; N],
        rest: &[(usize, [f64; ORDER])],
    ) {
        let values = self.gradient.len();
        for (sum, x) in self.gradient.as_mut_slice()[first..first + N].iter_mut().zip(piece) {
            *sum += row.weight * row.distance_m * x;
        }
        let by_pose = row.poses.chunks_exact(6).zip(frames);
        for (d, pose) in by_pose.flat_map(|(by, f)| by.iter().zip(6 * f..)) {
            let sums = &mut self.between.as_mut_slice()[pose * values + first..][..N];
            sums.iter_mut().zip(piece).for_each(|(sum, x)| *sum += row.weight * d * x);
        }
        for (k, x) in piece.iter().enumerate() {
            let column = &mut self.information.as_mut_slice()[(first + k) * values..][..values];
            // Half of each product, as `completed` adds the transpose; a piece with itself has both halves.
            let half = 0.5 * row.weight * x;
            column[first..first + N].iter_mut().zip(piece).for_each(|(sum, y)| *sum += half * y);
            for (other, piece) in rest {
                let sums = column[*other..*other + ORDER].iter_mut();
                sums.zip(piece).for_each(|(sum, y)| *sum += row.weight * x * y);
            }
        }
    }

    /// Adds the mirrored halves.
    pub fn completed(mut self) -> Self {
        self.information = &self.information + self.information.transpose();
        self.between = self.between.transpose();
        self
    }

    pub fn added_to(mut self, other: Self) -> Self {
        self.information += other.information;
        self.between += other.between;
        self.gradient += other.gradient;
        self
    }
}

vectorized! {
    /// Adds the residuals of a pair.
    pub(super) fn add_rows(sums: &mut SensorSums, frames: [usize; 2], rows: &[Row]) = add_all
}

#[inline(always)]
fn add_all(sums: &mut SensorSums, frames: [usize; 2], rows: &[Row]) {
    for row in rows {
        let BySensor { warp, color_shift } = &row.sensor;
        for (k, (first, piece)) in warp.iter().enumerate() {
            sums.add_piece(frames, row, *first, piece, &warp[k + 1..]);
        }
        sums.add_piece(frames, row, color_shift.0, &color_shift.1, warp);
    }
}

/// Derivatives of the distance by the sensor's parameters, at the pixel of the point and its pixel in the
/// other frame: a point moves along its ray, and so does the plane. Features move with the color.
pub(super) fn by_sensor(r: &Residual, errors: &SensorErrors) -> BySensor {
    // docs/method.md (2.21).
    let [this, other] = r.pixels.map(|pixel| errors.warp.support_at(pixel).weighted_rows());
    let along = r.normal.dot(&r.point.coords);
    let across = r.other_normal.dot(&r.other_point.coords);
    let warp = std::array::from_fn(|piece| {
        let ((first, weights), slope) = match piece.checked_sub(ORDER) {
            None => (this[piece], along),
            Some(piece) => (other[piece], -across),
        };
        (first, weights.map(|w| w * slope))
    });
    BySensor { warp, color_shift: (errors.first_of_shift(), r.by_color_shift) }
}
