//! The acting effort is `g` times the recorded one.

use crate::model::effect::{Coverage, Effect, LARGEST_RATIO, Parameter, Place, Spec, ratio_parameter};
use crate::model::format::{Expression, Format, JointNumbers};
use crate::model::plant::Plant;

/// See the module.
#[derive(Debug)]
pub(super) struct TorqueGain;

const PARAMETERS: &[Parameter] = &[ratio_parameter("gain")];

const SPEC: Spec = Spec {
    name: "torque_gain",
    place: Place::Gain,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "hang a known weight on it, or move between two measured positions",
};

impl Effect for TorqueGain {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn parameter_bounds(&self, _index: usize, _coverage: &Coverage) -> (f64, f64) {
        (1.0 / LARGEST_RATIO, LARGEST_RATIO)
    }

    fn indistinguishable_partner(&self, coverage: &Coverage) -> Option<&'static str> {
        // With a load independent of the position, a scale of the position is equivalent.
        (!coverage.has_load_slope).then_some("encoder_scale")
    }

    fn in_format(&self, format: Format, _p: &[f64], _plant: &Plant) -> Expression {
        Expression::native_if(format == Format::Mjcf)
    }

    fn add_to_numbers(&self, p: &[f64], joint: &mut JointNumbers) {
        joint.gear *= p[0];
    }
}
