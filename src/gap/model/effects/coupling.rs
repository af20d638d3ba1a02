//! A spring to another joint: `effort = e - k q + m q_other`; the coupling ratio is `m / k`.

use crate::model::effect::{
    At, Coverage, Dimension, Effect, Parameter, Place, Response, Spec, amplitude_parameter,
};

/// See the module.
#[derive(Debug)]
pub(super) struct Coupling {
    /// Index of the other joint in `At::others`.
    pub other: usize,
}

const PARAMETERS: &[Parameter] = &[
    amplitude_parameter("stiffness", Dimension::Stiffness, true),
    amplitude_parameter("other_stiffness", Dimension::Effort, true),
    amplitude_parameter("offset", Dimension::Effort, true),
];

const SPEC: Spec = Spec {
    name: "coupling",
    place: Place::Effort,
    parameters: PARAMETERS,
    contains: &["spring_return", "constant_bias"],
    experiment: "move the other joint while this one is free",
};

impl Effect for Coupling {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn write_response(&self, at: &At, p: &[f64], out: &mut Response) {
        let other = at.others.get(self.other).copied().unwrap_or(0.0);
        out.value = p[2] - p[0] * at.q + p[1] * other;
        out.q = -p[0];
        out.p[0] = -at.q;
        out.p[1] = other;
        out.p[2] = 1.0;
    }

    fn other_joint(&self) -> Option<usize> {
        Some(self.other)
    }

    fn start_shapes(&self, coverage: &Coverage) -> Vec<Vec<f64>> {
        if self.other < coverage.others { vec![vec![0.0; 3]] } else { Vec::new() }
    }
}
