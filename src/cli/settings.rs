//! From the arguments to a configuration: every option for a setting is in the last layer.

use serde_norway::Value;

use super::args::{ChangeArgs, InspectArgs, ReconstructArgs, SettingArgs};
use config::{Config, ConfigError, Layers, Resolved};

impl SettingArgs {
    /// Merges preset, file and `--set`.
    ///
    /// # Errors
    /// If a layer is wrong or the values cannot be used.
    pub(super) fn resolved_config(&self) -> Result<Resolved<Config>, ConfigError> {
        Config::from_layers(self.merged_layers()?)
    }

    fn merged_layers(&self) -> Result<Layers, ConfigError> {
        let mut layers = Layers::new(&Config::default())?;
        self.preset.iter().try_for_each(|name| layers.add_preset(name))?;
        self.changes.add_to(&mut layers)?;
        Ok(layers)
    }
}

impl ChangeArgs {
    /// Merges file and `--set` with the defaults.
    ///
    /// # Errors
    /// If a layer is wrong or the values cannot be used.
    pub(super) fn resolved_config(&self) -> Result<Resolved<Config>, ConfigError> {
        Config::from_layers(self.merged_layers()?)
    }

    fn merged_layers(&self) -> Result<Layers, ConfigError> {
        let mut layers = Layers::new(&Config::default())?;
        self.add_to(&mut layers)?;
        Ok(layers)
    }

    fn add_to(&self, layers: &mut Layers) -> Result<(), ConfigError> {
        self.config.iter().try_for_each(|path| layers.add_file(path))?;
        self.set.iter().try_for_each(|assignment| layers.add_setting(assignment))
    }
}

impl ReconstructArgs {
    /// Merges preset, file, `--set` and the options for settings.
    ///
    /// # Errors
    /// If a layer is wrong or the values cannot be used.
    pub(super) fn resolved_config(&self) -> Result<Resolved<Config>, ConfigError> {
        let mut layers = self.settings.merged_layers()?;
        // The last layer: an option wins over the same key by --set.
        let options = [
            ("--parts", "run.parts", self.parts.map(|n| Value::from(n as u64))),
            ("--seed", "run.seed", self.seed.map(Value::from)),
            (
                "--matcher",
                "matching.onnx",
                self.matcher.as_ref().map(|p| Value::from(p.to_string_lossy().into_owned())),
            ),
        ];
        for (option, key, value) in options {
            value.into_iter().try_for_each(|value| layers.add_option(option, key, value))?;
        }
        self.recording.assign_settings(&mut layers)?;
        Config::from_layers(layers)
    }
}

impl InspectArgs {
    /// Merges preset, file, `--set` and the options for settings.
    ///
    /// # Errors
    /// If a layer is wrong or the values cannot be used.
    pub(super) fn resolved_config(&self) -> Result<Resolved<Config>, ConfigError> {
        let mut layers = self.settings.merged_layers()?;
        self.recording.assign_settings(&mut layers)?;
        Config::from_layers(layers)
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::cli::command::{Cli, Command};

    fn resolved(options: &[&str]) -> Result<Config, ConfigError> {
        let all = ["artitwin", "reconstruct", "bag", "--out", "runs"].iter().chain(options);
        let Command::Reconstruct(args) = Cli::try_parse_from(all).unwrap().command else {
            panic!("another verb")
        };
        args.resolved_config().map(|r| r.config)
    }

    #[test]
    fn an_option_wins_over_the_same_key_and_is_named_where_it_is_refused() {
        assert_eq!(resolved(&[]).unwrap(), Config::default());
        let config = resolved(&["--parts", "3", "--set", "run.parts=4", "--preset", "preview"]).unwrap();
        assert_eq!((config.run.parts, config.capture.frames_per_state), (Some(3), 20));
        let message = resolved(&["--parts", "99"]).unwrap_err().to_string();
        assert!(message.contains("run.parts") && message.ends_with("(--parts)"), "{message}");
    }
}
