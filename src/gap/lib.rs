//! The gap between a twin and measured motion: where it occurs, its causes, and how much each explains.
//!
//! Data flows `record` -> `model` -> `fit` -> `judge`: recordings become logs of single joints, a model
//! predicts them, a fit determines its parameters, and a verdict names effects. `camera` does the same for
//! RGB-D frames.
//!
//! ```
//! use gap::model::effects::catalogue;
//!
//! // Effects for a joint recorded without other joints.
//! let names: Vec<_> = catalogue(0).iter().map(|effect| effect.name()).collect();
//! assert!(names.contains(&"coulomb_friction") && names.contains(&"backlash"));
//! ```

pub mod camera;
pub mod fit;
pub mod judge;
pub mod model;
pub mod record;
pub mod track;
pub mod trig;
pub mod twin_tree;
pub mod wander;
