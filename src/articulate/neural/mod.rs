//! Stage 2 of the neural method: segmentation fields and motions, refined until the states agree.

pub mod adam;
pub mod collision;
pub mod config;
pub mod consistency;
pub mod dense_kernel;
pub mod feature_grid;
#[cfg(test)]
pub mod gradient_tests;
pub mod label_fit;
pub mod loss_term;
pub mod matching_loss;
pub mod motion_params;
pub mod objective;
pub mod occupancy;
pub mod optimise;
pub mod ray_batch;
#[cfg(test)]
pub mod recovery_tests;
pub mod segmentation;
pub mod state_model;
#[cfg(test)]
pub mod test_scene;
pub mod trainer_error;
pub mod trainer_input;
pub mod uniform_batch;
