//! A small motion as a function of the position on a surface. The distances of correspondences give the
//! evidence for several such functions. See docs/method.md (6.12).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Point3, Vector6};

/// A correspondence, linearized in a small motion (rotation vector in radii, shift).
pub(crate) struct Reading {
    /// Position in state 0, meters.
    pub place: Point3<f64>,
    pub row: Vector6<f64>,
    pub residual_m: f64,
    /// Weight of the squared distance; independent errors have a variance of 1.
    pub weight: f64,
}

/// Function that gives the derivatives of a reading's distance by the explaining values, meters or radii by
/// meters.
pub(crate) type Design<'a> = dyn Fn(&Reading) -> Vec<f64> + 'a;

/// Derivatives by a step proportional to each measure.
pub(crate) fn step_derivatives(reading: &Reading, measures: &[f64]) -> Vec<f64> {
    measures.iter().flat_map(|m| reading.row.iter().map(move |x| m * x)).collect()
}

/// The readings from which steps are compared.
pub(crate) struct StepField<'a> {
    pub readings: &'a [Reading],
    /// Prior information on every value.
    pub prior: f64,
    /// Ratio of the variance of sums of readings to that of independent ones.
    pub dispersion: f64,
}

impl StepField<'_> {
    /// Log evidence for the values of a design over none: the likelihood of a linear Gaussian model with the
    /// values integrated out. `None` without readings.
    pub(crate) fn log_evidence(&self, design: &Design<'_>) -> Option<f64> {
        let size = design(self.readings.first()?).len();
        let mut matrix = DMatrix::identity(size, size) * self.prior;
        let mut right = DVector::zeros(size);
        for r in self.readings {
            let row = DVector::from_vec(design(r));
            let weight = r.weight / self.dispersion;
            // The factorization reads only the lower half.
            matrix.syger(weight, &row, &row, 1.0);
            right.axpy(-r.residual_m * weight, &row, 1.0);
        }
        let factor: Cholesky<f64, Dyn> = matrix.cholesky()?;
        let occam = factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>()
            - 0.5 * size as f64 * self.prior.ln();
        Some(0.5 * right.dot(&factor.solve(&right)) - occam)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Readings of a plate whose left and right half are shifted along its normal by these many meters, plus
    /// a bend in meters at its ends.
    fn plate(left_m: f64, right_m: f64, bend_m: f64) -> Vec<Reading> {
        (0..400)
            .map(|i| {
                let x = f64::from(i % 20) / 10.0 - 0.95;
                let y = f64::from(i / 20) / 10.0 - 0.95;
                let shift_m = if x < 0.0 { left_m } else { right_m };
                let noise_m = 1e-4 * f64::from((i * 7919) % 13 - 6) / 6.0;
                Reading {
                    place: Point3::new(x, y, 0.0),
                    row: Vector6::new(y, -x, 0.0, 0.0, 0.0, 1.0),
                    residual_m: -shift_m - bend_m * x * x + noise_m,
                    weight: 1e8,
                }
            })
            .collect()
    }

    /// Log evidence of one step, two, and one that changes evenly.
    fn evidence(readings: &[Reading]) -> [f64; 3] {
        let field = StepField { readings, prior: 1e4, dispersion: 1.0 };
        let second = |r: &Reading| f64::from(u8::from(r.place.x > 0.0));
        let all: [&Design<'_>; 3] = [
            &|r| step_derivatives(r, &[1.0]),
            &|r| step_derivatives(r, &[1.0 - second(r), second(r)]),
            &|r| step_derivatives(r, &[1.0, r.place.x]),
        ];
        all.map(|m| field.log_evidence(m).unwrap())
    }

    #[test]
    fn a_shift_of_the_whole_is_one_step() {
        let [one, two, even] = evidence(&plate(2e-3, 2e-3, 0.0));
        assert!(one > two && one > even, "{one} {two} {even}");
    }

    #[test]
    fn halves_that_part_are_two_steps_and_a_bend_is_none() {
        let [one, two, even] = evidence(&plate(0.0, 2e-3, 0.0));
        assert!(two > even && two > one, "{one} {two} {even}");
        let [one, two, even] = evidence(&plate(0.0, 0.0, 2e-3));
        assert!(even > two && even > one, "{one} {two} {even}");
    }

    #[test]
    fn readings_that_err_together_say_less() {
        let readings = plate(0.0, 2e-3, 0.0);
        let of = |dispersion| {
            let field = StepField { readings: &readings, prior: 1e4, dispersion };
            field.log_evidence(&|r| step_derivatives(r, &[1.0])).unwrap()
        };
        assert!(of(1.0) > of(10.0));
    }
}
