//! Stage 2 of the neural method: segmentation fields and motions are refined until the states agree.

pub(crate) mod adam;
pub(crate) mod collision;
pub(crate) mod config;
pub(crate) mod consistency;
pub(crate) mod dense_kernel;
pub(crate) mod feature_grid;
#[cfg(test)]
pub mod gradient_tests;
pub(crate) mod label_fit;
pub(crate) mod loss_term;
pub(crate) mod matching_loss;
pub(crate) mod motion_params;
pub(crate) mod objective;
pub(crate) mod occupancy;
pub(crate) mod optimise;
pub(crate) mod ray_batch;
#[cfg(test)]
pub mod recovery_tests;
pub(crate) mod segmentation;
pub(crate) mod state_model;
#[cfg(test)]
pub mod test_scene;
pub(crate) mod trainer_error;
pub(crate) mod trainer_input;
pub(crate) mod uniform_batch;
