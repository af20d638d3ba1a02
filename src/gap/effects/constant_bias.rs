//! A constant effort: `effort = e`.

use crate::gap::effect::{At, Coverage, Dimension, Effect, Parameter, Place, Response, amplitude};

/// See the module.
#[derive(Debug)]
pub struct ConstantBias;

const PARAMETERS: &[Parameter] = &[amplitude("effort", Dimension::Effort, true)];

impl Effect for ConstantBias {
    fn name(&self) -> &'static str {
        "constant_bias"
    }

    fn place(&self) -> Place {
        Place::Effort
    }

    fn parameters(&self) -> &'static [Parameter] {
        PARAMETERS
    }

    fn respond(&self, _at: &At, p: &[f64], out: &mut Response) {
        out.value = p[0];
        out.p[0] = 1.0;
    }

    fn shapes(&self, _coverage: &Coverage) -> Vec<Vec<f64>> {
        vec![vec![0.0]]
    }

    fn experiment(&self) -> &'static str {
        "hold the joint still at several positions"
    }
}
