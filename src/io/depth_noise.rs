//! The depth noise of a recording against the model of the settings.

use capture::{CaptureConfig, NoiseConfig, RgbdFrame, noise_factor};

/// Least and greatest factor on the noise model. chosen: sensors do not differ by more
const NOISE_FACTORS: [f64; 2] = [0.25, 8.0];

/// Depth noise of frames against the model of the settings; `None` where it is not to be measured, or cannot
/// be.
pub(super) fn measured_noise<'a>(
    frames: impl Iterator<Item = &'a RgbdFrame>,
    config: &CaptureConfig,
) -> Option<f64> {
    let factor = if config.measure_noise { noise_factor(frames, &config.noise) } else { None };
    factor.map(|f| f.clamp(NOISE_FACTORS[0], NOISE_FACTORS[1]))
}

/// The noise model of the settings, scaled to what frames show.
pub(super) fn noise_of<'a>(
    frames: impl Iterator<Item = &'a RgbdFrame>,
    config: &CaptureConfig,
) -> NoiseConfig {
    measured_noise(frames, config).map_or(config.noise, |factor| config.noise.scaled(factor))
}
