//! Adam updates of the half motions.

use serde::{Deserialize, Serialize};

use super::half_motion::{COORDINATES, HalfMotion, PoseGradient};
use crate::simd::{AdamStep, InstructionSet};

/// Decay of the moments, for fields and motions (Liu, Mahdavi-Amiri and Savva 2023).
/// derived: the published ones
pub(super) const BETAS: (f32, f32) = (0.9, 0.99);

/// The mobile parts' half motions with Adam's moments.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct MotionState {
    /// One per mobile part.
    pub motions: Vec<HalfMotion>,
    first: Vec<f32>,
    second: Vec<f32>,
    steps: u64,
}

impl MotionState {
    /// Starts with zero moments.
    pub(super) fn new(motions: Vec<HalfMotion>) -> Self {
        let n = COORDINATES * motions.len();
        Self { motions, first: vec![0.0; n], second: vec![0.0; n], steps: 0 }
    }

    /// Whether moments and motions agree in number.
    pub(super) fn is_consistent(&self) -> bool {
        let n = COORDINATES * self.motions.len();
        self.first.len() == n && self.second.len() == n
    }

    /// One step along a gradient; `scale` is a factor on the published rates.
    pub(super) fn step_down(&mut self, isa: InstructionSet, by_pose: &[PoseGradient], scale: f64) {
        self.steps += 1;
        let pairs = self.motions.iter().zip(by_pose);
        let mut gradient: Vec<f32> =
            pairs.flat_map(|(m, g)| m.coordinate_gradient(g).map(|x| x as f32)).collect();
        // Applied to zeros, the kernel gives the change at rate 1; each coordinate then scales it.
        let mut change = vec![0.0; gradient.len()];
        let adam = AdamStep::with_betas(1.0, self.steps, BETAS);
        isa.adam(adam, &mut change, &mut self.first, &mut self.second, &mut gradient);
        for (motion, change) in self.motions.iter_mut().zip(change.chunks_exact(COORDINATES)) {
            let rates = motion.coordinate_rates();
            *motion = motion.stepped_by(&std::array::from_fn(|k| scale * rates[k] * f64::from(change[k])));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn the_first_step_is_one_rate_down_the_gradient() {
        let mut state = MotionState::new(vec![HalfMotion::free_start(), HalfMotion::prismatic_start()]);
        let up = PoseGradient { torque: Vector3::zeros(), force: Vector3::new(2.0, 0.5, 0.1) };
        state.step_down(InstructionSet::detect(), &[up, up], 0.5);
        let t = state.motions[0].pose().translation.vector;
        assert!((t - Vector3::repeat(0.001 - 0.0005)).norm() < 1e-9, "{t}");
        let HalfMotion::Prismatic { distance, .. } = state.motions[1] else { panic!("another kind") };
        assert!((distance - (0.1 - 0.0025)).abs() < 1e-8, "{distance}");
    }
}
