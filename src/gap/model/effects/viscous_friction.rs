//! Viscous friction: `effort = -b v`.

use crate::model::effect::{
    At, Coverage, Dimension, Effect, Parameter, Place, Response, Spec, amplitude_parameter,
};
use crate::model::format::{Expression, Format, JointNumbers};
use crate::model::plant::Plant;

/// See the module.
#[derive(Debug)]
pub(super) struct ViscousFriction;

const PARAMETERS: &[Parameter] = &[amplitude_parameter("damping", Dimension::Damping, true)];

const SPEC: Spec = Spec {
    name: "viscous_friction",
    place: Place::Effort,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "move at two steady speeds that differ five times",
};

impl Effect for ViscousFriction {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn is_of_damping(&self) -> bool {
        true
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        out.value = -p[0] * at.v;
        out.v = -p[0];
        out.p[0] = -at.v;
    }

    fn parameter_bounds(&self, _index: usize, coverage: &Coverage) -> (f64, f64) {
        // The total damping must not be negative.
        (-coverage.damping, 1e9)
    }

    fn is_of_velocity(&self) -> bool {
        true
    }

    fn in_twin(&self, _index: usize, plant: &Plant) -> f64 {
        plant.damping
    }

    fn in_format(&self, _format: Format, p: &[f64], plant: &Plant) -> Expression {
        Expression::native_if(plant.damping + p[0] >= 0.0)
    }

    fn add_to_numbers(&self, p: &[f64], joint: &mut JointNumbers) {
        joint.damping = (joint.damping + p[0]).max(0.0);
    }
}
