//! Files of stages that are read again, damaged, or made by somebody else.

use std::sync::{Arc, mpsc};

use tempfile::TempDir;

use super::*;
use crate::Event;

fn store() -> (TempDir, StageStore) {
    let folder = tempfile::tempdir().unwrap();
    let store = StageStore::open(folder.path(), Fingerprint::default().with("seed", 1)).unwrap();
    (folder, store)
}

/// What `load` gives and warns after the stored bytes were changed.
fn after(store: &StageStore, change: impl FnOnce(&mut Vec<u8>)) -> (Option<Vec<f32>>, usize) {
    store.save("surface/state0", &vec![1.0f32, 2.0, 3.0]).unwrap();
    let (path, _) = store.file("surface/state0");
    let mut bytes = fs::read(&path).unwrap();
    change(&mut bytes);
    fs::write(&path, bytes).unwrap();
    let (sender, receiver) = mpsc::channel();
    let value = store.load("surface/state0", &Monitor::new(sender, Arc::default()));
    (value, receiver.iter().filter(|e| matches!(e, Event::Warning { .. })).count())
}

#[test]
fn a_result_serves_all_runs_that_it_follows_for() {
    let folder = tempfile::tempdir().unwrap();
    let run = |density: u32| {
        let facts = Fingerprint::default().with("source0", "a").with("config.model.density", density);
        StageStore::open(folder.path(), facts).unwrap()
    };
    run(1).save("register", &7u8).unwrap();
    run(1).save("assemble", &8u8).unwrap();
    let found = |density, stage: &str| run(density).load::<u8>(stage, &Monitor::silent());
    assert_eq!([found(2, "register"), found(2, "assemble"), found(1, "assemble")], [Some(7), None, Some(8)]);
    run(2).save("assemble", &9u8).unwrap();
    assert_eq!([found(1, "assemble"), found(2, "assemble")], [Some(8), Some(9)]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
}

#[test]
fn damage_is_told_and_counts_as_absent() {
    let (_folder, store) = store();
    assert_eq!(after(&store, |_| {}), (Some(vec![1.0, 2.0, 3.0]), 0));
    let length = HEADER_BYTES + 13;
    after(&store, |bytes| assert_eq!(bytes.len(), length));
    for at in 0..length {
        assert_eq!(after(&store, |bytes| bytes[at] ^= 0x10), (None, 1), "byte {at}");
        assert_eq!(after(&store, |bytes| bytes.truncate(at)), (None, 1), "length {at}");
    }
    assert_eq!(after(&store, |bytes| bytes.push(0)), (None, 1));
}

#[test]
fn a_result_of_another_stage_or_type_is_not_taken() {
    let (_folder, store) = store();
    store.save("a", &vec![1u8, 2]).unwrap();
    assert_eq!(store.load::<u8>("a", &Monitor::silent()), None);
    fs::rename(store.file("a").0, store.file("b").0).unwrap();
    assert_eq!(store.load::<Vec<u8>>("b", &Monitor::silent()), None);
}

/// A file whose checksum is right, whatever it holds.
#[test]
fn a_length_that_a_file_claims_reserves_nothing() {
    let (_folder, store) = store();
    // Lengths of 2^62 and of 2^35, then three bytes.
    for length in
        [&[0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x40][..], &[0x80, 0x80, 0x80, 0x80, 0x80, 0x01]]
    {
        let payload = [length, &[1, 2, 3]].concat();
        let (path, mut sum) = store.file("a");
        sum.write(&payload);
        fs::write(path, [&header(&sum)[..], &payload].concat()).unwrap();
        assert_eq!(store.load::<Vec<[f64; 8]>>("a", &Monitor::silent()), None);
        assert_eq!(store.load::<String>("a", &Monitor::silent()), None);
        assert!(store.load::<surface::TriangleMesh>("a", &Monitor::silent()).is_none());
    }
}

#[test]
fn a_value_that_cannot_be_written_leaves_the_earlier_one() {
    struct Broken;
    impl Serialize for Broken {
        fn serialize<S: serde::Serializer>(&self, _: S) -> Result<S::Ok, S::Error> {
            Err(serde::ser::Error::custom("broken"))
        }
    }
    let (folder, store) = store();
    store.save("a", &7u8).unwrap();
    assert!(matches!(store.save("a", &Broken), Err(CheckpointError::Disk { .. })));
    assert_eq!(store.load("a", &Monitor::silent()), Some(7u8));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}
