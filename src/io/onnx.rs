//! A matcher of image pairs from a user's ONNX file.
//!
//! Contract: inputs `image0` and `image1`, float32 `[1, C, H, W]` in `[0, 1]` with C = 1 (luma) or 3 (red,
//! green, blue); outputs `keypoints0` and `keypoints1`, `[N, 2]` or `[1, N, 2]`, pixels (u, v) of the inputs
//! with integers at pixel centers, and optionally `confidence`, `[N]` or `[1, N]`. Further outputs are
//! ignored.

use std::path::PathBuf;

/// Largest file of a model, bytes.
pub const MAX_MODEL_BYTES: u64 = 512 << 20;
/// Most matches of a pair of images.
#[cfg(feature = "onnx")]
pub const MAX_PAIR_MATCHES: usize = 100_000;

/// The required inputs and outputs of a model.
const CONTRACT: &str = "needed are inputs image0 and image1, float32 [1, 1 or 3, height, width], and \
    outputs keypoints0 and keypoints1, \
                        [matches, 2]; confidence, [matches], may be absent; rename or wrap the exported \
                        model";

/// Why a model cannot match images.
#[derive(Debug, thiserror::Error)]
pub enum OnnxError {
    /// The binary was built without the `onnx` feature.
    #[error(
        "this binary was built without ONNX models; build it with `cargo build --release --features onnx`"
    )]
    NotBuilt,
    /// The file cannot be read.
    #[error("cannot read the matcher {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is larger than [`MAX_MODEL_BYTES`].
    #[error("the matcher {} is larger than {} MiB; give a smaller \
        model", path.display(), MAX_MODEL_BYTES >> 20)]
    TooLarge {
        /// The file.
        path: PathBuf,
    },
    /// It is not an ONNX model, has weights in other files, or has operators unknown to the runtime.
    #[error("the matcher {} cannot be used: {reason}; give an ONNX model that holds its weights, operator \
        set 9 to 18", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// Error of the runtime.
        reason: String,
    },
    /// Its inputs or outputs do not fit the contract.
    #[error("the matcher {} has {has}; {CONTRACT}", path.display())]
    Contract {
        /// The file.
        path: PathBuf,
        /// Its inputs and outputs.
        has: String,
    },
    /// The model failed at work.
    #[error("the matcher {} failed on images of {} and {} pixels: \
        {reason}", path.display(), size(sizes[0]), size(sizes[1]))]
    Run {
        /// The file.
        path: PathBuf,
        /// Width and height of both images, as the model got them.
        sizes: [[usize; 2]; 2],
        /// Error of the runtime.
        reason: String,
    },
}

fn size([width, height]: [usize; 2]) -> String {
    format!("{width}x{height}")
}

#[cfg(not(feature = "onnx"))]
mod absent {
    use std::path::Path;

    use super::OnnxError;
    use capture::{Correspondence, RgbdFrame};

    /// Stands for the matcher in builds without it.
    #[derive(Debug)]
    pub enum OnnxMatcher {}

    impl OnnxMatcher {
        /// Refuses every model.
        ///
        /// # Errors
        /// Always [`OnnxError::NotBuilt`].
        pub fn open(_: &Path, _max_side_px: usize) -> Result<Self, OnnxError> {
            Err(OnnxError::NotBuilt)
        }

        /// Matches of two frames.
        ///
        /// # Errors
        /// None: there is no such matcher.
        pub fn correspondences(&self, _: [&RgbdFrame; 2]) -> Result<Vec<Correspondence>, OnnxError> {
            match *self {}
        }
    }
}

#[cfg(not(feature = "onnx"))]
pub use absent::OnnxMatcher;
