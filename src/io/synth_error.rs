//! Why an object could not be made or written.

use super::{RunDirError, bag_writer::BagWriteError, ros2msg::DecodeError};
use synth::{NoPositions, NoShape, SynthConfigError};

/// Why an object could not be made or written.
#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    /// The settings cannot be used.
    #[error(transparent)]
    Config(#[from] SynthConfigError),
    /// No such object was found.
    #[error(transparent)]
    Object(#[from] NoShape),
    /// No further states of it were found.
    #[error(transparent)]
    Further(#[from] NoPositions),
    /// The requested layout cannot hold the object.
    #[error(
        "this layout cannot hold the object: {0}; it knows hinges and slides on the static part, and masks: \
        give another --seed or --family, or leave --layout out"
    )]
    Layout(String),
    /// The recording cannot be written.
    #[error(transparent)]
    Bag(#[from] BagWriteError),
    /// A message has no CDR form.
    #[error("a message of the recording cannot be encoded: {0}")]
    Message(#[from] DecodeError),
    /// An image has no compressed form.
    #[error("an image cannot be compressed: {0}")]
    Image(#[from] image::ImageError),
    /// The truth cannot be encoded.
    #[error("truth.json cannot be written: {0}")]
    Truth(#[from] serde_json::Error),
    /// The folder cannot be written.
    #[error(transparent)]
    Folder(#[from] RunDirError),
}
