//! Checkpoints of runs that stop, end, or find damage.

use std::{
    hash::Hasher as _,
    sync::{Arc, mpsc},
};

use super::{
    super::stage_file::{HEADER_BYTES, header},
    *,
};
use crate::Event;

struct Fixture {
    folder: PathBuf,
}

impl Fixture {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("artitwin-checkpoint-{name}-{}", std::process::id()));
        fs::remove_dir_all(&folder).ok();
        Self { folder }
    }

    fn open(&self, seed: u64, resume: bool) -> Result<Checkpoint, CheckpointError> {
        Checkpoint::open(&self.folder, &Fingerprint::default().with("seed", seed), resume)
    }

    /// What `load` gives and warns after the stored bytes were changed.
    fn after(&self, change: impl FnOnce(&mut Vec<u8>)) -> (Option<Vec<f32>>, usize) {
        let checkpoint = self.open(1, true).unwrap();
        checkpoint.save("field/state0", &vec![1.0f32, 2.0, 3.0]).unwrap();
        let path = self.folder.join("field.state0.ckpt");
        let mut bytes = fs::read(&path).unwrap();
        change(&mut bytes);
        fs::write(&path, bytes).unwrap();
        let (sender, receiver) = mpsc::channel();
        let value = checkpoint.load("field/state0", &Monitor::new(sender, Arc::default()));
        (value, receiver.iter().filter(|e| matches!(e, Event::Warning { .. })).count())
    }
}

impl Drop for Fixture {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.folder).ok();
    }
}

#[test]
fn a_stopped_run_finds_its_stages_again() {
    let fixture = Fixture::new("again");
    let first = fixture.open(1, false).unwrap();
    assert!(!first.is_continued());
    let value = (vec![0.5f32; 100_000], "x".to_owned());
    first.save("field/state0", &value).unwrap();
    drop(first);
    let second = fixture.open(1, true).unwrap();
    assert!(second.is_continued());
    assert_eq!(second.load("field/state0", &Monitor::silent()), Some(value));
    assert_eq!(second.load::<u8>("field/state1", &Monitor::silent()), None);
    second.remove().unwrap();
    assert!(!fixture.folder.exists());
}

#[test]
fn another_run_is_refused_when_continuing_and_deleted_when_not() {
    let fixture = Fixture::new("other");
    fixture.open(1, false).unwrap().save("a", &1u8).unwrap();
    let message = fixture.open(2, true).unwrap_err().to_string();
    assert!(message.contains("seed is 2, was 1") && message.contains("--resume"), "{message}");
    assert_eq!(fixture.open(1, true).unwrap().load("a", &Monitor::silent()), Some(1u8));
    assert_eq!(fixture.open(1, false).unwrap().load::<u8>("a", &Monitor::silent()), None);
}

#[test]
fn damage_is_told_and_counts_as_absent() {
    let fixture = Fixture::new("damage");
    assert_eq!(fixture.after(|_| {}), (Some(vec![1.0, 2.0, 3.0]), 0));
    let length = HEADER_BYTES + 13;
    fixture.after(|bytes| assert_eq!(bytes.len(), length));
    for at in 0..length {
        assert_eq!(fixture.after(|bytes| bytes[at] ^= 0x10), (None, 1), "byte {at}");
        assert_eq!(fixture.after(|bytes| bytes.truncate(at)), (None, 1), "length {at}");
    }
    assert_eq!(fixture.after(|bytes| bytes.push(0)), (None, 1));
}

#[test]
fn a_result_of_another_stage_or_type_is_not_taken() {
    let fixture = Fixture::new("stage");
    let checkpoint = fixture.open(1, false).unwrap();
    checkpoint.save("a", &vec![1u8, 2]).unwrap();
    assert_eq!(checkpoint.load::<u8>("a", &Monitor::silent()), None);
    fs::rename(fixture.folder.join("a.ckpt"), fixture.folder.join("b.ckpt")).unwrap();
    assert_eq!(checkpoint.load::<Vec<u8>>("b", &Monitor::silent()), None);
}

#[test]
fn a_folder_is_held_by_one_and_foreign_files_are_left_alone() {
    let fixture = Fixture::new("held");
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
    for name in [LOCK_FILE, FINGERPRINT_FILE, "capture.ckpt", "capture.tmp"] {
        for resume in [false, true] {
            let fixture = Fixture::new(&format!("link-{name}-{resume}"));
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
            fs::remove_file(victim).unwrap();
        }
    }
    let fixture = Fixture::new("link-folder");
    let victim = fixture.folder.with_extension("victims");
    fs::create_dir_all(&victim).unwrap();
    fs::write(victim.join("lock"), "precious").unwrap();
    fs::write(victim.join("fingerprint.json"), "precious").unwrap();
    std::os::unix::fs::symlink(&victim, &fixture.folder).unwrap();
    assert!(matches!(fixture.open(1, false), Err(CheckpointError::Foreign { .. })));
    assert_eq!(file_names(&victim).unwrap(), ["fingerprint.json", "lock"]);
    assert_eq!(fs::read_to_string(victim.join("lock")).unwrap(), "precious");
    fs::remove_file(&fixture.folder).unwrap();
    fs::remove_dir_all(victim).unwrap();
}

#[test]
fn what_a_killed_run_was_writing_is_cleared_away() {
    let fixture = Fixture::new("killed");
    fixture.open(1, false).unwrap().save("a", &7u8).unwrap();
    fs::write(fixture.folder.join("b.tmp"), "half").unwrap();
    let again = fixture.open(1, true).unwrap();
    assert_eq!(again.load("a", &Monitor::silent()), Some(7u8));
    assert_eq!(file_names(&fixture.folder).unwrap(), ["a.ckpt", FINGERPRINT_FILE, LOCK_FILE]);
    assert_eq!(again.bytes().unwrap(), HEADER_BYTES as u64 + 1);
}

/// A file whose checksum is right, whatever it holds.
#[test]
fn a_length_that_a_file_claims_reserves_nothing() {
    let fixture = Fixture::new("hostile");
    let checkpoint = fixture.open(1, false).unwrap();
    // Lengths of 2^62 and of 2^35, then three bytes.
    for length in
        [&[0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x40][..], &[0x80, 0x80, 0x80, 0x80, 0x80, 0x01]]
    {
        let payload = [length, &[1, 2, 3]].concat();
        let mut sum = checkpoint.file("a").unwrap().sum();
        sum.write(&payload);
        let head = header(checkpoint.digest, payload.len() as u64, sum.finish());
        fs::write(fixture.folder.join("a.ckpt"), [&head[..], &payload].concat()).unwrap();
        assert_eq!(checkpoint.load::<Vec<[f64; 8]>>("a", &Monitor::silent()), None);
        assert_eq!(checkpoint.load::<String>("a", &Monitor::silent()), None);
        assert!(checkpoint.load::<surface::TriangleMesh>("a", &Monitor::silent()).is_none());
    }
}

#[test]
fn a_failed_run_leaves_no_folder_that_was_not_there_before() {
    let fixture = Fixture::new("discard");
    let out = fixture.folder.join("runs");
    let open = || Checkpoint::open(&Checkpoint::folder(&out, "box"), &Fingerprint::default(), false).unwrap();
    open().discard().unwrap();
    assert!(!out.exists());
    fs::create_dir_all(&out).unwrap();
    open().discard().unwrap();
    assert!(out.exists());
}

#[test]
fn a_value_that_cannot_be_written_leaves_the_earlier_one() {
    struct Broken;
    impl Serialize for Broken {
        fn serialize<S: serde::Serializer>(&self, _: S) -> Result<S::Ok, S::Error> {
            Err(serde::ser::Error::custom("broken"))
        }
    }
    let fixture = Fixture::new("broken");
    let checkpoint = fixture.open(1, false).unwrap();
    checkpoint.save("a", &7u8).unwrap();
    assert!(matches!(checkpoint.save("a", &Broken), Err(CheckpointError::Disk { .. })));
    assert_eq!(checkpoint.load("a", &Monitor::silent()), Some(7u8));
    assert!(matches!(checkpoint.save("../a", &7u8), Err(CheckpointError::StageName(_))));
    assert_eq!(file_names(&fixture.folder).unwrap(), ["a.ckpt", FINGERPRINT_FILE, LOCK_FILE]);
}
