//! A spring: `effort = e - k q`, at rest where `q = e / k`.

use crate::model::effect::{
    At, Dimension, Effect, MAX_PARAMETERS, Parameter, Place, Reported, Response, Spec, amplitude_parameter,
};
use crate::model::format::{Expression, Format, JointNumbers, Spring};
use crate::model::plant::Plant;

/// See the module.
#[derive(Debug)]
pub(super) struct SpringReturn;

const PARAMETERS: &[Parameter] = &[
    amplitude_parameter("stiffness", Dimension::Stiffness, false),
    amplitude_parameter("offset", Dimension::Effort, true),
];

const SPEC: Spec = Spec {
    name: "spring_return",
    place: Place::Effort,
    parameters: PARAMETERS,
    contains: &["constant_bias"],
    experiment: "let it go from several positions over the whole range",
};

impl Effect for SpringReturn {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn is_of_position(&self) -> bool {
        true
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        // Offset and stiffness enter linearly, so screening needs no grid of rest positions.
        out.value = p[1] - p[0] * at.q;
        out.q = -p[0];
        out.p[0] = -at.q;
        out.p[1] = 1.0;
    }

    fn reported_parameters(&self, p: &[f64]) -> Vec<Reported> {
        let mut stiffness = [0.0; MAX_PARAMETERS];
        stiffness[0] = 1.0;
        let mut rest = [0.0; MAX_PARAMETERS];
        // Reports give e / k, so its interval needs the derivatives with respect to both.
        (rest[0], rest[1]) = (-p[1] / (p[0] * p[0]), 1.0 / p[0]);
        vec![
            Reported { name: "stiffness", dimension: Dimension::Stiffness, value: p[0], gradient: stiffness },
            Reported {
                name: "rest_position",
                dimension: Dimension::Position,
                value: p[1] / p[0],
                gradient: rest,
            },
        ]
    }

    fn in_format(&self, format: Format, p: &[f64], _plant: &Plant) -> Expression {
        match format {
            Format::Mjcf => Expression::Native,
            Format::Sdf | Format::Usd => Expression::native_if(p[0] > 0.0),
            Format::Urdf => Expression::NotExpressible,
        }
    }

    fn add_to_numbers(&self, p: &[f64], joint: &mut JointNumbers) {
        joint.spring = Some(Spring { stiffness: p[0], cubic: 0.0, rest: p[1] / p[0] });
    }
}
