//! An inertia in addition to the twin's.

use crate::model::effect::{Coverage, Dimension, Effect, Parameter, Place, Spec, amplitude_parameter};
use crate::model::format::{Expression, Format, JointNumbers};
use crate::model::plant::Plant;

/// Largest reduction of the twin's inertia, as a share.
/// chosen: a tenth remains; without inertia there is no motion to integrate.
const MOST_TAKEN: f64 = 0.9;

/// See the module.
#[derive(Debug)]
pub(super) struct Inertia;

const PARAMETERS: &[Parameter] = &[amplitude_parameter("added_inertia", Dimension::Inertia, true)];

const SPEC: Spec = Spec {
    name: "inertia",
    place: Place::Inertia,
    parameters: PARAMETERS,
    contains: &[],
    experiment: "shake it fast with a known effort",
};

impl Effect for Inertia {
    fn effect_spec(&self) -> &'static Spec {
        &SPEC
    }

    fn parameter_bounds(&self, _index: usize, coverage: &Coverage) -> (f64, f64) {
        (-MOST_TAKEN * coverage.inertia, 1e9)
    }

    fn in_twin(&self, _index: usize, plant: &Plant) -> f64 {
        plant.inertia
    }

    fn in_format(&self, format: Format, p: &[f64], _plant: &Plant) -> Expression {
        // An armature can only be positive.
        match format {
            Format::Mjcf => Expression::native_if(p[0] >= 0.0),
            Format::Usd => Expression::native_if(p[0] > 0.0),
            Format::Urdf | Format::Sdf => Expression::NotExpressible,
        }
    }

    fn add_to_numbers(&self, p: &[f64], joint: &mut JointNumbers) {
        joint.armature += p[0];
    }
}
