//! More inertia than the twin has.

use crate::gap::effect::{Coverage, Dimension, Effect, Parameter, Place, amplitude};

/// See the module.
#[derive(Debug)]
pub struct Inertia;

const PARAMETERS: &[Parameter] = &[amplitude("added_inertia", Dimension::Inertia, true)];

impl Effect for Inertia {
    fn name(&self) -> &'static str {
        "inertia"
    }

    fn place(&self) -> Place {
        Place::Inertia
    }

    fn parameters(&self) -> &'static [Parameter] {
        PARAMETERS
    }

    fn shapes(&self, _coverage: &Coverage) -> Vec<Vec<f64>> {
        vec![vec![0.0]]
    }

    fn bounds(&self, _index: usize, coverage: &Coverage) -> (f64, f64) {
        (-0.9 * coverage.inertia, 1e9)
    }

    fn experiment(&self) -> &'static str {
        "shake it fast with a known effort"
    }
}
