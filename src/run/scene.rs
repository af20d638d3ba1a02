//! Facts shared by all stages: settings, measured noise, the box around the object, scales.

use super::{RunError, band::Band};
use capture::{Capture, NoiseConfig, Unread, scene_box};
use config::Config;
use geometry::SceneBox;

/// Facts shared by all stages after the alignment.
pub(super) struct Scene<'a> {
    pub config: &'a Config,
    /// The noise model scaled to the recording.
    pub noise: NoiseConfig,
    /// Errors that neighboring readings share, as a multiple of the noise.
    pub shared_error: f64,
    /// What pixels off the masks show without depth.
    pub unread: Unread,
    /// The box around the object in all states.
    pub bounds: SceneBox,
    pub band: Band,
}

impl<'a> Scene<'a> {
    /// For states in one world frame, in which `bounds` is around the object.
    pub(crate) fn of(capture: &Capture, bounds: SceneBox, config: &'a Config) -> Self {
        let band = Band::of(&capture.frames(), &bounds, &capture.noise, &config.surface);
        Self {
            config,
            noise: capture.noise,
            shared_error: capture.shared_error,
            unread: capture.unread,
            bounds,
            band,
        }
    }
}

/// The box around the object in all states.
///
/// # Errors
/// A recording without depth of the object.
pub(super) fn bounds(capture: &Capture) -> Result<SceneBox, RunError> {
    scene_box(&capture.frames(), &capture.noise).ok_or_else(|| {
        RunError::stage(
            "scene",
            "no depth reading of the object can be used; check masks, depth and workspace",
        )
    })
}
