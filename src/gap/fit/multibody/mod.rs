//! Joints of a chain moving together, in one rollout: one joint's missing friction moves the others too.
//! See docs/method.md (14.7).

pub mod dynamics;
pub mod joints;
pub mod normal;
pub mod shooting;
#[cfg(test)]
mod tests;
