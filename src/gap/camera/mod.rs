//! A twin against RGB-D frames of further states: kinematic and camera effects.
//!
//! The twin is posed and rendered into every frame; the residual is measured less predicted depth, across the surface. A
//! mixed model (`mixed`) weighs effects against errors that have no name: of the camera's pose in a frame, of the twin's
//! surface, of a cell of pixels. What does not match at all is looked at for another type of joint and for geometry that
//! the twin lacks.

pub mod assess;
pub mod cells;
pub mod effects;
pub mod fit;
pub mod frames;
pub mod kinds;
pub mod missing;
pub mod mixed;
pub mod own_error;
pub mod parameter;
pub mod placement;
pub mod proof;
pub mod report;
pub mod residual;
pub mod select;
pub mod tree;
pub mod trial;
pub mod twin;
pub mod update;
