//! Drag growing with the square of the speed: `effort = -c v |v|`.

use crate::model::effect::{At, Dimension, Effect, Parameter, Place, Response, Spec, amplitude_parameter};
use crate::model::format::{Expression, Format, JointNumbers};
use crate::model::plant::Plant;

/// See the module.
#[derive(Debug)]
pub(super) struct QuadraticDrag;

const PARAMETERS: &[Parameter] = &[amplitude_parameter("drag", Dimension::Drag, false)];

const SPEC: Spec = Spec {
    name: "quadratic_drag",
    place: Place::Effort,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "move at a top speed at least three times the usual one",
};

impl Effect for QuadraticDrag {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        out.value = -p[0] * at.v * at.v.abs();
        out.v = -2.0 * p[0] * at.v.abs();
        out.p[0] = -at.v * at.v.abs();
    }

    fn is_of_velocity(&self) -> bool {
        true
    }

    fn in_format(&self, format: Format, _p: &[f64], _plant: &Plant) -> Expression {
        Expression::native_if(format == Format::Mjcf)
    }

    fn add_to_numbers(&self, p: &[f64], joint: &mut JointNumbers) {
        joint.drag += p[0];
    }
}
