//! From the arguments to a configuration: every option for a setting is in the last layer.

use serde_norway::Value;

use super::args::{InspectArgs, ReconstructArgs, SettingArgs};
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
        self.config.iter().try_for_each(|path| layers.add_file(path))?;
        self.set.iter().try_for_each(|assignment| layers.add_setting(assignment))?;
        Ok(layers)
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
            ("--init", "run.init", self.init.clone().map(Value::from)),
            ("--limits", "model.limits", self.limits.clone().map(Value::from)),
            (
                "--matcher",
                "matching.onnx",
                self.matcher.as_ref().map(|p| Value::from(p.to_string_lossy().into_owned())),
            ),
            ("--prefix", "export.prefix", self.prefix.clone().map(Value::from)),
            ("--base", "export.base", self.base.clone().map(Value::from)),
            ("--engine", "run.engine", self.engine.clone().map(Value::from)),
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
    use export::Base;

    fn resolved(options: &[&str]) -> Result<Config, ConfigError> {
        let all = ["artitwin", "reconstruct", "bag", "--out", "runs"].iter().chain(options);
        let Command::Reconstruct(args) = Cli::try_parse_from(all).unwrap().command else {
            panic!("another verb")
        };
        args.resolved_config().map(|r| r.config)
    }

    #[test]
    fn prefix_and_base_are_settings_of_the_export() {
        assert_eq!(resolved(&[]).unwrap().export, export::ExportConfig::default());
        let export = resolved(&["--prefix", "left_", "--base", "floating"]).unwrap().export;
        assert_eq!((export.prefix.as_str(), export.base), ("left_", Base::Floating));
        let message = resolved(&["--prefix", "../x"]).unwrap_err().to_string();
        assert!(message.contains("export.prefix") && message.ends_with("(--prefix)"), "{message}");
    }
}
