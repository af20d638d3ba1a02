//! Findings of a check.

use std::collections::BTreeMap;

use common::limits::FINDINGS;

use super::rule::Rule;

/// Contents of a folder: relative path with `/` to bytes.
pub type Folder = BTreeMap<String, Vec<u8>>;

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Some importer refuses the model, loses something of it, or makes it explode.
    Error,
    /// Some importer shows or simulates it differently from what is meant, or refuses an element that others
    /// ignore.
    Warning,
}

/// One broken rule.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CheckFinding {
    /// How bad it is.
    pub level: Level,
    /// The URDF, relative to the folder.
    pub file: String,
    /// The broken rule.
    pub rule: Rule,
    /// The link, joint or file it is about.
    pub subject: String,
    /// What is wrong, with numbers, and what to do.
    pub message: String,
}

impl std::fmt::Display for CheckFinding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let level = match self.level {
            Level::Error => "error",
            Level::Warning => "warning",
        };
        write!(f, "{level} {}: {}: {}: {}", self.rule, self.file, self.subject, self.message)
    }
}

/// Findings of one URDF during its check.
pub(super) struct Findings<'a> {
    file: &'a str,
    pub all: Vec<CheckFinding>,
}

impl<'a> Findings<'a> {
    /// No findings yet for a file.
    pub(super) fn of_file(file: &'a str) -> Self {
        Self { file, all: Vec::new() }
    }

    pub(super) fn add_finding(
        &mut self,
        level: Level,
        rule: Rule,
        subject: &str,
        message: impl Into<String>,
    ) {
        if self.all.len() > FINDINGS {
            // The list is full, but the finding may still turn its last entry into an error.
            return self.all.iter_mut().skip(FINDINGS).for_each(|rest| rest.level = rest.level.min(level));
        }
        let file = self.file.to_owned();
        let subject = subject.to_owned();
        if self.all.len() == FINDINGS {
            let message = format!("there are more than {FINDINGS} findings; further ones are not listed");
            return self.all.push(CheckFinding {
                level,
                file,
                rule: Rule::File,
                subject: ".".into(),
                message,
            });
        }
        self.all.push(CheckFinding { level, file, rule, subject, message: message.into() });
    }

    pub(super) fn add_error(&mut self, rule: Rule, subject: &str, message: impl Into<String>) {
        self.add_finding(Level::Error, rule, subject, message);
    }

    pub(super) fn add_warning(&mut self, rule: Rule, subject: &str, message: impl Into<String>) {
        self.add_finding(Level::Warning, rule, subject, message);
    }
}
