//! A ripple over the position: `effort = s sin(n q) + c cos(n q)`.

use crate::{
    model::effect::{
        At, Coverage, Dimension, Effect, Parameter, Place, Response, Spec, amplitude_parameter,
        shape_parameter,
    },
    trig::sin_cos,
};

/// Least and largest number of periods over the range in a fit.
/// chosen: a little beyond the searched ones, two to a hundred.
const PERIODS: [f64; 2] = [1.5, 110.0];

/// See the module.
#[derive(Debug)]
pub(super) struct Cogging;

const PARAMETERS: &[Parameter] = &[
    amplitude_parameter("sine", Dimension::Effort, true),
    amplitude_parameter("cosine", Dimension::Effort, true),
    shape_parameter("wave_number", Dimension::WaveNumber, false),
];

const SPEC: Spec = Spec {
    name: "cogging",
    place: Place::Effort,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "sweep slowly over three periods or more",
};

impl Effect for Cogging {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn is_of_position(&self) -> bool {
        true
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        let (s, c) = sin_cos(p[2] * at.q);
        let slope = p[0] * c - p[1] * s;
        out.value = p[0] * s + p[1] * c;
        out.q = p[2] * slope;
        out.p[0] = s;
        out.p[1] = c;
        out.p[2] = at.q * slope;
    }

    fn start_shapes(&self, coverage: &Coverage) -> Vec<Vec<f64>> {
        let range = coverage.position.1 - coverage.position.0;
        // From two to a hundred periods over the range (a runaway widens it), a third of a period apart.
        (0..295).map(|i| vec![0.0, 0.0, (2.0 + f64::from(i) / 3.0) * std::f64::consts::TAU / range]).collect()
    }

    fn parameter_bounds(&self, index: usize, coverage: &Coverage) -> (f64, f64) {
        let turn = std::f64::consts::TAU / (coverage.position.1 - coverage.position.0);
        if index == 2 { (PERIODS[0] * turn, PERIODS[1] * turn) } else { (-1e9, 1e9) }
    }
}
