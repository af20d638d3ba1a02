//! Viscous friction: `effort = -b v`.

use crate::gap::effect::{At, Coverage, Dimension, Effect, Parameter, Place, Response, Spec, amplitude};

/// See the module.
#[derive(Debug)]
pub struct ViscousFriction;

const PARAMETERS: &[Parameter] = &[amplitude("damping", Dimension::Damping, true)];

const SPEC: Spec = Spec {
    name: "viscous_friction",
    place: Place::Effort,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "move at two steady speeds that differ five times",
};

impl Effect for ViscousFriction {
    fn spec(&self) -> &'static Spec {
        &SPEC
    }

    fn respond(&self, at: &At, p: &[f64], out: &mut Response) {
        out.value = -p[0] * at.v;
        out.v = -p[0];
        out.p[0] = -at.v;
    }

    fn shapes(&self, _coverage: &Coverage) -> Vec<Vec<f64>> {
        vec![vec![0.0]]
    }

    fn bounds(&self, _index: usize, coverage: &Coverage) -> (f64, f64) {
        // A joint damps; it does not drive itself.
        (-coverage.damping, 1e9)
    }
}
