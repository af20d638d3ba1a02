//! A twin against RGB-D frames of further states: kinematic and camera effects.
//!
//! The twin is posed and rendered into every frame; the residual is measured less predicted depth, across the
//! surface. A mixed model (`fit::mixed`) weighs effects against errors without names: of the camera's pose in
//! a frame, of the twin's surface, of a patch in a frame. Conflicting readings are searched for another type
//! of joint and for missing geometry.

pub mod effects;
pub mod fit;
pub mod judge;
pub mod model;
pub mod record;
