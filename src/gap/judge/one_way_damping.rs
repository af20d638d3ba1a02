//! Damping acting in one direction only, as in a door closer: `effort = -b v` where `v > 0`.

use crate::model::{
    effect::{At, Dimension, Effect, Parameter, Place, Response, Spec, amplitude_parameter},
    format::{Expression, Format, NearestEffect},
    plant::Plant,
};

/// See the module.
#[derive(Debug)]
pub struct OneWayDamping;

const PARAMETERS: &[Parameter] = &[amplitude_parameter("damping", Dimension::Damping, false)];

const SPEC: Spec = Spec {
    name: "one_way_damping",
    place: Place::Effort,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "move through the same range both ways at two steady speeds",
};

impl Effect for OneWayDamping {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        if at.v > 0.0 {
            out.value = -p[0] * at.v;
            out.v = -p[0];
            out.p[0] = -at.v;
        }
    }

    fn is_of_velocity(&self) -> bool {
        true
    }

    fn in_format(&self, _format: Format, p: &[f64], _plant: &Plant) -> Expression {
        // Formats damp both directions alike: half of it errs least over a motion to and fro.
        Expression::Approximated(vec![NearestEffect::other_effect("viscous_friction", vec![0.5 * p[0]])])
    }
}
