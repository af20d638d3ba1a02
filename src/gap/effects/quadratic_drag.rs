//! Drag that grows with the square of the speed: `effort = -c v |v|`.

use crate::gap::effect::{At, Coverage, Dimension, Effect, Parameter, Place, Response, Spec, amplitude};

/// See the module.
#[derive(Debug)]
pub struct QuadraticDrag;

const PARAMETERS: &[Parameter] = &[amplitude("drag", Dimension::Drag, false)];

const SPEC: Spec = Spec {
    name: "quadratic_drag",
    place: Place::Effort,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "move at a top speed at least three times the usual one",
};

impl Effect for QuadraticDrag {
    fn spec(&self) -> &'static Spec {
        &SPEC
    }

    fn respond(&self, at: &At, p: &[f64], out: &mut Response) {
        out.value = -p[0] * at.v * at.v.abs();
        out.v = -2.0 * p[0] * at.v.abs();
        out.p[0] = -at.v * at.v.abs();
    }

    fn shapes(&self, _coverage: &Coverage) -> Vec<Vec<f64>> {
        vec![vec![0.0]]
    }
}
