//! Friction around one position: `|friction| <= F exp(-((q - c) / w)^2)`.

use crate::model::{
    bump::{bump_bounds, bump_meets, bump_parameters, bump_starts},
    effect::{At, Coverage, Effect, Extent, Parameter, Place, Response, Spec},
};

/// See the module.
#[derive(Debug)]
pub(super) struct LocalFriction;

const PARAMETERS: &[Parameter] = &bump_parameters("friction");

const SPEC: Spec = Spec {
    name: "local_friction",
    place: Place::Friction,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "cross the place slowly, both ways, three times",
};

/// Number of widths from the center beyond which the friction is negligible.
/// chosen: 1.6e-9 of the maximum.
const REACH: f64 = 4.5;

impl Effect for LocalFriction {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        let x = (at.q - p[1]) / p[2];
        if x.abs() > REACH {
            return;
        }
        let bump = (-x * x).exp();
        out.value = p[0] * bump;
        out.q = -2.0 * p[0] * bump * x / p[2];
        out.p[0] = bump;
        out.p[1] = -out.q;
        out.p[2] = 2.0 * p[0] * bump * x * x / p[2];
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
