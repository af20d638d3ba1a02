//! Recordings opened while nobody listens.

use std::path::PathBuf;

use capture::{Capture, CaptureConfig, CaptureError};
use run::Monitor;

/// See [`run::capture::open`].
pub fn open(sources: &[PathBuf], config: &CaptureConfig, seed: u64) -> Result<Capture, CaptureError> {
    run::capture::open(sources, config, seed, &common::ahead::Ahead::default(), &Monitor::silent())
}
