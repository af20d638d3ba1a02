//! The presets of `launch_configs/`, built in.

use super::ConfigError;

/// Name and text of every preset.
pub const PRESETS: [(&str, &str); 4] = [
    ("default", include_str!("../../launch_configs/default.yaml")),
    ("fields", include_str!("../../launch_configs/fields.yaml")),
    ("preview", include_str!("../../launch_configs/preview.yaml")),
    ("paper", include_str!("../../launch_configs/paper.yaml")),
];

/// Path, for messages, and text of a preset.
pub(super) fn preset(name: &str) -> Result<(String, &'static str), ConfigError> {
    match PRESETS.iter().find(|(n, _)| *n == name) {
        Some((name, text)) => Ok((format!("launch_configs/{name}.yaml"), text)),
        None => Err(ConfigError::UnknownPreset { name: name.to_owned(), known: PRESETS.map(|(n, _)| n).join(", ") }),
    }
}
