//! Ten minutes of recording: time and memory follow the frames that are kept, not the bag.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    reason = "a test may panic, and tells what it measured"
)]
#![cfg(target_os = "linux")]

mod common;
#[path = "common/program.rs"]
mod program;

use std::{path::Path, process::Command, time::Instant};

use common::{BagWriter, write_metadata};
use program::{Message, end, messages, shipped};

/// Frames of each state; both states together are five minutes at 30 Hz, ten at 15 Hz.
const FRAMES: usize = 4500;
const GIBIBYTE: u64 = 1 << 30;

/// Moves the stamp of a message's header by whole nanoseconds; a TF message is taken to hold one transform.
fn delay(message: &mut Message, nanos: i64) {
    message.log_nanos += nanos;
    let at = if message.type_name.ends_with("TFMessage") { 8 } else { 4 };
    let read = |d: &[u8], i: usize| u32::from_le_bytes(d[i..i + 4].try_into().unwrap());
    let stamp =
        i64::from(read(&message.data, at)) * 1_000_000_000 + i64::from(read(&message.data, at + 4)) + nanos;
    message.data[at..at + 4].copy_from_slice(&((stamp / 1_000_000_000) as u32).to_le_bytes());
    message.data[at + 4..at + 8].copy_from_slice(&((stamp % 1_000_000_000) as u32).to_le_bytes());
}

/// The recording of a state again and again, until it has [`FRAMES`] frames.
fn write_long(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    let name = format!("{}.mcap", to.file_name().unwrap().to_str().unwrap());
    let mut writer = BagWriter::create(&to.join(&name), None, 4 << 20);
    let once = messages(from);
    let (first, last) =
        (once.iter().map(|m| m.log_nanos).min().unwrap(), once.iter().map(|m| m.log_nanos).max().unwrap());
    let frames = once.iter().filter(|m| m.is("/compressedDepth")).count();
    for round in 0..FRAMES.div_ceil(frames) {
        for m in messages(from) {
            if m.is("/tf_static") && round > 0 {
                continue;
            }
            let mut m = m;
            if !m.is("/tf_static") {
                delay(&mut m, round as i64 * (last - first + 33_000_000));
            }
            writer.bytes(&m.topic, &m.type_name, "cdr", m.log_nanos, &m.data);
        }
    }
    writer.finish();
    write_metadata(to, &[&name], "");
}

/// Wall seconds and most resident bytes of a run that succeeds.
fn measured(bag: &Path, out: &Path) -> (f64, u64) {
    let begin = Instant::now();
    let mut command = Command::new("/usr/bin/env");
    command
        .args(["time", "-f", "%M", env!("CARGO_BIN_EXE_artitwin"), "reconstruct"])
        .arg(bag)
        .arg("--out")
        .arg(out);
    let ended = end(command.args(["--parts", "2", "--set", "capture.frames_per_state=16"]));
    assert!([0, 3].contains(&ended.code), "{}", ended.stderr);
    (
        begin.elapsed().as_secs_f64(),
        ended.stderr.trim().lines().last().unwrap().parse::<u64>().unwrap() * 1024,
    )
}

#[test]
#[ignore = "writes 0.8 GB and takes minutes: cargo test --release --test long_bag -- --ignored --nocapture"]
fn a_long_bag_costs_its_decoding_and_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let long = folder.path().join("drawer");
    for state in ["state0", "state1"] {
        write_long(&shipped("drawer").join(state), &long.join(state));
    }
    let (short_s, short_bytes) = measured(&shipped("drawer"), &folder.path().join("short"));
    let (long_s, long_bytes) = measured(&long, &folder.path().join("long"));
    let begin = Instant::now();
    assert_eq!(end(Command::new(env!("CARGO_BIN_EXE_artitwin")).arg("inspect").arg(&long)).code, 0);
    let reading_s = begin.elapsed().as_secs_f64();
    println!(
        "32 frames: {short_s:.1} s, {:.2} GiB; {} frames: {long_s:.1} s, {:.2} GiB; reading them once: \
         {reading_s:.1} s",
        short_bytes as f64 / GIBIBYTE as f64,
        2 * FRAMES,
        long_bytes as f64 / GIBIBYTE as f64
    );
    assert!(long_s < 1.5 * (short_s + reading_s), "{long_s} s against {short_s} and {reading_s}");
    assert!(long_bytes < short_bytes + short_bytes / 2, "{long_bytes} against {short_bytes} bytes");
    assert!(long_bytes < 3 * GIBIBYTE);
}
