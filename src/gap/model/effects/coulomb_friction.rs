//! Coulomb friction: `|friction| <= F`, opposing the motion, with exact sticking.

use crate::model::effect::{At, Dimension, Effect, Parameter, Place, Response, Spec, amplitude_parameter};
use crate::model::format::{Expression, Format, JointNumbers};
use crate::model::plant::Plant;

/// See the module.
#[derive(Debug)]
pub(super) struct CoulombFriction;

const PARAMETERS: &[Parameter] = &[amplitude_parameter("friction", Dimension::Effort, false)];

const SPEC: Spec = Spec {
    name: "coulomb_friction",
    place: Place::Friction,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "reverse slowly six times or more, at two speeds",
};

impl Effect for CoulombFriction {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn write_response(&self, _at: &At, p: &[f64], out: &mut Response) {
        out.value = p[0];
        out.p[0] = 1.0;
    }

    fn in_twin(&self, _index: usize, plant: &Plant) -> f64 {
        plant.friction
    }

    fn in_format(&self, _format: Format, _p: &[f64], _plant: &Plant) -> Expression {
        Expression::Native
    }

    fn add_to_numbers(&self, p: &[f64], joint: &mut JointNumbers) {
        joint.friction += p[0];
    }
}
