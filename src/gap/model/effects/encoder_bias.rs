//! The recorded position is the true one plus an offset. Only a load depending on the position reveals it.

use crate::model::effect::{Coverage, Dimension, Effect, Parameter, Place, Spec, amplitude_parameter};
use crate::model::format::{Expression, Format, JointNumbers};
use crate::model::plant::Plant;

/// See the module.
#[derive(Debug)]
pub(super) struct EncoderBias;

const PARAMETERS: &[Parameter] = &[amplitude_parameter("offset", Dimension::Position, true)];

const SPEC: Spec = Spec {
    name: "encoder_bias",
    place: Place::Bias,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "touch a stop whose position is known",
};

impl Effect for EncoderBias {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn start_shapes(&self, coverage: &Coverage) -> Vec<Vec<f64>> {
        // If no effort depends on the position, an offset has no effect.
        if coverage.has_load_slope { vec![vec![0.0]] } else { Vec::new() }
    }

    fn parameter_bounds(&self, _index: usize, coverage: &Coverage) -> (f64, f64) {
        let range = coverage.position.1 - coverage.position.0;
        (-range, range)
    }

    fn indistinguishable_partner(&self, coverage: &Coverage) -> Option<&'static str> {
        // An offset of the angle rotates the load in the same way as a tilted axis.
        coverage.turns.then_some("axis_tilt")
    }

    fn in_format(&self, format: Format, _p: &[f64], _plant: &Plant) -> Expression {
        Expression::native_if(format == Format::Mjcf)
    }

    fn add_to_numbers(&self, p: &[f64], joint: &mut JointNumbers) {
        joint.position_offset += p[0];
    }
}
