//! A constant effort: `effort = e`.

use crate::gap::effect::{At, Coverage, Dimension, Effect, Parameter, Place, Response, Spec, amplitude};

/// See the module.
#[derive(Debug)]
pub struct ConstantBias;

const PARAMETERS: &[Parameter] = &[amplitude("effort", Dimension::Effort, true)];

const SPEC: Spec = Spec {
    name: "constant_bias",
    place: Place::Effort,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "hold the joint still at several positions",
};

impl Effect for ConstantBias {
    fn spec(&self) -> &'static Spec {
        &SPEC
    }

    fn respond(&self, _at: &At, p: &[f64], out: &mut Response) {
        out.value = p[0];
        out.p[0] = 1.0;
    }

    fn shapes(&self, _coverage: &Coverage) -> Vec<Vec<f64>> {
        vec![vec![0.0]]
    }
}
