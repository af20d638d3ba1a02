//! Checkpoints of runs that stop, end, or find what others left.

use tempfile::TempDir;

use super::{super::stage_store::HEADER_BYTES, *};

struct Fixture {
    _around: TempDir,
    folder: PathBuf,
}

impl Fixture {
    fn new() -> Self {
        let around = tempfile::tempdir().unwrap();
        Self { folder: around.path().join("checkpoint"), _around: around }
    }

    fn open(&self, seed: u64, resume: bool) -> Result<Checkpoint, CheckpointError> {
        Checkpoint::open(&self.folder, &Fingerprint::default().with("seed", seed), resume)
    }

    /// What an opened checkpoint holds of a stage.
    fn found(&self, seed: u64, resume: bool, stage: &str) -> Option<u8> {
        self.open(seed, resume).unwrap().store.load(stage, &Monitor::silent())
    }
}

#[test]
fn a_stopped_run_finds_its_stages_again() {
    let fixture = Fixture::new();
    let first = fixture.open(1, false).unwrap();
    assert!(!first.is_continued());
    let value = (vec![0.5f32; 100_000], "x".to_owned());
    first.store.save("field/state0", &value).unwrap();
    drop(first);
    let second = fixture.open(1, true).unwrap();
    assert!(second.is_continued());
    assert_eq!(second.store.load("field/state0", &Monitor::silent()), Some(value));
    assert_eq!(second.store.load::<u8>("field/state1", &Monitor::silent()), None);
    second.remove().unwrap();
    assert!(!fixture.folder.exists());
}

#[test]
fn another_run_is_refused_when_continuing_and_deleted_when_not() {
    let fixture = Fixture::new();
    fixture.open(1, false).unwrap().store.save("a", &1u8).unwrap();
    let message = fixture.open(2, true).unwrap_err().to_string();
    assert!(message.contains("seed is 2, was 1") && message.contains("--resume"), "{message}");
    assert_eq!(fixture.found(1, true, "a"), Some(1));
    assert_eq!(fixture.found(1, false, "a"), None);
}

#[test]
fn a_run_whose_facts_are_damaged_is_not_continued() {
    let fixture = Fixture::new();
    fixture.open(1, false).unwrap().store.save("a", &1u8).unwrap();
    let name = own_files(&fixture.folder).unwrap().into_iter().find(|n| n.starts_with(FACTS)).unwrap();
    let facts = fixture.folder.join(name);
    let mut bytes = fs::read(&facts).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&facts, bytes).unwrap();
    let again = fixture.open(1, true).unwrap();
    assert!(!again.is_continued() && again.bytes().unwrap() == 0);
}

#[test]
fn a_folder_is_held_by_one_and_foreign_files_are_left_alone() {
    let fixture = Fixture::new();
    let held = fixture.open(1, false).unwrap();
    assert!(matches!(fixture.open(1, true), Err(CheckpointError::InUse { .. })));
    fs::write(fixture.folder.join("notes.txt"), "mine").unwrap();
    assert!(held.remove().is_err());
    assert!(matches!(fixture.open(1, false), Err(CheckpointError::Foreign { .. })));
    assert_eq!(fs::read_to_string(fixture.folder.join("notes.txt")).unwrap(), "mine");
}

#[test]
#[cfg(unix)]
fn what_a_planted_link_leads_to_is_neither_emptied_nor_deleted() {
    let facts = format!("{}{ENDING}", Fingerprint::default().key(FACTS));
    for name in [LOCK_FILE, &facts, "capture-0.ckpt", "capture.tmp"] {
        for resume in [false, true] {
            let fixture = Fixture::new();
            let victim = fixture.folder.with_extension("victim");
            fs::write(&victim, "precious").unwrap();
            drop(fixture.open(1, false).unwrap());
            let link = fixture.folder.join(name);
            fs::remove_file(&link).unwrap_or_default();
            std::os::unix::fs::symlink(&victim, &link).unwrap();
            assert!(
                matches!(fixture.open(1, resume), Err(CheckpointError::Foreign { path }) if path == link),
                "{name}"
            );
            assert_eq!(fs::read_to_string(&victim).unwrap(), "precious", "{name}");
            assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        }
    }
    let fixture = Fixture::new();
    let victim = fixture.folder.with_extension("victims");
    fs::create_dir_all(&victim).unwrap();
    for name in [LOCK_FILE, &facts] {
        fs::write(victim.join(name), "precious").unwrap();
    }
    std::os::unix::fs::symlink(&victim, &fixture.folder).unwrap();
    assert!(matches!(fixture.open(1, false), Err(CheckpointError::Foreign { .. })));
    assert_eq!(fs::read_dir(&victim).unwrap().count(), 2);
    for name in [LOCK_FILE, &facts] {
        assert_eq!(fs::read_to_string(victim.join(name)).unwrap(), "precious");
    }
}

#[test]
fn what_a_killed_run_was_writing_is_cleared_away() {
    let fixture = Fixture::new();
    fixture.open(1, false).unwrap().store.save("a", &7u8).unwrap();
    fs::write(fixture.folder.join("b.tmp"), "half").unwrap();
    assert_eq!(fixture.found(1, true, "a"), Some(7));
    let again = fixture.open(1, true).unwrap();
    assert_eq!(own_files(&fixture.folder).unwrap().len(), 2, "the stage and the facts");
    assert_eq!(again.bytes().unwrap(), HEADER_BYTES as u64 + 1);
}

#[test]
fn a_failed_run_leaves_no_folder_that_was_not_there_before() {
    let fixture = Fixture::new();
    let out = fixture.folder.join("runs");
    let open = || Checkpoint::open(&Checkpoint::folder(&out, "box"), &Fingerprint::default(), false).unwrap();
    open().discard().unwrap();
    assert!(!out.exists());
    fs::create_dir_all(&out).unwrap();
    open().discard().unwrap();
    assert!(out.exists());
}
