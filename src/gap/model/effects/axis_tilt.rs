//! Gravity load missing in the twin, from a tilted axis or another center of mass:
//! `effort = s sin(q) + c cos(q)`.

use crate::model::format::{Expression, Format, JointNumbers, NearestEffect};
use crate::model::plant::Plant;
use crate::{
    model::effect::{At, Coverage, Dimension, Effect, Parameter, Place, Response, Spec, amplitude_parameter},
    trig::sin_cos,
};

/// See the module.
#[derive(Debug)]
pub(super) struct AxisTilt;

const PARAMETERS: &[Parameter] = &[
    amplitude_parameter("sine", Dimension::Effort, true),
    amplitude_parameter("cosine", Dimension::Effort, true),
];

const SPEC: Spec = Spec {
    name: "axis_tilt",
    place: Place::Effort,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "turn through 90 degrees or more, at rest in several positions",
};

/// Largest load, as a share of that with a horizontal axis, for which a tilt is computed.
/// chosen: at the full load the derivative with respect to the tilt is zero, and rounding hides the tilt.
const FLAT: f64 = 1.0 - 1e-6;

impl Effect for AxisTilt {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn is_of_position(&self) -> bool {
        true
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        let (s, c) = sin_cos(at.q);
        out.value = p[0] * s + p[1] * c;
        out.q = p[0] * c - p[1] * s;
        out.p[0] = s;
        out.p[1] = c;
    }

    fn start_shapes(&self, coverage: &Coverage) -> Vec<Vec<f64>> {
        // On a sliding joint gravity is a constant; in a chain a tilt is not one joint's own.
        if coverage.turns && !coverage.in_chain { vec![vec![0.0, 0.0]] } else { Vec::new() }
    }

    fn in_format(&self, format: Format, p: &[f64], plant: &Plant) -> Expression {
        let wanted = [plant.load.sine - p[0], plant.load.cosine - p[1]];
        let amplitude = wanted[0].hypot(wanted[1]);
        match format {
            // A URDF would have to move every frame below the joint.
            Format::Urdf => Expression::NotExpressible,
            _ if amplitude <= plant.most_load => Expression::Native,
            // No tilt of a joint gives more load than a horizontal axis.
            _ => {
                let share = FLAT * plant.most_load / amplitude;
                let nearest =
                    vec![plant.load.sine - share * wanted[0], plant.load.cosine - share * wanted[1]];
                Expression::Approximated(vec![NearestEffect::same_effect(nearest)])
            }
        }
    }

    fn add_to_numbers(&self, p: &[f64], joint: &mut JointNumbers) {
        joint.tilt = Some([p[0], p[1]]);
    }
}
