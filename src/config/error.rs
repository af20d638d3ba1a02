//! Why a configuration was refused.

use std::path::PathBuf;

use super::origins::Origins;
use common::limits::CONFIG;

/// Why a configuration was refused; every message has the place and a remedy.
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
        /// Why.
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
        /// The fault.
        reason: String,
    },
    /// Two objects of one command would get one name.
    #[error(
        "{first} and {second} would both be named {name}; rename one, or reconstruct them into different \
         folders"
    )]
    SameName {
        /// The name.
        name: String,
        /// One recording.
        first: String,
        /// The other.
        second: String,
    },
    /// Not of the form `group.key=value`.
    #[error("--set {text:?}: give group.key=value, for example --set run.seed=3")]
    Assignment {
        /// The given text.
        text: String,
    },
    /// Nobody reads this key.
    #[error("{origin}: unknown key {key}; {hint}")]
    UnknownKey {
        /// File and line, or option.
        origin: String,
        /// Path of the key.
        key: String,
        /// The nearest valid key.
        hint: String,
    },
    /// A group of keys was given one value.
    #[error("{origin}: {key} is a group of keys, not a value; it has: {keys}")]
    Group {
        /// File and line, or option.
        origin: String,
        /// Path of the group.
        key: String,
        /// Its keys.
        keys: String,
    },
    /// The value does not fit its key.
    #[error("{origin}: {key} = {value}: {reason}")]
    Value {
        /// File and line, or option.
        origin: String,
        /// Path of the key.
        key: String,
        /// The given value.
        value: String,
        /// The fault.
        reason: String,
    },
    /// No run can use the value.
    #[error("{key}: {reason}")]
    Unusable {
        /// Path of the key.
        key: String,
        /// The fault, and accepted values.
        reason: String,
    },
}

impl ConfigError {
    /// The same, with the origin of an unusable value, where it is known.
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
