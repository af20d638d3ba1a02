//! Coulomb friction with another bound each way.

use crate::gap::effect::{At, Coverage, Dimension, Effect, Parameter, Place, Response, Spec, amplitude};

/// See the module.
#[derive(Debug)]
pub struct AsymmetricFriction;

const PARAMETERS: &[Parameter] =
    &[amplitude("friction_positive", Dimension::Effort, false), amplitude("friction_negative", Dimension::Effort, false)];

const SPEC: Spec = Spec {
    name: "asymmetric_friction",
    place: Place::Friction,
    parameters: PARAMETERS,
    contains: &["coulomb_friction"],
    experiment: "hold the joint still without effort on either side of where it creeps, then slide slowly both ways",
};

impl Effect for AsymmetricFriction {
    fn spec(&self) -> &'static Spec {
        &SPEC
    }

    fn respond(&self, at: &At, p: &[f64], out: &mut Response) {
        let side = usize::from(at.direction < 0.0);
        out.value = p[side];
        out.p[side] = 1.0;
    }

    fn shapes(&self, _coverage: &Coverage) -> Vec<Vec<f64>> {
        vec![vec![0.0, 0.0]]
    }
}
