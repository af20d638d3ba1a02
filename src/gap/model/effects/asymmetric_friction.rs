//! Coulomb friction with different bounds in the two directions.

use crate::model::effect::{At, Dimension, Effect, Parameter, Place, Response, Spec, amplitude_parameter};
use crate::model::format::{Expression, Format, NearestEffect};
use crate::model::plant::Plant;

/// See the module.
#[derive(Debug)]
pub(super) struct AsymmetricFriction;

const PARAMETERS: &[Parameter] = &[
    amplitude_parameter("friction_positive", Dimension::Effort, false),
    amplitude_parameter("friction_negative", Dimension::Effort, false),
];

const SPEC: Spec = Spec {
    name: "asymmetric_friction",
    place: Place::Friction,
    parameters: PARAMETERS,
    contains: &["coulomb_friction"],
    experiment: "hold the joint still without effort on either side of where it creeps, then slide slowly \
     both ways",
};

impl Effect for AsymmetricFriction {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        // Depends on the direction opposed by friction, since the velocity of a joint at rest has no sign.
        let side = usize::from(at.direction < 0.0);
        out.value = p[side];
        out.p[side] = 1.0;
    }

    fn in_twin(&self, _index: usize, plant: &Plant) -> f64 {
        plant.friction
    }

    fn in_format(&self, format: Format, p: &[f64], _plant: &Plant) -> Expression {
        // One bound for both directions, and in formats with a constant effort, an offset for the difference.
        let mean = NearestEffect::other_effect("coulomb_friction", vec![0.5 * (p[0] + p[1])]);
        match format {
            Format::Mjcf => Expression::Approximated(vec![
                mean,
                NearestEffect::other_effect("constant_bias", vec![0.5 * (p[1] - p[0])]),
            ]),
            Format::Sdf | Format::Usd => Expression::Approximated(vec![mean]),
            Format::Urdf => Expression::NotExpressible,
        }
    }
}
