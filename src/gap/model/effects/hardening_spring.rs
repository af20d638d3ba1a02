//! A hardening spring: `effort = -k x - h x^3` with `x = q - r`.

use crate::model::effect::{
    At, Coverage, Dimension, Effect, Parameter, Place, Response, Spec, amplitude_parameter, shape_parameter,
};
use crate::model::format::{Expression, Format, JointNumbers, NearestEffect, Spring};
use crate::model::plant::Plant;

/// See the module.
#[derive(Debug)]
pub(super) struct HardeningSpring;

const PARAMETERS: &[Parameter] = &[
    amplitude_parameter("stiffness", Dimension::Stiffness, false),
    amplitude_parameter("hardening", Dimension::CubicStiffness, false),
    shape_parameter("rest_position", Dimension::Position, true),
];

const SPEC: Spec = Spec {
    name: "hardening_spring",
    place: Place::Effort,
    parameters: PARAMETERS,
    contains: &["spring_return", "constant_bias"],
    experiment: "let it go from several positions over the whole range",
};

impl Effect for HardeningSpring {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn is_of_position(&self) -> bool {
        true
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        let x = at.q - p[2];
        out.value = -p[0] * x - p[1] * x * x * x;
        out.q = -p[0] - 3.0 * p[1] * x * x;
        out.p[0] = -x;
        out.p[1] = -x * x * x;
        out.p[2] = -out.q;
    }

    fn start_shapes(&self, coverage: &Coverage) -> Vec<Vec<f64>> {
        let (low, high) = coverage.position;
        // A spring may pull in one direction over the whole range: its rest position may be outside, by up to
        // a quarter of the range.
        (0..7).map(|i| vec![0.0, 0.0, low + (high - low) * (f64::from(i) - 1.0) / 4.0]).collect()
    }

    fn parameter_bounds(&self, index: usize, coverage: &Coverage) -> (f64, f64) {
        let (low, high) = coverage.position;
        let range = high - low;
        if index == 2 { (low - range, high + range) } else { (0.0, 1e9) }
    }

    fn in_format(&self, format: Format, p: &[f64], _plant: &Plant) -> Expression {
        match format {
            Format::Mjcf => Expression::Native,
            Format::Sdf | Format::Usd if p[0] > 0.0 => {
                Expression::Approximated(vec![NearestEffect::other_effect(
                    "spring_return",
                    vec![p[0], p[0] * p[2]],
                )])
            }
            _ => Expression::NotExpressible,
        }
    }

    fn add_to_numbers(&self, p: &[f64], joint: &mut JointNumbers) {
        joint.spring = Some(Spring { stiffness: p[0], cubic: p[1], rest: p[2] });
    }
}
