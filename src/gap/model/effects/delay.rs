//! The effort acts, or the position is recorded, later than stamped.

use crate::model::effect::{Coverage, Dimension, Effect, Parameter, Place, Spec, amplitude_parameter};
use crate::model::format::{Expression, Format, JointNumbers};
use crate::model::plant::Plant;

/// Searched delays, in sample intervals.
/// chosen: a fit can bridge the spacing.
const DELAYS: [f64; 10] = [0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 11.0, 15.0, 20.0];
/// Largest delay in a fit, in sample intervals.
/// chosen: three times the largest searched one.
const LARGEST: f64 = 60.0;

/// See the module.
#[derive(Debug)]
pub(super) struct Delay;

const PARAMETERS: &[Parameter] = &[amplitude_parameter("delay", Dimension::Time, true)];

const SPEC: Spec = Spec {
    name: "delay",
    place: Place::Delay,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "step the effort sharply, and tap the part beside a second synchronized sensor",
};

impl Effect for Delay {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn start_shapes(&self, coverage: &Coverage) -> Vec<Vec<f64>> {
        DELAYS.iter().map(|n| vec![n * coverage.interval_s]).collect()
    }

    fn parameter_bounds(&self, _index: usize, coverage: &Coverage) -> (f64, f64) {
        // Slightly negative values are allowed: efforts may be stamped after they act.
        (-2.0 * coverage.interval_s, LARGEST * coverage.interval_s)
    }

    fn in_format(&self, format: Format, p: &[f64], _plant: &Plant) -> Expression {
        // A simulator cannot act before the command.
        Expression::native_if(format == Format::Mjcf && p[0] >= 0.0)
    }

    fn add_to_numbers(&self, p: &[f64], joint: &mut JointNumbers) {
        joint.delay_s += p[0];
    }
}
