//! Coulomb friction: `|friction| <= F`, against the motion; sticks exactly.

use crate::gap::effect::{At, Coverage, Dimension, Effect, Parameter, Place, Response, amplitude};

/// See the module.
#[derive(Debug)]
pub struct CoulombFriction;

const PARAMETERS: &[Parameter] = &[amplitude("friction", Dimension::Effort, false)];

impl Effect for CoulombFriction {
    fn name(&self) -> &'static str {
        "coulomb_friction"
    }

    fn place(&self) -> Place {
        Place::Friction
    }

    fn parameters(&self) -> &'static [Parameter] {
        PARAMETERS
    }

    fn respond(&self, _at: &At, p: &[f64], out: &mut Response) {
        out.value = p[0];
        out.p[0] = 1.0;
    }

    fn shapes(&self, _coverage: &Coverage) -> Vec<Vec<f64>> {
        vec![vec![0.0]]
    }

    fn experiment(&self) -> &'static str {
        "reverse slowly six times or more, at two speeds"
    }
}
