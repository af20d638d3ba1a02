//! Why a configuration was refused.

use std::path::PathBuf;

use super::origins::Origins;
use common::limits::CONFIG;

/// Why a configuration was refused; every message names the place and a remedy.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// No preset has this name.
    #[error("no preset {name:?}; there are: {known}")]
    UnknownPreset {
        /// The given name.
        name: String,
        /// Names of the presets.
        known: String,
    },
    /// The file could not be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file is larger than [`CONFIG`].
    #[error("{}: larger than {} bytes: not a configuration", path.display(), CONFIG.bytes)]
    TooLarge {
        /// The file.
        path: PathBuf,
    },
    /// Not YAML, or not a mapping of text keys.
    #[error("{origin}: {reason}")]
    Syntax {
        /// File or option.
        origin: String,
        /// What is wrong.
        reason: String,
    },
    /// Two objects of one command would get the same name.
    #[error(
        "{first} and {second} would both be named {name}; rename one, or reconstruct them into different \
         folders"
    )]
    SameName {
        /// The name.
        name: String,
        /// The first recording.
        first: String,
        /// The second recording.
        second: String,
    },
    /// Not of the form `group.key=value`.
    #[error("--set {text:?}: give group.key=value, for example --set run.seed=3")]
    Assignment {
        /// The given text.
        text: String,
    },
    /// The key does not exist.
    #[error("{origin}: unknown key {key}; {hint}")]
    UnknownKey {
        /// File and line, or option.
        origin: String,
        /// Path of the key.
        key: String,
        /// The nearest valid key, as advice.
        hint: String,
    },
    /// A group of keys was given a single value.
    #[error("{origin}: {key} is a group of keys, not a value; it has: {keys}")]
    Group {
        /// File and line, or option.
        origin: String,
        /// Path of the group.
        key: String,
        /// Keys of the group.
        keys: String,
    },
    /// The value has the wrong form for its key.
    #[error("{origin}: {key} = {value}: {reason}")]
    Value {
        /// File and line, or option.
        origin: String,
        /// Path of the key.
        key: String,
        /// The given value.
        value: String,
        /// What is wrong.
        reason: String,
    },
    /// The value is outside the usable range.
    #[error("{key}: {reason}")]
    Unusable {
        /// Path of the key.
        key: String,
        /// What is wrong, and which values are accepted.
        reason: String,
    },
}

impl ConfigError {
    /// Adds the origin of an unusable value to the message, if it is known.
    #[must_use]
    pub fn with_origin(self, origins: &Origins) -> Self {
        match self {
            Self::Unusable { key, reason } => match origins.0.get(&key).filter(|o| *o != "default") {
                Some(origin) => Self::Unusable { key, reason: format!("{reason} ({origin})") },
                None => Self::Unusable { key, reason },
            },
            other => other,
        }
    }
}
