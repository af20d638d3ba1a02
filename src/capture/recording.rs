//! A recording for the pipeline: frames of every state, and findings on the way.

use serde::{Deserialize, Serialize};

use super::{BoardInWorld, NoiseConfig, PoseFindings, RgbdFrame, TrackingFindings, features::PixelMatch};
use common::note::Note;

/// The recording: frames of every state, with findings and losses on the way.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Capture {
    /// A name for the object, from the folder or file: `[A-Za-z][A-Za-z0-9_]*`.
    pub name: String,
    /// Frames per state, in time order.
    pub states: Vec<Vec<RgbdFrame>>,
    /// Pixel matches of the data, if any.
    pub matches: Vec<PixelMatch>,
    /// Depth noise: the model of the settings, scaled to the recording's own noise unless the settings say
    /// otherwise.
    pub noise: NoiseConfig,
    /// How the camera was tracked, of each state; empty where poses came with the recording.
    #[serde(default)]
    pub tracking: Vec<TrackingFindings>,
    /// The board of tags of the world. Used up before the first checkpoint.
    #[serde(skip)]
    pub board: Option<BoardInWorld>,
    /// Findings about the camera poses.
    pub poses: PoseFindings,
    /// Box about the object in all states, lower and upper corner in the world, meters, once it is isolated.
    #[serde(default)]
    pub object_box_m: Option<[[f64; 3]; 2]>,
    /// Degradations: damage, drops, frames not used.
    pub warnings: Vec<Note>,
    /// Choices: topics, counts, frames.
    pub notes: Vec<Note>,
}

impl Capture {
    /// A recording of so many states, without frames yet.
    #[must_use]
    pub fn of_states(count: usize) -> Self {
        Self { states: vec![Vec::new(); count], ..Self::default() }
    }

    /// Frames of every state.
    #[must_use]
    pub fn frames(&self) -> Vec<&[RgbdFrame]> {
        self.states.iter().map(Vec::as_slice).collect()
    }
}

/// Most states of one recording.
pub const MAX_STATES: usize = 16;
