//! A soft stop: beyond `l` the joint is pushed back by `k` times the penetration, `c` times the speed, and a
//! share of the other efforts into the stop, but never pulled. This share represents a rigid stop behind the
//! soft one: under a steady effort the joint penetrates less than with `k` alone.

use crate::model::effect::{
    At, Coverage, Dimension, Effect, Parameter, Place, Response, Spec, amplitude_parameter, shape_parameter,
};
use crate::model::format::{Expression, Format, JointNumbers, NearestEffect, Stop};
use crate::model::plant::Plant;

/// See the module.
#[derive(Debug)]
pub struct EndStop {
    /// Whether it is at the upper end of the range.
    pub upper: bool,
}

const PARAMETERS: &[Parameter] = &[
    amplitude_parameter("stiffness", Dimension::Stiffness, false),
    amplitude_parameter("contact_damping", Dimension::Damping, false),
    shape_parameter("position", Dimension::Position, true),
    shape_parameter("impedance", Dimension::Ratio, false),
];

const SPEC: Spec = Spec {
    name: "end_stop",
    place: Place::Contact,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "touch the stop twice or more, slowly and fast",
};

/// Rate of a rigid stop, 1/s: the fastest one resolved by the steps of a rollout.
/// derived: one over a step of 5 ms.
const STIFF_RATE: f64 = 200.0;
/// Largest share of the other efforts absorbed by a stop.
/// derived: MuJoCo's largest impedance (mjMAXIMP).
pub const MAX_IMPEDANCE: f64 = 0.9999;
/// Depths inside the covered range where a contact is searched, as shares of the range.
/// chosen: a fit can bridge the spacing.
const DEPTHS: [f64; 9] = [0.003, 0.008, 0.015, 0.03, 0.05, 0.08, 0.12, 0.17, 0.23];
/// Rates, 1/s, and impedances of further starts of a fit: the cost has several minima over them, and a fit
/// ends in the one near its start.
/// chosen: from a soft stop to one of half [`STIFF_RATE`].
const RESTARTS: [(f64, f64); 5] = [(12.0, 0.0), (35.0, 0.0), (90.0, 0.0), (35.0, 0.9), (90.0, 0.9)];
/// Damping of such a start, divided by inertia and rate.
/// chosen: a damping ratio of 0.2, far from both no rebound and no loss.
const DAMPING: f64 = 0.4;

impl Effect for EndStop {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        let side = if self.upper { 1.0 } else { -1.0 };
        let depth = side * (at.q - p[2]);
        if depth <= 0.0 {
            return;
        }
        let push = p[0] * depth + p[1] * side * at.v + p[3] * side * at.load;
        // The contact's damping would hold back a leaving joint; a stop never pulls.
        if push < 0.0 {
            return;
        }
        out.value = -side * push;
        out.q = -p[0];
        out.v = -p[1];
        out.p[0] = -side * depth;
        out.p[1] = -at.v;
        out.p[2] = p[0];
        out.p[3] = -at.load;
        out.load = -p[3];
    }

    fn start_shapes(&self, coverage: &Coverage) -> Vec<Vec<f64>> {
        let (low, high) = coverage.position;
        let range = high - low;
        // A soft stop is penetrated, so the contact begins inside the covered range.
        let (edge, inward) = if self.upper { (high, -1.0) } else { (low, 1.0) };
        DEPTHS.iter().map(|f| vec![0.0, 0.0, edge + inward * f * range, 0.0]).collect()
    }

    fn parameter_bounds(&self, index: usize, coverage: &Coverage) -> (f64, f64) {
        // At most the stiffest stop resolved by the rollout's step, critically damped.
        match index {
            0 => (0.0, coverage.inertia * STIFF_RATE * STIFF_RATE),
            1 => (0.0, coverage.inertia * 2.0 * STIFF_RATE),
            3 => (0.0, MAX_IMPEDANCE),
            _ => (coverage.position.0, coverage.position.1),
        }
    }

    fn restart_points(&self, p: &[f64], coverage: &Coverage) -> Vec<Vec<f64>> {
        let mut starts = Vec::with_capacity(RESTARTS.len());
        for (rate, impedance) in RESTARTS {
            let stiffness = coverage.inertia * rate * rate;
            starts.push(vec![stiffness, DAMPING * coverage.inertia * rate, p[2], impedance]);
        }
        starts
    }

    fn is_upper(&self) -> bool {
        self.upper
    }

    fn contact_parameter(&self) -> Option<usize> {
        Some(2)
    }

    fn in_format(&self, format: Format, p: &[f64], plant: &Plant) -> Expression {
        match format {
            Format::Mjcf => Expression::Native,
            // Without the share of a rigid stop behind the soft one.
            Format::Sdf => {
                Expression::Approximated(vec![NearestEffect::same_effect(vec![p[0], p[1], p[2], 0.0])])
            }
            // A limit, as stiff as the rollout can resolve.
            Format::Usd => {
                let stiffness = plant.inertia * STIFF_RATE * STIFF_RATE;
                let damping = plant.inertia * STIFF_RATE;
                Expression::Approximated(vec![NearestEffect::same_effect(vec![
                    stiffness, damping, p[2], 0.0,
                ])])
            }
            Format::Urdf => Expression::NotExpressible,
        }
    }

    fn add_to_numbers(&self, p: &[f64], joint: &mut JointNumbers) {
        joint.stops.push(Stop {
            is_upper: self.upper,
            position: p[2],
            stiffness: p[0],
            damping: p[1],
            impedance: p[3],
        });
    }
}
