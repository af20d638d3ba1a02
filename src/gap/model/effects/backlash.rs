//! Play between the joint and what measures it: the recorded position follows within half a gap either side.

use crate::model::effect::{Coverage, Dimension, Effect, Parameter, Place, Spec, amplitude};

/// See the module.
#[derive(Debug)]
pub struct Backlash;

const PARAMETERS: &[Parameter] = &[amplitude("half_gap", Dimension::Position, false)];

const SPEC: Spec = Spec {
    name: "backlash",
    place: Place::Play,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "reverse often with sensors on both sides of the gear",
};

impl Effect for Backlash {
    fn spec(&self) -> &'static Spec {
        &SPEC
    }

    fn shapes(&self, coverage: &Coverage) -> Vec<Vec<f64>> {
        let range = coverage.position.1 - coverage.position.0;
        // A gap within the noise cannot be seen, and one of much of the range leaves no motion to
        // explain.
        let fit = |g: &f64| *g > 0.7 * coverage.position_noise && *g < 0.15 * range;
        (0..14).map(|i| 3e-4 * range * 1.6f64.powi(i)).filter(fit).map(|g| vec![g]).collect()
    }

    fn bounds(&self, _index: usize, coverage: &Coverage) -> (f64, f64) {
        (0.0, 0.3 * (coverage.position.1 - coverage.position.0))
    }
}
