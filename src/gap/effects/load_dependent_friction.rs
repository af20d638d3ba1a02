//! Friction in proportion to the effort that the joint carries: `|friction| <= mu |u|`.

use crate::gap::effect::{At, Coverage, Dimension, Effect, Parameter, Place, Response, amplitude};

/// See the module.
#[derive(Debug)]
pub struct LoadDependentFriction;

const PARAMETERS: &[Parameter] = &[amplitude("coefficient", Dimension::Ratio, false)];

impl Effect for LoadDependentFriction {
    fn name(&self) -> &'static str {
        "load_dependent_friction"
    }

    fn place(&self) -> Place {
        Place::Friction
    }

    fn parameters(&self) -> &'static [Parameter] {
        PARAMETERS
    }

    fn respond(&self, at: &At, p: &[f64], out: &mut Response) {
        out.value = p[0] * at.u.abs();
        out.u = p[0] * at.u.signum();
        out.p[0] = at.u.abs();
    }

    fn shapes(&self, _coverage: &Coverage) -> Vec<Vec<f64>> {
        vec![vec![0.0]]
    }

    fn bounds(&self, _index: usize, _coverage: &Coverage) -> (f64, f64) {
        (0.0, 0.95)
    }

    fn experiment(&self) -> &'static str {
        "repeat one motion with two loads"
    }
}
