//! Friction falling with speed from breakaway to sliding friction: `F + D exp(-(v / s)^2)`.

use crate::model::effect::{
    At, Coverage, Dimension, Effect, Parameter, Place, Response, Spec, amplitude_parameter, shape_parameter,
};
use crate::model::format::{Expression, Format, JointNumbers, NearestEffect};
use crate::model::plant::Plant;

/// See the module.
#[derive(Debug)]
pub(super) struct StribeckFriction;

const PARAMETERS: &[Parameter] = &[
    amplitude_parameter("friction", Dimension::Effort, false),
    amplitude_parameter("breakaway_excess", Dimension::Effort, false),
    shape_parameter("stribeck_velocity", Dimension::Velocity, false),
];

const SPEC: Spec = Spec {
    name: "stribeck_friction",
    place: Place::Friction,
    parameters: PARAMETERS,
    contains: &["coulomb_friction"],
    experiment: "pull slowly until it breaks loose, several times, then slide at two speeds",
};

/// Stribeck velocity of a breakaway ending as soon as the joint slides, rad/s or m/s.
/// chosen: below the resolution of any rollout.
const AT_ONCE: f64 = 1e-9;
/// Searched Stribeck velocities, as shares of the top speed.
/// chosen: a fit can bridge the spacing.
const SPEEDS: [f64; 4] = [0.01, 0.03, 0.08, 0.2];
/// Least Stribeck velocity in a fit, as a share of the top speed.
/// chosen: a smaller one is passed within one sample.
const LEAST_SPEED: f64 = 0.002;

impl Effect for StribeckFriction {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        let x = at.v / p[2];
        let bump = (-x * x).exp();
        out.value = p[0] + p[1] * bump;
        out.v = -2.0 * p[1] * bump * x / p[2];
        out.p[0] = 1.0;
        out.p[1] = bump;
        out.p[2] = 2.0 * p[1] * bump * x * x / p[2];
    }

    fn start_shapes(&self, coverage: &Coverage) -> Vec<Vec<f64>> {
        SPEEDS.iter().map(|f| vec![0.0, 0.0, f * coverage.speed.1]).collect()
    }

    fn parameter_bounds(&self, index: usize, coverage: &Coverage) -> (f64, f64) {
        if index == 2 { (LEAST_SPEED * coverage.speed.1, 0.5 * coverage.speed.1) } else { (0.0, 1e9) }
    }

    fn friction_fall(&self, p: &[f64]) -> f64 {
        p[1]
    }

    fn in_twin(&self, index: usize, plant: &Plant) -> f64 {
        if index == 0 { plant.friction } else { 0.0 }
    }

    fn in_format(&self, format: Format, p: &[f64], _plant: &Plant) -> Expression {
        match format {
            Format::Urdf => Expression::NotExpressible,
            // PhysX has a breakaway as well, ending as soon as the joint slides.
            Format::Usd => {
                Expression::Approximated(vec![NearestEffect::same_effect(vec![p[0], p[1], AT_ONCE])])
            }
            _ => Expression::Approximated(vec![NearestEffect::other_effect("coulomb_friction", vec![p[0]])]),
        }
    }

    fn add_to_numbers(&self, p: &[f64], joint: &mut JointNumbers) {
        joint.friction += p[0];
        joint.breakaway_excess += p[1];
    }
}
