//! A single push: `effort = D exp(-((t - t0) / w)^2 / 2)`. It occurs in one recording and is never exported.

use crate::model::effect::{
    At, Coverage, Dimension, Effect, Extent, Parameter, Place, RUN_SPACING_S, Response, Spec,
    amplitude_parameter, shape_parameter,
};

/// See the module.
#[derive(Debug)]
pub(super) struct Disturbance;

const PARAMETERS: &[Parameter] = &[
    amplitude_parameter("effort", Dimension::Effort, true),
    shape_parameter("time", Dimension::Time, true),
    shape_parameter("duration", Dimension::Time, false),
];

const SPEC: Spec = Spec {
    name: "disturbance",
    place: Place::Effort,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "record the same motion again: it does not come back",
};

/// Number of widths from the center beyond which the effort is negligible.
/// chosen: 3.7e-6 of the maximum.
const REACH: f64 = 5.0;
/// Searched widths of pushes, and the spacing of their start times, seconds.
/// chosen: start times are less than two widths apart, so a push between two of them is still visible.
const PUSHES_S: [(f64, f64); 2] = [(0.06, 0.1), (0.2, 0.25)];
/// Least and largest width of a push, seconds.
/// chosen: a few samples, and longer than any push.
const WIDTHS_S: [f64; 2] = [0.01, 1.0];

impl Effect for Disturbance {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        let x = (at.t - p[1]) / p[2];
        if x.abs() > REACH {
            return;
        }
        let bump = (-0.5 * x * x).exp();
        out.value = p[0] * bump;
        out.p[0] = bump;
        out.p[1] = p[0] * bump * x / p[2];
        out.p[2] = p[0] * bump * x * x / p[2];
    }

    fn start_shapes(&self, coverage: &Coverage) -> Vec<Vec<f64>> {
        let mut shapes = Vec::new();
        for (run, duration_s) in coverage.durations_s.iter().enumerate() {
            for (width_s, step_s) in PUSHES_S {
                let count = (duration_s / step_s) as usize;
                shapes.extend(
                    (0..count)
                        .map(|i| vec![0.0, RUN_SPACING_S * run as f64 + (i as f64 + 0.5) * step_s, width_s]),
                );
            }
        }
        shapes
    }

    fn reaches_extent(&self, shape: &[f64], extent: &Extent) -> bool {
        Extent::meets_interval(extent.time_s, shape[1], REACH * shape[2])
    }

    fn parameter_bounds(&self, index: usize, _coverage: &Coverage) -> (f64, f64) {
        if index == 2 { (WIDTHS_S[0], WIDTHS_S[1]) } else { (-1e9, 1e9) }
    }

    fn is_of_one_run(&self) -> bool {
        true
    }
}
