//! Friction proportional to the joint's effort: `|friction| <= mu |u|`.

use crate::model::effect::{
    At, Coverage, Dimension, Effect, Parameter, Place, Response, Spec, amplitude_parameter,
};

/// Largest friction coefficient `mu`.
/// chosen: near 1, at which no effort could move the joint.
const LARGEST: f64 = 0.95;

/// See the module.
#[derive(Debug)]
pub(super) struct LoadDependentFriction;

const PARAMETERS: &[Parameter] = &[amplitude_parameter("coefficient", Dimension::Ratio, false)];

const SPEC: Spec = Spec {
    name: "load_dependent_friction",
    place: Place::Friction,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "repeat one motion with two loads",
};

impl Effect for LoadDependentFriction {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        out.value = p[0] * at.u.abs();
        out.u = p[0] * at.u.signum();
        out.p[0] = at.u.abs();
    }

    fn parameter_bounds(&self, _index: usize, _coverage: &Coverage) -> (f64, f64) {
        (0.0, LARGEST)
    }
}
