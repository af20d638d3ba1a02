//! The gap between a twin and measured motion: its places, the missing effects, and their share of it.
//!
//! Data flows `record` -> `model` -> `fit` -> `judge`: recordings become logs of one joint, a model predicts
//! them, a fit chooses its parameters, and a verdict names effects. `camera` does the same by RGB-D frames.
//!
//! ```
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
