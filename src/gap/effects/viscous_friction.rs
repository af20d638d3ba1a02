//! Viscous friction: `effort = -b v`.

use crate::gap::effect::{At, Coverage, Dimension, Effect, Parameter, Place, Response, amplitude};

/// See the module.
#[derive(Debug)]
pub struct ViscousFriction;

const PARAMETERS: &[Parameter] = &[amplitude("damping", Dimension::Damping, true)];

impl Effect for ViscousFriction {
    fn name(&self) -> &'static str {
        "viscous_friction"
    }

    fn place(&self) -> Place {
        Place::Effort
    }

    fn parameters(&self) -> &'static [Parameter] {
        PARAMETERS
    }

    fn respond(&self, at: &At, p: &[f64], out: &mut Response) {
        out.value = -p[0] * at.v;
        out.v = -p[0];
        out.p[0] = -at.v;
    }

    fn shapes(&self, _coverage: &Coverage) -> Vec<Vec<f64>> {
        vec![vec![0.0]]
    }

    fn experiment(&self) -> &'static str {
        "move at two steady speeds that differ five times"
    }
}
