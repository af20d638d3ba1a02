//! A constant effort: `effort = e`.

use crate::model::effect::{At, Dimension, Effect, Parameter, Place, Response, Spec, amplitude_parameter};
use crate::model::format::{Expression, Format, JointNumbers};
use crate::model::plant::Plant;

/// See the module.
#[derive(Debug)]
pub(super) struct ConstantBias;

const PARAMETERS: &[Parameter] = &[amplitude_parameter("effort", Dimension::Effort, true)];

const SPEC: Spec = Spec {
    name: "constant_bias",
    place: Place::Effort,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "hold the joint still at several positions",
};

impl Effect for ConstantBias {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn write_response(&self, _at: &At, p: &[f64], out: &mut Response) {
        out.value = p[0];
        out.p[0] = 1.0;
    }

    fn in_format(&self, format: Format, _p: &[f64], _plant: &Plant) -> Expression {
        Expression::native_if(format == Format::Mjcf)
    }

    fn add_to_numbers(&self, p: &[f64], joint: &mut JointNumbers) {
        joint.bias += p[0];
    }
}
