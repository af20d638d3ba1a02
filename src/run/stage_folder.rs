//! Results of stages in a folder of the user's, for runs of the same recordings with other settings.
//!
//! A file is named after its stage and the digest of all that it follows from, so that several processes may
//! read and write one folder: what two of them write under one name is the same.

use std::{
    fs,
    path::{Path, PathBuf},
};

use serde::{Serialize, de::DeserializeOwned};

use super::{
    Fingerprint, Monitor,
    checkpoint_error::CheckpointError,
    stage_facts::of_stage,
    stage_file::{STAGE_FILE, StageFile, stage_name},
};

/// The folder, for one run.
#[derive(Debug)]
pub struct StageFolder {
    folder: PathBuf,
    facts: Fingerprint,
}

impl StageFolder {
    /// Opens the folder for a run of these facts, and makes it where it is not there.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn open(folder: &Path, facts: Fingerprint) -> Result<Self, CheckpointError> {
        let fails = |source| CheckpointError::Disk { path: folder.to_owned(), source };
        fs::create_dir_all(folder).map_err(fails)?;
        Ok(Self { folder: folder.to_owned(), facts })
    }

    /// Writes the result of a stage.
    ///
    /// # Errors
    /// Those of [`super::Checkpoint::save`].
    pub fn save<T: Serialize>(&self, stage: &str, value: &T) -> Result<(), CheckpointError> {
        self.file(stage)?.save(value)
    }

    /// The result of a stage, if there is a whole one. Damage is reported to `monitor`.
    pub fn load<T: DeserializeOwned>(&self, stage: &str, monitor: &Monitor) -> Option<T> {
        self.file(stage).ok()?.load(monitor)
    }

    /// Where it lies.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.folder
    }

    fn file<'a>(&self, stage: &'a str) -> Result<StageFile<'a>, CheckpointError> {
        let digest = of_stage(&self.facts, stage).digest();
        let name = format!("{}-{digest:016x}{STAGE_FILE}", stage_name(stage)?);
        Ok(StageFile { path: self.folder.join(name), stage, digest })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_result_serves_all_runs_that_it_follows_for() {
        let folder = tempfile::tempdir().unwrap();
        let run = |density: u32| {
            let facts = Fingerprint::default().with("source0", "a").with("config.model.density", density);
            StageFolder::open(folder.path(), facts).unwrap()
        };
        run(1).save("register", &7u8).unwrap();
        run(1).save("assemble", &8u8).unwrap();
        let found = |density, stage: &str| run(density).load::<u8>(stage, &Monitor::silent());
        assert_eq!(
            [found(2, "register"), found(2, "assemble"), found(1, "assemble")],
            [Some(7), None, Some(8)]
        );
        run(2).save("assemble", &9u8).unwrap();
        assert_eq!([found(1, "assemble"), found(2, "assemble")], [Some(8), Some(9)]);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
    }
}
