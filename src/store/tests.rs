//! Fetching and putting over a store in memory.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use std::{fs, path::Path, sync::Arc};

use object_store::{ObjectStore, ObjectStoreExt as _, PutPayload, memory::InMemory};

use super::{remote::Remote, *};
use crate::{capture::CaptureConfig, io::Wanted, temp::Temp};

/// A store of these objects.
fn store(objects: &[(&str, &[u8])]) -> (Arc<InMemory>, Remote, Arc<Traffic>) {
    let (memory, traffic) = (Arc::new(InMemory::new()), Arc::new(Traffic::default()));
    let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
    for (path, bytes) in objects {
        runtime.block_on(memory.put(&(*path).into(), PutPayload::from(bytes.to_vec()))).unwrap();
    }
    let bucket = Remote::over(Arc::clone(&memory) as Arc<dyn ObjectStore>, "s3://lab", &traffic).unwrap();
    (memory, bucket, traffic)
}

fn uri(text: &str) -> Uri {
    Uri::parse(text).unwrap().unwrap()
}

fn names(listing: &Listing) -> Vec<&str> {
    listing.objects.iter().map(|o| o.path.as_str()).collect()
}

#[test]
fn an_input_is_an_object_or_what_lies_below_a_prefix() {
    let (_, bucket, _) = store(&[
        ("day/box/state0/a_0.mcap", b"0"),
        ("day/box/state0/metadata.yaml", b"m"),
        ("day/box/state1/a_0.mcap", b"1"),
        ("day/box/truth/state0/lid.obj", b"v"),
        ("day/box.mcap", b"b"),
        ("day/old/x.db3", b"SQLite"),
        ("data/cam_K.txt", b"k"),
        ("data/rgb/0.png", b"p"),
        ("twin/box.urdf", b"<robot/>"),
        ("twin/box.usda", b"u"),
        ("twin/meshes/lid.obj", b"v"),
    ]);
    let of = |text: &str, role| list(&bucket, &uri(text), role);
    let states = of("s3://lab/day/box", Role::Recording).unwrap();
    let expected = ["day/box/state0/a_0.mcap", "day/box/state0/metadata.yaml", "day/box/state1/a_0.mcap"];
    assert_eq!(names(&states), expected);
    assert_eq!(states.bags().0.len(), 2);
    assert_eq!(names(&of("s3://lab/day/box.mcap", Role::Recording).unwrap()), ["day/box.mcap"]);
    // Its name alone refuses a database.
    let old = of("s3://lab/day/old/", Role::Recording).unwrap();
    assert!(old.objects.is_empty() && old.names == ["day/old/x.db3"]);
    assert_eq!(names(&of("s3://lab/data", Role::Recording).unwrap()), ["data/cam_K.txt", "data/rgb/0.png"]);
    let twin = ["twin/box.urdf", "twin/box.usda"];
    assert_eq!(names(&of("s3://lab/twin", Role::Twin).unwrap()), twin);
    assert_eq!(names(&of("s3://lab/twin/box.urdf", Role::Twin).unwrap()), twin);
    assert_eq!(of("s3://lab/twin/box.urdf", Role::TwinWithMeshes).unwrap().objects.len(), 3);
    let missing = of("s3://lab/nope", Role::Recording).unwrap_err();
    assert!(matches!(missing, StoreError::Missing(_)) && !missing.may_pass());
}

#[test]
fn an_identity_changes_with_an_object() {
    let of = |text: &[u8]| {
        let (_, bucket, _) = store(&[("box.mcap", text)]);
        list(&bucket, &uri("s3://lab/box.mcap"), Role::Recording).unwrap().identity()
    };
    assert_eq!(of(b"one").len(), 64);
    assert_ne!(of(b"one"), of(b"three"));
}

#[test]
fn a_recording_is_fetched_to_where_its_name_is_kept() {
    let shipped = |state: &str| fs::read(format!("bags/drawer_raw/{state}.mcap")).ok();
    let bag = |state: &str| {
        shipped(state).unwrap_or_else(|| {
            let folder = Path::new("bags/drawer_raw").join(state);
            let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
            files.retain(|f| f.extension().is_some_and(|e| e == "mcap"));
            fs::read(&files[0]).unwrap()
        })
    };
    let (zero, one) = (bag("state0"), bag("state1"));
    let (_, bucket, traffic) = store(&[("day/box/state0.mcap", &zero), ("day/box/state1.mcap", &one)]);
    let folder = Temp::new("store-fetch");
    let listing = list(&bucket, &uri("s3://lab/day/box"), Role::Recording).unwrap();
    let config = CaptureConfig::default();
    let fetched = fetch(&bucket, &listing, &folder.0, Wanted::Views(&config)).unwrap();
    assert_eq!(fetched.0, folder.0.join("_lab/day/box"));
    assert_eq!(fetched.1.len(), 2);
    assert!(fetched.1.iter().all(|g| g.frames.is_some_and(|n| n > 0) && g.size.is_some()), "{fetched:?}");
    let read = Traffic::get(&traffic.bytes_read);
    assert!(read <= listing.bytes() + (256 << 10), "{read} of {}", listing.bytes());
    assert_eq!(fs::read_dir(&fetched.0).unwrap().count(), 2);
    // What is there is not fetched again, but for the look at it.
    fetch(&bucket, &listing, &folder.0, Wanted::Views(&config)).unwrap();
    let all = fetch(&bucket, &listing, &folder.0.join("all"), Wanted::All).unwrap();
    assert_eq!(fs::read(all.0.join("state0.mcap")).unwrap(), zero);
}

#[test]
fn an_object_that_changes_meanwhile_is_an_error_that_may_pass() {
    let (memory, bucket, _) = store(&[("box.mcap", &[1; 100])]);
    let listing = list(&bucket, &uri("s3://lab/box.mcap"), Role::Recording).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
    runtime.block_on(memory.put(&"box.mcap".into(), PutPayload::from(vec![2; 100]))).unwrap();
    let folder = Temp::new("store-changed");
    let error = fetch(&bucket, &listing, &folder.0, Wanted::All).unwrap_err();
    assert!(error.may_pass(), "{error}");
    assert!(!folder.0.join("_lab/box.mcap").exists());
}

#[test]
fn what_stands_is_not_replaced_and_the_list_says_what_it_is() {
    let (memory, bucket, traffic) = store(&[("out/k/box/report.json", b"the other's")]);
    let folder = Temp::new("store-upload");
    let file = |path: &str, text: &str| {
        fs::write(folder.0.join(path), text).unwrap();
        let sha256 = crate::io::sha256(&folder.0.join(path)).unwrap();
        UploadedFile { path: path.to_owned(), bytes: text.len() as u64, sha256 }
    };
    let files = [file("box.urdf", "<robot/>"), file("report.json", "mine")];
    let standing = upload(&bucket, &folder.0, &files, "out/k/box").unwrap();
    assert_eq!(standing[0], files[0]);
    assert_eq!((standing[1].bytes, Traffic::get(&traffic.bytes_written)), (11, 8));
    let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
    let there = runtime.block_on(async {
        memory.get(&"out/k/box/report.json".into()).await.unwrap().bytes().await.unwrap()
    });
    assert_eq!(&there[..], b"the other's");
    let made =
        bucket.create(vec![("k.json".into(), b"1".to_vec()), ("k.json".into(), b"2".to_vec())]).unwrap();
    assert_eq!(made, [Created::New, Created::Stood]);
    assert_eq!(bucket.get("k.json", 10).unwrap().unwrap(), b"1");
    assert!(bucket.get("nope", 10).unwrap().is_none());
    assert!(matches!(bucket.get("out/k/box/report.json", 10), Err(StoreError::TooLarge { bytes: 11, .. })));
}
