//! Bags that are damaged, row by row, and bags as others write them.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stderr,
    reason = "a test may panic, and says why it is left out"
)]

mod common;
#[path = "common/harness.rs"]
mod harness;
#[path = "common/opened.rs"]
mod opened;
#[path = "common/program.rs"]
mod program;
#[path = "common/venv.rs"]
mod venv;

use std::{
    path::{Path, PathBuf},
    process::{Command, ExitCode},
};

use capture::{Capture, CaptureConfig, CaptureError};
use common::{COUNT, Options, write_states};
use harness::{Missing, tests};
use io::inspect;
use mcap::Compression::{self, Lz4, Zstd};
use opened::open;
use program::shipped;

fn main() -> ExitCode {
    harness::main(tests![every_damage_has_its_outcome, bags_that_others_wrote_give_the_same_frames])
}

const MAGIC: usize = 8;
const CHUNK: u8 = 0x06;
const DATA_END: u8 = 0x0f;

/// A record of an MCAP file: where its opcode stands, the opcode, the length of its body.
struct Record {
    at: usize,
    opcode: u8,
    length: usize,
}

impl Record {
    fn body(&self) -> usize {
        self.at + 9
    }
}

fn records(bytes: &[u8]) -> Vec<Record> {
    let (mut found, mut at) = (Vec::new(), MAGIC);
    while at + 9 <= bytes.len() - MAGIC {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        found.push(Record { at, opcode: bytes[at], length });
        at += 9 + length;
    }
    found
}

fn chunks(bytes: &[u8]) -> Vec<Record> {
    records(bytes).into_iter().filter(|r| r.opcode == CHUNK).collect()
}

/// Flips 40 bytes in the middle of the content of the chunk in the middle.
fn flip(bytes: &mut [u8]) {
    let chunks = chunks(bytes);
    let chunk = &chunks[chunks.len() / 2];
    let middle = chunk.body() + chunk.length / 2;
    bytes[middle..middle + 40].iter_mut().for_each(|b| *b ^= 0xa5);
}

/// Says that no chunk has a checksum, as rosbag2 writes by default.
fn without_checksums(bytes: &mut [u8]) {
    for chunk in chunks(bytes) {
        // Behind two times and the size.
        bytes[chunk.body() + 24..chunk.body() + 28].fill(0);
    }
}

/// A file that begins with a record that claims this length.
fn claiming(bytes: &mut Vec<u8>, opcode: u8, length: u64, body: &[u8]) {
    let header = &records(bytes)[0];
    bytes.truncate(header.body() + header.length);
    bytes.push(opcode);
    bytes.extend(length.to_le_bytes());
    bytes.extend(body);
}

/// A chunk of 60 bytes that claims to unpack to 2^40.
fn huge_chunk(bytes: &mut Vec<u8>) {
    let mut body = [0u64.to_le_bytes(), 0u64.to_le_bytes(), (1u64 << 40).to_le_bytes()].concat();
    body.extend(0u32.to_le_bytes());
    body.extend(4u32.to_le_bytes());
    body.extend(b"zstd");
    body.extend(20u64.to_le_bytes());
    body.extend([7; 20]);
    let length = body.len() as u64;
    claiming(bytes, CHUNK, length, &body);
}

fn cut_at_data_end(bytes: &mut Vec<u8>) {
    let end = records(bytes).iter().find(|r| r.opcode == DATA_END).unwrap().at;
    bytes.truncate(end);
}

enum Outcome {
    /// Every view, and a warning with these words.
    Whole(&'static [&'static str]),
    /// Some views, not all, and a warning with these words.
    Part(&'static [&'static str]),
    /// Every view and no warning: nothing in the file shows it.
    Unseen,
    /// An error with these words.
    Refused(&'static [&'static str]),
}

struct Row {
    name: &'static str,
    compression: Option<Compression>,
    damage: fn(&mut Vec<u8>),
    outcome: Outcome,
}

const NOTHING: &[&str] = &["is damaged and nothing in it could be read", "copy the file again"];
const EARLY: &[&str] = &["is damaged: reading stopped early", "messages were read"];
const ONE_CHUNK: &[&str] = &["is damaged: 1 of ", "chunks left out as damaged", "messages were read"];

/// What can happen to a file, and what then must happen here.
const ROWS: &[Row] = &[
    // Every message stands before it.
    Row {
        name: "no end magic",
        compression: None,
        damage: |b| b.truncate(b.len() - MAGIC),
        outcome: Outcome::Unseen,
    },
    Row {
        name: "no footer and summary",
        compression: None,
        damage: cut_at_data_end,
        outcome: Outcome::Whole(EARLY),
    },
    Row {
        name: "no footer, zstd",
        compression: Some(Zstd),
        damage: cut_at_data_end,
        outcome: Outcome::Whole(EARLY),
    },
    Row {
        name: "half",
        compression: None,
        damage: |b| b.truncate(b.len() / 2),
        outcome: Outcome::Part(EARLY),
    },
    Row {
        name: "half, zstd",
        compression: Some(Zstd),
        damage: |b| b.truncate(b.len() / 2),
        outcome: Outcome::Part(EARLY),
    },
    Row {
        name: "half, lz4",
        compression: Some(Lz4),
        damage: |b| b.truncate(b.len() / 2),
        outcome: Outcome::Part(EARLY),
    },
    Row { name: "flipped bytes", compression: None, damage: |b| flip(b), outcome: Outcome::Part(ONE_CHUNK) },
    Row {
        name: "flipped bytes, zstd",
        compression: Some(Zstd),
        damage: |b| flip(b),
        outcome: Outcome::Part(ONE_CHUNK),
    },
    Row {
        name: "flipped bytes, lz4",
        compression: Some(Lz4),
        damage: |b| flip(b),
        outcome: Outcome::Part(ONE_CHUNK),
    },
    Row {
        name: "no checksums",
        compression: None,
        damage: |b| without_checksums(b),
        outcome: Outcome::Unseen,
    },
    Row {
        name: "flipped pixels without checksums",
        compression: None,
        damage: |b| {
            without_checksums(b);
            flip(b);
        },
        outcome: Outcome::Unseen,
    },
    Row { name: "empty", compression: None, damage: Vec::clear, outcome: Outcome::Refused(NOTHING) },
    Row {
        name: "magic only",
        compression: None,
        damage: |b| b.truncate(MAGIC),
        outcome: Outcome::Refused(NOTHING),
    },
    Row {
        name: "a length of 2^62",
        compression: None,
        damage: |b| claiming(b, CHUNK, 1 << 62, &[0; 50]),
        outcome: Outcome::Refused(NOTHING),
    },
    Row {
        name: "a chunk of 2^40",
        compression: None,
        damage: huge_chunk,
        outcome: Outcome::Refused(NOTHING),
    },
    Row {
        name: "text",
        compression: None,
        damage: |b| *b = b"not a bag".to_vec(),
        outcome: Outcome::Refused(NOTHING),
    },
];

fn config() -> CaptureConfig {
    CaptureConfig { denoise: false, ..CaptureConfig::default() }
}

fn warned(capture: &Capture, words: &[&str]) -> bool {
    capture.warnings.iter().any(|w| words.iter().all(|word| w.text.contains(word)))
}

/// The largest address space that this process had, bytes.
fn peak_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("VmPeak:"))?;
    line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

fn every_damage_has_its_outcome() {
    for row in ROWS {
        let folder = tempfile::tempdir().unwrap();
        // Color is not compressed, so that most bytes of a chunk are pixels.
        write_states(
            folder.path(),
            &Options { chunk_bytes: 60_000, compression: row.compression, ..Options::default() },
        );
        let file = folder.path().join("state0/state0.mcap");
        let mut bytes = std::fs::read(&file).unwrap();
        (row.damage)(&mut bytes);
        std::fs::write(&file, &bytes).unwrap();
        let name = row.name;
        let told = inspect(folder.path()).map_or_else(|e| e.to_string(), |i| i.to_text());
        match (open(std::slice::from_ref(&folder.path().to_owned()), &config(), 0), &row.outcome) {
            (Ok(capture), Outcome::Whole(words)) => {
                assert_eq!(capture.states[0].len(), COUNT, "{name}");
                assert!(warned(&capture, words), "{name}: {:?}", capture.warnings);
                assert!(
                    words.iter().all(|w| told.contains(w)) && told.contains("usable: yes"),
                    "{name}: {told}"
                );
            }
            (Ok(capture), Outcome::Part(words)) => {
                assert!(
                    (1..COUNT).contains(&capture.states[0].len()),
                    "{name}: {} views",
                    capture.states[0].len()
                );
                assert!(warned(&capture, words), "{name}: {:?}", capture.warnings);
                assert!(words.iter().all(|w| told.contains(w)), "{name}: {told}");
            }
            (Ok(capture), Outcome::Unseen) => {
                assert_eq!(
                    (capture.states[0].len(), capture.warnings.len()),
                    (COUNT, 0),
                    "{name}: {:?}",
                    capture.warnings
                );
                assert!(told.contains("usable: yes"), "{name}: {told}");
            }
            (Err(error), Outcome::Refused(words)) => {
                assert!(matches!(error, CaptureError::Corrupt { .. }), "{name}: {error}");
                assert!(words.iter().all(|w| error.to_string().contains(w)), "{name}: {error}");
                assert!(told.contains(words[0]), "{name}: {told}");
            }
            (Ok(capture), Outcome::Refused(_)) => panic!("{name}: {} views", capture.states[0].len()),
            (Err(error), _) => panic!("{name}: {error}"),
        }
    }
    assert!(peak_bytes().is_none_or(|b| b < 100 << 30), "something that a file claimed was allocated");
}

/// The shipped drawer's state 0 as `bags.py` wrote it in some form, and the state 1 that ships.
fn drawer(state0: &Path) -> Result<Capture, CaptureError> {
    open(&[state0.to_owned(), shipped("drawer/state1")], &config(), 0)
}

fn same_frames(name: &str, found: &Capture, expected: &Capture) {
    assert_eq!(found.states[0].len(), expected.states[0].len(), "{name}");
    for (a, b) in found.states[0].iter().zip(&expected.states[0]) {
        let same = a.rgb == b.rgb
            && a.depth_m == b.depth_m
            && a.mask == b.mask
            && a.world_from_camera == b.world_from_camera;
        assert!(same && a.id == b.id, "{name}: frame {}", a.id);
    }
}

fn bags_that_others_wrote_give_the_same_frames() -> Result<(), Missing> {
    let python = venv::ros_python()?;
    let folder = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/ros/bags.py");
    let output = Command::new(&python)
        .arg(script)
        .arg("copies")
        .arg(shipped("drawer/state0"))
        .arg(folder.path())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let names = String::from_utf8(output.stdout).unwrap();
    let expected = drawer(&shipped("drawer/state0")).unwrap();
    for name in names.split_whitespace() {
        let bag = folder.path().join(name);
        match (name.starts_with("sqlite3"), drawer(&bag)) {
            (false, found) => same_frames(name, &found.unwrap(), &expected),
            (true, found) => {
                same_frames(name, &drawer(&converted(&python, found.unwrap_err())).unwrap(), &expected)
            }
        }
    }
    assert!(names.split_whitespace().count() >= 10, "{names}");
    Ok(())
}

/// Does what an error about an sqlite3 bag proposes; the bag that this makes.
fn converted(python: &Path, error: CaptureError) -> PathBuf {
    assert!(matches!(error, CaptureError::Sqlite { .. }), "{error}");
    let text = error.to_string();
    let command: Vec<&str> = text
        .split('`')
        .find(|part| part.starts_with("rosbags-convert"))
        .unwrap()
        .split_whitespace()
        .collect();
    let output = Command::new(python.with_file_name(command[0])).args(&command[1..]).output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    PathBuf::from(command[command.iter().position(|a| *a == "--dst").unwrap() + 1])
}
