//! Static rules of a URDF folder: what importers refuse, drop silently or let explode (simulators.md 2 to 4).
//!
//! Works on files in memory and on any URDF, not only on those written here.

mod description;
mod joints;
mod links;
mod mesh_text;
mod meshes;
mod overlap;
mod placement;

use std::collections::BTreeMap;

use description::Description;

use crate::limits::FINDINGS;

/// Contents of a folder: relative path with `/` to bytes.
pub type Folder = BTreeMap<String, Vec<u8>>;

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Some importer refuses the model, loses something of it, or makes it explode.
    Error,
    /// Some importer shows or simulates it otherwise than meant.
    Warning,
}

/// One broken rule.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CheckFinding {
    /// How bad it is.
    pub level: Level,
    /// The URDF, relative to the folder.
    pub file: String,
    /// The rule: `path`, `name`, `inertia`, `limit`, `mesh`, `texture`, `overlap`, `sweep`, ...
    pub rule: &'static str,
    /// Link, joint or file.
    pub subject: String,
    /// What is wrong, with numbers and remedy.
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

/// Findings of one URDF while it is looked at.
struct Findings<'a> {
    file: &'a str,
    all: Vec<CheckFinding>,
}

impl Findings<'_> {
    fn add(&mut self, level: Level, rule: &'static str, subject: &str, message: impl Into<String>) {
        if self.all.len() > FINDINGS {
            return;
        }
        let (file, subject) = (self.file.to_owned(), subject.to_owned());
        if self.all.len() == FINDINGS {
            let message = format!("there are more than {FINDINGS} findings; further ones are not told");
            return self.all.push(CheckFinding { level: Level::Warning, file, rule: "file", subject: ".".into(), message });
        }
        self.all.push(CheckFinding { level, file, rule, subject, message: message.into() });
    }

    fn error(&mut self, rule: &'static str, subject: &str, message: impl Into<String>) {
        self.add(Level::Error, rule, subject, message);
    }

    fn warn(&mut self, rule: &'static str, subject: &str, message: impl Into<String>) {
        self.add(Level::Warning, rule, subject, message);
    }
}

/// Everything wrong with the URDFs of a folder, errors first; an error of its own where it has none. Files named
/// `*.ros.urdf` may hold `package://` paths of the package that is the folder.
#[must_use]
pub fn check_folder(folder: &Folder) -> Vec<CheckFinding> {
    let mut all = Vec::new();
    let urdfs: Vec<&String> = folder.keys().filter(|p| p.ends_with(".urdf")).collect();
    if urdfs.is_empty() {
        let mut found = Findings { file: ".", all: Vec::new() };
        found.error("file", ".", "the folder holds no .urdf file");
        return found.all;
    }
    for path in urdfs {
        all.extend(check_urdf(folder, path));
    }
    all.sort();
    all
}

fn check_urdf(folder: &Folder, path: &str) -> Vec<CheckFinding> {
    let mut found = Findings { file: path, all: Vec::new() };
    let text = folder.get(path).map(|b| String::from_utf8_lossy(b).into_owned()).unwrap_or_default();
    let description = match Description::parse(&text) {
        Ok(description) => description,
        Err(problem) => {
            found.error("xml", path, problem);
            return found.all;
        }
    };
    links::check(&description, &mut found);
    joints::check(&description, &mut found);
    let solids = meshes::check(&description, folder, path, &mut found);
    // Positions mean nothing where the tree is broken.
    if !found.all.iter().any(|f| f.level == Level::Error && ["tree", "limit", "joint"].contains(&f.rule)) {
        overlap::check(&description, &solids, &mut found);
    }
    found.all
}

#[cfg(test)]
mod tests;
