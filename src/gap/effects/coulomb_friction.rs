//! Coulomb friction: `|friction| <= F`, against the motion; sticks exactly.

use crate::gap::effect::{At, Coverage, Dimension, Effect, Parameter, Place, Response, Spec, amplitude};

/// See the module.
#[derive(Debug)]
pub struct CoulombFriction;

const PARAMETERS: &[Parameter] = &[amplitude("friction", Dimension::Effort, false)];

const SPEC: Spec = Spec {
    name: "coulomb_friction",
    place: Place::Friction,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "reverse slowly six times or more, at two speeds",
};

impl Effect for CoulombFriction {
    fn spec(&self) -> &'static Spec {
        &SPEC
    }

    fn respond(&self, _at: &At, p: &[f64], out: &mut Response) {
        out.value = p[0];
        out.p[0] = 1.0;
    }

    fn shapes(&self, _coverage: &Coverage) -> Vec<Vec<f64>> {
        vec![vec![0.0]]
    }
}
