//! The gap between a twin and measured motion: where they disagree, which effect is missing, and how much it
//! closes.
//!
//! Data flows `record` -> `model` -> `fit` -> `judge`: recordings become logs of one joint, a model predicts
//! them, a fit chooses its parameters, and a verdict says which effects may be named. `camera` does the same
//! by RGB-D frames.
//!
//! ```ignore
//! use gap::model::effects::catalogue;
//!
//! // Effects at a joint beside which no other joint was recorded.
//! let names: Vec<_> = catalogue(0).iter().map(|effect| effect.name()).collect();
//! assert!(names.contains(&"coulomb_friction") && names.contains(&"backlash"));
//! ```

pub mod camera;
pub mod fit;
pub mod judge;
pub mod model;
pub mod record;
pub mod trig;
pub mod twin_tree;
