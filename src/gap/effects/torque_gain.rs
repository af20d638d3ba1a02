//! The effort that acts is `g` times the recorded one.

use crate::gap::effect::{Coverage, Dimension, Effect, Parameter, Place};

/// See the module.
#[derive(Debug)]
pub struct TorqueGain;

const PARAMETERS: &[Parameter] = &[Parameter { name: "gain", dimension: Dimension::Ratio, neutral: Some(1.0), signed: false }];

impl Effect for TorqueGain {
    fn name(&self) -> &'static str {
        "torque_gain"
    }

    fn place(&self) -> Place {
        Place::Gain
    }

    fn parameters(&self) -> &'static [Parameter] {
        PARAMETERS
    }

    fn shapes(&self, _coverage: &Coverage) -> Vec<Vec<f64>> {
        vec![vec![1.0]]
    }

    fn bounds(&self, _index: usize, _coverage: &Coverage) -> (f64, f64) {
        (0.05, 20.0)
    }

    fn experiment(&self) -> &'static str {
        "hang a known weight on it, or move between two measured positions"
    }
}
