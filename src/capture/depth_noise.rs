//! The depth noise of a recording relative to the noise model of the settings.

use super::{CaptureConfig, NoiseConfig, RgbdFrame, noise_factor};
use common::stop::{Stop, Stopped};

/// Least and greatest factor on the noise model. chosen: sensors do not differ by more
const NOISE_FACTORS: [f64; 2] = [0.25, 8.0];

/// Depth noise of frames as a factor on the model of the settings; `None` where it is not to be measured or
/// cannot be.
///
/// # Errors
/// [`Stopped`].
pub fn measured_noise<'a>(
    frames: impl Iterator<Item = &'a RgbdFrame>,
    config: &CaptureConfig,
    stop: &Stop,
) -> Result<Option<f64>, Stopped> {
    if !config.measure_noise {
        return Ok(None);
    }
    let factor = noise_factor(frames.take_while(|_| stop.check().is_ok()), &config.noise);
    stop.check()?;
    Ok(factor.map(|f| f.clamp(NOISE_FACTORS[0], NOISE_FACTORS[1])))
}

/// The noise model of the settings, scaled to the noise of the frames.
///
/// # Errors
/// [`Stopped`].
pub fn noise_of<'a>(
    frames: impl Iterator<Item = &'a RgbdFrame>,
    config: &CaptureConfig,
    stop: &Stop,
) -> Result<NoiseConfig, Stopped> {
    let factor = measured_noise(frames, config, stop)?;
    Ok(factor.map_or(config.noise, |factor| config.noise.scaled(factor)))
}
