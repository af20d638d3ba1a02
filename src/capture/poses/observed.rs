//! Motions that the surfaces determine.

use nalgebra::{Matrix6, Vector6};

/// Least information about a direction that counts as observed, relative to the best one.
/// chosen: less may come from the noise of normals
const OBSERVED: f64 = 0.03;

/// Information restricted to directions that the surfaces determine (solution remapping: Zhang, Kaess and
/// Singh 2016). The other directions get a little from the noise of normals. Rotations are scaled to
/// translations at the distance where both have the same information.
pub(crate) struct Observed {
    /// Information about the observed directions.
    pub information: Matrix6<f64>,
    /// Projects a gradient onto these directions.
    pub projector: Matrix6<f64>,
}

impl Observed {
    /// The observed part of an information matrix.
    pub fn of_information(information: &Matrix6<f64>) -> Self {
        Self::above_share(information, OBSERVED)
    }

    /// The same with another least share.
    pub fn above_share(information: &Matrix6<f64>, share: f64) -> Self {
        let trace = |from: usize| (from..from + 3).map(|k| information[(k, k)]).sum::<f64>();
        let lever_m = (trace(3) / trace(0).max(f64::MIN_POSITIVE)).sqrt().max(f64::MIN_POSITIVE);
        let unit = Matrix6::from_diagonal(&Vector6::from_fn(|k, _| if k < 3 { 1.0 } else { lever_m }));
        let inverse =
            Matrix6::from_diagonal(&Vector6::from_fn(|k, _| if k < 3 { 1.0 } else { 1.0 / lever_m }));
        let eigen = (inverse * information * inverse).symmetric_eigen();
        let least = share * eigen.eigenvalues.max();
        let mut observed = Self { information: Matrix6::zeros(), projector: Matrix6::zeros() };
        for (value, direction) in
            eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()).filter(|(v, _)| **v > least)
        {
            let along = direction * direction.transpose();
            observed.information += along * *value;
            observed.projector += along;
        }
        Self {
            information: unit * observed.information * unit,
            projector: unit * observed.projector * inverse,
        }
    }
}
