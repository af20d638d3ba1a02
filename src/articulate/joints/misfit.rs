//! How much worse a joint fits than the free motions, beyond the effect of errors that leave no residual:
//! errors of poses and depth, of displaced surfaces, of the parents' motions. See docs/method.md 8.6.

use nalgebra::{DMatrix, DVector, DVectorView, Matrix6, Vector6};

use crate::joints::{
    joint_fit::{FreeFits, JointFit},
    minimise::left_difference,
};

/// Two metrics for a change of all free motions, 6 K x 6 K each, in squared standard deviations times the
/// dispersion.
pub(crate) struct Misfit {
    /// From the residuals alone: their information.
    by_residuals: DMatrix<f64>,
    /// From residuals and those errors together.
    by_all: DMatrix<f64>,
}

impl Misfit {
    /// `None` where the residuals leave some direction of a motion open.
    pub(crate) fn new(found: &FreeFits) -> Option<Self> {
        let size = 6 * found.free.len();
        let mut by_residuals = DMatrix::zeros(size, size);
        let mut of_gradient = DMatrix::zeros(size, size);
        let mut drawn: Vec<DVector<f64>> = Vec::new();
        for (k, free) in found.free.iter().enumerate() {
            let at = 6 * k;
            let information = &free.quadratic.information;
            let own: Matrix6<f64> = free.quadratic.displacement_covariance()
                + information * found.parent_motion(k).covariance * information;
            by_residuals.fixed_view_mut::<6, 6>(at, at).copy_from(information);
            of_gradient.fixed_view_mut::<6, 6>(at, at).copy_from(&own);
            let changes = found.drawn_gradients(k, &free.motion, information);
            drawn.resize(changes.len().max(drawn.len()), DVector::zeros(size));
            drawn.iter_mut().zip(changes).for_each(|(all, by)| all.rows_mut(at, 6).copy_from(&by));
        }
        let share = 1.0 / drawn.len().max(1) as f64;
        drawn.iter().for_each(|d| of_gradient.ger(share, d, d, 1.0));
        // The covariance of the motions is H^-1 (phi H + G) H^-1, and this is phi times its inverse.
        let total = &by_residuals + of_gradient / found.dispersion;
        let by_all = &by_residuals * total.cholesky()?.solve(&by_residuals);
        Some(Self { by_residuals, by_all })
    }

    /// The part of a joint's misfit (its cost less the free motions') that errors without a residual do not
    /// explain.
    pub(crate) fn unexplained_misfit(&self, misfit: f64, fit: &JointFit, found: &FreeFits) -> f64 {
        let differences = found.free.iter().enumerate().map(|(k, free)| -> Vector6<f64> {
            left_difference(
                &fit.joint.world_motion(k, &found.parent_motion(k).state1_from_state0),
                &free.motion,
            )
        });
        let off = DVector::from_vec(differences.flat_map(|d| d.data.0[0]).collect());
        let mut tangents = DMatrix::zeros(off.len(), fit.joint.dimension());
        for (k, t) in fit.tangents.iter().enumerate() {
            tangents.rows_mut(6 * k, 6).copy_from(t);
        }
        let [left, all] = [&self.by_all, &self.by_residuals]
            .map(|metric| least_squared_length(metric, off.column(0), &tangents));
        match (left, all) {
            // The cost is robust: far from the free motions it grows less than the square.
            (Some(left), Some(all)) if all > 0.0 => misfit.min(left / all * misfit.max(all)),
            _ => misfit,
        }
    }
}

/// The least squared length of `off + tangents p` over all p, in a given metric.
fn least_squared_length(
    metric: &DMatrix<f64>,
    off: DVectorView<f64>,
    tangents: &DMatrix<f64>,
) -> Option<f64> {
    let pull = metric * off;
    let by_parameters = tangents.tr_mul(&pull);
    let information = tangents.tr_mul(&(metric * tangents)).cholesky()?;
    Some(off.dot(&pull) - by_parameters.dot(&information.solve(&by_parameters)))
}
