//! Model of a handheld consumer depth camera: its effects and their level.

use std::str::FromStr;

use super::{Effect, effect::ParseEffectError};

/// A handheld consumer stereo camera with poses from odometry and without masks.
///
/// At level 1 each effect has the size stated in its file. The level multiplies sizes and shares; the random
/// draws of a seed do not depend on it. At level 0 only the clutter remains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandheldSensor {
    level: f64,
    on: [bool; Effect::ALL.len()],
}

impl HandheldSensor {
    /// Largest level. chosen: beyond it, reconstruction fails
    pub const MAX_LEVEL: f64 = 5.0;

    /// All effects, at a level.
    pub fn new(level: f64) -> Self {
        Self { level, on: [true; Effect::ALL.len()] }
    }

    /// No effects.
    pub fn clean() -> Self {
        Self::new(1.0).only(&[])
    }

    /// The same level with only these effects.
    #[must_use]
    pub fn only(self, effects: &[Effect]) -> Self {
        Self { on: Effect::ALL.map(|e| effects.contains(&e)), ..self }
    }

    /// The same without these effects.
    #[must_use]
    pub fn without(self, effects: &[Effect]) -> Self {
        Self { on: Effect::ALL.map(|e| self.has(e) && !effects.contains(&e)), ..self }
    }

    /// Factor on the size of all effects.
    pub fn level(&self) -> f64 {
        self.level
    }

    /// The active effects.
    pub fn effects(&self) -> Vec<Effect> {
        Effect::ALL.into_iter().filter(|e| self.has(*e)).collect()
    }

    /// Whether an effect is active.
    pub fn has(&self, effect: Effect) -> bool {
        Effect::ALL.iter().zip(self.on).any(|(e, on)| on && *e == effect)
    }

    /// Level of an effect; 0 if it is not active.
    pub(crate) fn level_of(&self, effect: Effect) -> f64 {
        if self.has(effect) { self.level } else { 0.0 }
    }
}

/// A text that is no [`HandheldSensor`].
#[derive(Debug, thiserror::Error)]
pub enum ParseSensorError {
    /// It has another form.
    #[error(
        "give handheld, handheld:LEVEL with a level from 0 to {}, or handheld:LEVEL:EFFECT,... for these \
         effects alone, e.g. handheld:0.5:depth_warp,clutter",
        HandheldSensor::MAX_LEVEL
    )]
    Form,
    /// It names an effect that does not exist.
    #[error(transparent)]
    Effect(#[from] ParseEffectError),
}

impl FromStr for HandheldSensor {
    type Err = ParseSensorError;

    /// Parses `handheld`, `handheld:LEVEL` or `handheld:LEVEL:EFFECT,...`.
    fn from_str(text: &str) -> Result<Self, ParseSensorError> {
        let mut words = text.split(':').map(str::trim);
        let name = words.next().unwrap_or_default();
        let level: f64 = words.next().map_or(Ok(1.0), str::parse).unwrap_or(f64::NAN);
        if name != "handheld" || !(0.0..=Self::MAX_LEVEL).contains(&level) {
            return Err(ParseSensorError::Form);
        }
        let sensor = Self::new(level);
        match (words.next(), words.next()) {
            (None, _) => Ok(sensor),
            (Some(effects), None) => {
                let effects: Result<Vec<Effect>, _> = effects.split(',').map(str::parse).collect();
                Ok(sensor.only(&effects?))
            }
            _ => Err(ParseSensorError::Form),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sensor_is_read_and_its_effects_are_switched() {
        let sensor: HandheldSensor = "handheld:0.5".parse().unwrap();
        assert_eq!((sensor.level(), sensor.effects().len()), (0.5, Effect::ALL.len()));
        assert_eq!("handheld".parse::<HandheldSensor>().unwrap(), HandheldSensor::new(1.0));
        let alone: HandheldSensor = "handheld:0.5:depth_warp,hand".parse().unwrap();
        assert_eq!(alone, sensor.only(&[Effect::DepthWarp, Effect::Hand]));
        for wrong in [
            "",
            "handheld:",
            "handheld:-1",
            "handheld:6",
            "handheld:nan",
            "kinect:1",
            "1",
            "handheld:1:",
            "handheld:1:hand:2",
        ] {
            assert!(wrong.parse::<HandheldSensor>().is_err(), "{wrong}");
        }
        let [warp, hand] = [Effect::DepthWarp, Effect::Hand];
        assert_eq!(sensor.only(&[warp]).effects(), [warp]);
        assert_eq!([sensor.only(&[warp]).level_of(warp), sensor.only(&[warp]).level_of(hand)], [0.5, 0.0]);
        let rest = sensor.without(&[hand]);
        assert!(!rest.has(hand) && rest.effects().len() == Effect::ALL.len() - 1);
        assert!(HandheldSensor::clean().effects().is_empty());
    }
}
