//! The recorded position is `s` times the true one.

use crate::gap::effect::{Coverage, Dimension, Effect, Parameter, Place};

/// See the module.
#[derive(Debug)]
pub struct EncoderScale;

const PARAMETERS: &[Parameter] = &[Parameter { name: "scale", dimension: Dimension::Ratio, neutral: Some(1.0), signed: false }];

impl Effect for EncoderScale {
    fn name(&self) -> &'static str {
        "encoder_scale"
    }

    fn place(&self) -> Place {
        Place::Scale
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
        "move between two measured positions, or hang a known weight on it"
    }
}
