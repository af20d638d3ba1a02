//! A recording as the pipeline reads it: frames of every state, and notes on how they were obtained.

use serde::{Deserialize, Serialize};

use super::{
    BoardInWorld, NoiseConfig, PoseFindings, RgbdFrame, TrackingFindings, Unread, features::PixelMatch,
};
use common::note::Note;

/// A recording: the frames of every state, with notes and warnings.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Capture {
    /// Name of the object, from the folder or file: `[A-Za-z][A-Za-z0-9_]*`.
    pub name: String,
    /// Frames per state, in time order.
    pub states: Vec<Vec<RgbdFrame>>,
    /// Pixel matches given with the data, if any.
    pub matches: Vec<PixelMatch>,
    /// Depth noise: the model of the settings, scaled to the recording's own noise unless the settings say
    /// otherwise.
    pub noise: NoiseConfig,
    /// Standard deviation of the errors that neighboring readings share, as a multiple of the noise: those of
    /// a stereo matcher, of the sensor's calibration, of camera poses (docs/method.md 2.9). Known once the
    /// object is isolated by depth; 0 with recorded masks.
    #[serde(default)]
    pub shared_error: f64,
    /// By state, how the camera was tracked; empty where the recording holds poses.
    #[serde(default)]
    pub tracking: Vec<TrackingFindings>,
    /// The tag board that defines the world. It is used before the first checkpoint.
    #[serde(skip)]
    pub board: Option<BoardInWorld>,
    /// Corrections of the camera poses.
    pub poses: PoseFindings,
    /// What pixels off the masks show without depth.
    #[serde(default)]
    pub unread: Unread,
    /// Box around the object in all states once it is isolated: lower and upper corner in the world, meters.
    #[serde(default)]
    pub object_box_m: Option<[[f64; 3]; 2]>,
    /// What is worse than expected: damage, drops, unused frames.
    pub warnings: Vec<Note>,
    /// What was chosen: topics, counts, frames.
    pub notes: Vec<Note>,
}

impl Capture {
    /// A recording of `count` states without frames.
    #[must_use]
    pub fn of_states(count: usize) -> Self {
        Self { states: vec![Vec::new(); count], ..Self::default() }
    }

    /// The frames of every state.
    #[must_use]
    pub fn frames(&self) -> Vec<&[RgbdFrame]> {
        self.states.iter().map(Vec::as_slice).collect()
    }
}

/// Largest number of states of a recording.
pub const MAX_STATES: usize = 16;
