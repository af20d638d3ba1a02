//! Compares a twin with RGB-D frames of further states: kinematic and camera effects.
//!
//! The twin is posed and rendered into every frame; the residual is the measured minus the predicted depth,
//! taken across the surface. A mixed model (`fit::mixed`) weighs effects against unnamed errors: of the
//! camera's pose in a frame, of the twin's surface, of a patch in a frame. Conflicting readings are searched
//! for another joint type and for missing geometry.

pub mod effects;
pub mod fit;
pub mod judge;
pub mod model;
pub mod record;
