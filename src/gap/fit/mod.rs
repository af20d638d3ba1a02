//! Models fitted to recorded motion by multiple shooting.

pub mod acting;
pub mod actuation;
pub mod damping;
#[cfg(test)]
mod derivative_tests;
pub mod evidence;
pub mod inverse;
pub mod jackknife;
pub mod likely_noise;
pub mod multibody;
pub mod noise;
pub mod problem;
pub mod rollout;
pub mod shooting;
pub mod smooth;
pub mod starts;
pub mod stretch;
pub mod whiten;
pub mod whitening;
