//! The presets of `launch_configs/`, compiled into the program.

use super::error::ConfigError;

/// Name and text of every preset.
// Built in, so the program needs no files beside it.
pub(crate) const PRESETS: [(&str, &str); 7] = [
    ("default", include_str!("../../launch_configs/default.yaml")),
    ("fields", include_str!("../../launch_configs/fields.yaml")),
    ("preview", include_str!("../../launch_configs/preview.yaml")),
    ("paper", include_str!("../../launch_configs/paper.yaml")),
    ("paris", include_str!("../../launch_configs/paris.yaml")),
    ("paris-depth", include_str!("../../launch_configs/paris-depth.yaml")),
    ("paris-depth-multi", include_str!("../../launch_configs/paris-depth-multi.yaml")),
];

/// Loss of accuracy with a preset, in words, measured on rendered recordings (docs/figures.md); `None` for
/// other names.
#[must_use]
pub fn preset_cost(name: &str) -> Option<&'static str> {
    match name {
        "default" => Some("the most accurate of the presets"),
        "fields" => {
            Some("joints and surfaces about as accurate as by the preset default, in many times its time")
        }
        "preview" => Some(
            "joint errors up to twice those of the preset default, or 0.02 deg; surfaces up to three times \
             as far off",
        ),
        "paper" => Some(
            "the published method, for comparison: joint errors up to a hundred times those of the preset \
             default",
        ),
        "paris" | "paris-depth" | "paris-depth-multi" => Some(
            "published methods on images, for comparison: joint errors ten to two hundred times those of \
                 the preset default, where the motion is found at all",
        ),
        _ => None,
    }
}

/// Path (for messages) and text of a preset.
pub(super) fn preset(name: &str) -> Result<(String, &'static str), ConfigError> {
    match PRESETS.iter().find(|(n, _)| *n == name) {
        Some((name, text)) => Ok((format!("launch_configs/{name}.yaml"), text)),
        None => Err(ConfigError::UnknownPreset {
            name: name.to_owned(),
            known: PRESETS.map(|(n, _)| n).join(", "),
        }),
    }
}
