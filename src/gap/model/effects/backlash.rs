//! Play between the joint and its sensor: the recorded position follows within half the gap on either side.

use crate::model::effect::{Coverage, Dimension, Effect, Parameter, Place, Spec, amplitude_parameter};

/// Least gap in standard deviations of the position noise: a smaller one is not visible.
/// chosen: many reversals reveal a little less than one deviation.
const LEAST_NOISES: f64 = 0.7;
/// Largest searched gap, as a share of the range.
/// chosen: a larger one would leave no motion to explain.
const LARGEST: f64 = 0.15;
/// Smallest searched gap, as a share of the range, and the ratio of neighboring gaps.
/// chosen: below the step of any encoder, with a ratio fine enough for a fit to bridge.
const FIRST: f64 = 3e-4;
const RATIO: f64 = 1.6;
/// Largest gap of a fit, as a share of the range.
/// chosen: twice [`LARGEST`].
const BOUND: f64 = 0.3;

/// See the module.
#[derive(Debug)]
pub(super) struct Backlash;

const PARAMETERS: &[Parameter] = &[amplitude_parameter("half_gap", Dimension::Position, false)];

const SPEC: Spec = Spec {
    name: "backlash",
    place: Place::Play,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "reverse often with sensors on both sides of the gear",
};

impl Effect for Backlash {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn start_shapes(&self, coverage: &Coverage) -> Vec<Vec<f64>> {
        let range = coverage.position.1 - coverage.position.0;
        let gaps = (0..14).map(|i| FIRST * range * RATIO.powi(i));
        gaps.filter(|g| *g > LEAST_NOISES * coverage.position_noise && *g < LARGEST * range)
            .map(|g| vec![g])
            .collect()
    }

    fn parameter_bounds(&self, _index: usize, coverage: &Coverage) -> (f64, f64) {
        (0.0, BOUND * (coverage.position.1 - coverage.position.0))
    }
}
