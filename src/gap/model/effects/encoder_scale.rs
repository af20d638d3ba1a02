//! The recorded position is `s` times the true one.

use crate::model::effect::{Coverage, Effect, Parameter, Place, Spec, ratio_parameter};

/// See the module.
#[derive(Debug)]
pub(super) struct EncoderScale;

const PARAMETERS: &[Parameter] = &[ratio_parameter("scale")];

/// Largest ratio of the recorded to the true position; its inverse is the smallest.
/// chosen: the next integer ratio of a gear or a belt; a larger one would be another unit.
const LARGEST: f64 = 2.0;

const SPEC: Spec = Spec {
    name: "encoder_scale",
    place: Place::Scale,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "move between two measured positions, or hang a known weight on it",
};

impl Effect for EncoderScale {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn parameter_bounds(&self, _index: usize, _coverage: &Coverage) -> (f64, f64) {
        (1.0 / LARGEST, LARGEST)
    }

    fn indistinguishable_partner(&self, coverage: &Coverage) -> Option<&'static str> {
        // With a load independent of the position, a gain of the effort is equivalent.
        (!coverage.has_load_slope).then_some("torque_gain")
    }
}
