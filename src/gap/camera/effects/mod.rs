//! The catalogue of effects visible to a camera. To add one, write its file and add a line here.

mod axis_offset;
mod axis_play;
mod camera_extrinsic_offset;
mod camera_time_offset;
mod depth_bias;
mod depth_scale;
mod encoder_bias;
mod encoder_scale;
pub mod screw_pitch;
mod second_dof;

use super::{
    model::{
        scales::Scales,
        trial::{CameraEffect, Trial},
        twin::SeenTwin,
    },
    record::frames::FrameRun,
};

/// All effects with smooth parameters. Two more are found by search: another joint type
/// (`judge::other_types`) and missing geometry (`judge::missing_geometry`).
pub const CATALOGUE: [CameraEffect; 10] = [
    depth_scale::EFFECT,
    depth_bias::EFFECT,
    camera_extrinsic_offset::EFFECT,
    camera_time_offset::EFFECT,
    axis_offset::EFFECT,
    screw_pitch::EFFECT,
    axis_play::EFFECT,
    second_dof::EFFECT,
    encoder_scale::EFFECT,
    encoder_bias::EFFECT,
];

/// All trials of the catalogue's effects.
pub fn all_trials(twin: &SeenTwin, runs: &[FrameRun], scales: &Scales) -> Vec<Trial> {
    let mut all = Vec::new();
    for (effect, spec) in CATALOGUE.iter().enumerate() {
        for (joint, columns) in (spec.trials)(twin, runs, scales) {
            all.push(Trial { effect, name: spec.name, joint, columns, log_odds: spec.log_odds });
        }
    }
    all
}
