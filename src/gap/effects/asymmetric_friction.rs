//! Coulomb friction with another bound each way.

use crate::gap::effect::{At, Coverage, Dimension, Effect, Parameter, Place, Response, amplitude};

/// See the module.
#[derive(Debug)]
pub struct AsymmetricFriction;

const PARAMETERS: &[Parameter] =
    &[amplitude("friction_positive", Dimension::Effort, false), amplitude("friction_negative", Dimension::Effort, false)];

impl Effect for AsymmetricFriction {
    fn name(&self) -> &'static str {
        "asymmetric_friction"
    }

    fn place(&self) -> Place {
        Place::Friction
    }

    fn parameters(&self) -> &'static [Parameter] {
        PARAMETERS
    }

    fn respond(&self, at: &At, p: &[f64], out: &mut Response) {
        let side = usize::from(at.direction < 0.0);
        out.value = p[side];
        out.p[side] = 1.0;
    }

    fn shapes(&self, _coverage: &Coverage) -> Vec<Vec<f64>> {
        vec![vec![0.0, 0.0]]
    }

    fn contains(&self) -> &'static [&'static str] {
        &["coulomb_friction"]
    }

    fn experiment(&self) -> &'static str {
        "hold the joint still without effort on either side of where it creeps, then slide slowly both ways"
    }
}
