//! Motions determined by surfaces.

use nalgebra::{Matrix6, Vector6};

/// A direction counts as observed with this share of the information about the best one, at least.
/// chosen: less is the noise of normals
const OBSERVED: f64 = 0.03;

/// Information along the directions determined by the surfaces (solution remapping: Zhang, Kaess and Singh
/// 2016). The others have little, only from the noise of normals. Turns are compared with shifts at the
/// distance of equal information.
pub(crate) struct Observed {
    /// About those directions alone.
    pub information: Matrix6<f64>,
    /// The part of a gradient along these directions.
    pub projector: Matrix6<f64>,
}

impl Observed {
    /// Of all information.
    pub fn of_information(information: &Matrix6<f64>) -> Self {
        Self::above_share(information, OBSERVED)
    }

    /// The same, with a least share of the information about the best direction.
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
