//! A catch at one position: `effort = -A x exp((1 - x^2) / 2)` with `x = (q - c) / w`; its maximum is one
//! width from the center.

use crate::model::{
    bump::{bump_bounds, bump_meets, bump_parameters, bump_starts},
    effect::{At, Coverage, Effect, Extent, Parameter, Place, Response, Spec},
};

/// See the module.
#[derive(Debug)]
pub(super) struct Detent;

const PARAMETERS: &[Parameter] = &bump_parameters("effort");

const SPEC: Spec = Spec {
    name: "detent",
    place: Place::Effort,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "cross the place slowly, both ways, three times",
};

/// Number of widths from the center beyond which the effort is negligible.
/// chosen: 1.5e-7 of the maximum.
const REACH: f64 = 6.0;

impl Effect for Detent {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn is_of_position(&self) -> bool {
        true
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        let x = (at.q - p[1]) / p[2];
        if x.abs() > REACH {
            return;
        }
        let bump = (0.5 * (1.0 - x * x)).exp();
        out.value = -p[0] * x * bump;
        out.q = -p[0] * (1.0 - x * x) * bump / p[2];
        out.p[0] = -x * bump;
        out.p[1] = -out.q;
        out.p[2] = p[0] * x * (1.0 - x * x) * bump / p[2];
    }

    fn start_shapes(&self, coverage: &Coverage) -> Vec<Vec<f64>> {
        bump_starts(coverage)
    }

    fn reaches_extent(&self, shape: &[f64], extent: &Extent) -> bool {
        bump_meets(extent, shape, REACH)
    }

    fn parameter_bounds(&self, index: usize, coverage: &Coverage) -> (f64, f64) {
        bump_bounds(index, coverage)
    }
}
