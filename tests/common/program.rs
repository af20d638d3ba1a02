//! The program as a process, and copies of a shipped recording with their messages changed.

#![allow(dead_code, reason = "every test binary uses its own part of this")]

use std::{
    io::Cursor,
    path::{Path, PathBuf},
    process::Command,
};

use io::ros2msg::{CompressedImage, decode, encode};

use crate::common::{BagWriter, write_metadata};
use tempfile::TempDir;

/// Settings that make a run on `bags/drawer` a matter of seconds; enough for its parts to be found.
pub const SMALL: [&str; 12] = [
    "capture.frames_per_state=10",
    "train.steps=120",
    "train.rays=512",
    "train.field.log2_table_size=15",
    "surface.nodes=96",
    "surface.distance_nodes=64",
    "surface.points=6000",
    "articulation.label_steps=40",
    "articulation.refine_steps=40",
    "articulation.rays=256",
    "articulation.uniform_points=1000",
    "articulation.label_points=1024",
];

/// How the program ended.
pub struct Ended {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

/// A path of a recording that ships here.
pub fn shipped(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("bags").join(path)
}

/// `artitwin reconstruct` with the preset `preview` and [`SMALL`] settings, then `options`.
pub fn reconstruct(sources: &[&Path], out: &Path, options: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_artitwin"));
    command.arg("reconstruct").args(sources).arg("--out").arg(out).args(["--preset", "preview"]);
    for setting in SMALL {
        command.args(["--set", setting]);
    }
    command.args(options);
    command
}

/// Waits for a command to end.
pub fn end(command: &mut Command) -> Ended {
    let output = command.output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Ended { code: output.status.code().unwrap(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

/// One message of a recording.
pub struct Message {
    pub topic: String,
    pub type_name: String,
    pub log_nanos: i64,
    pub data: Vec<u8>,
    /// Its number among those of its topic, from 0.
    pub ordinal: usize,
}

impl Message {
    /// Whether the topic's name ends so.
    pub fn is(&self, end: &str) -> bool {
        self.topic.ends_with(end)
    }
}

/// All messages of the MCAP file in a bag folder, in order.
pub fn messages(bag: &Path) -> Vec<Message> {
    let is_mcap = |path: &PathBuf| path.extension().is_some_and(|e| e == "mcap");
    let mut files = std::fs::read_dir(bag).unwrap().map(|e| e.unwrap().path()).filter(is_mcap);
    let bytes = std::fs::read(files.next().unwrap()).unwrap();
    let mut counts = std::collections::BTreeMap::<String, usize>::new();
    let message = |m: mcap::McapResult<mcap::Message>| {
        let m = m.unwrap();
        let count = counts.entry(m.channel.topic.clone()).or_default();
        *count += 1;
        Message {
            topic: m.channel.topic.clone(),
            type_name: m.channel.schema.as_ref().unwrap().name.clone(),
            log_nanos: m.log_time as i64,
            data: m.data.to_vec(),
            ordinal: *count - 1,
        }
    };
    mcap::MessageStream::new(&bytes).unwrap().map(message).collect()
}

/// Writes a bag folder with the messages of another; `change` may change each and tells whether it is kept.
pub fn rewrite(from: &Path, to: &Path, mut change: impl FnMut(&mut Message) -> bool) {
    std::fs::create_dir_all(to).unwrap();
    let name = format!("{}.mcap", to.file_name().unwrap().to_str().unwrap());
    let mut writer = BagWriter::create(&to.join(&name), Some(mcap::Compression::Zstd), 60_000);
    for mut message in messages(from) {
        if change(&mut message) {
            writer.bytes(&message.topic, &message.type_name, "cdr", message.log_nanos, &message.data);
        }
    }
    writer.finish();
    write_metadata(to, &[&name], "");
}

/// A copy of `bags/drawer` in `folder/drawer` whose states went through `change`, which is also told the
/// state.
pub fn drawer(folder: &TempDir, mut change: impl FnMut(usize, &mut Message) -> bool) -> PathBuf {
    let bag = folder.path().join("drawer");
    for state in 0..2 {
        rewrite(&shipped(&format!("drawer/state{state}")), &bag.join(format!("state{state}")), |m| {
            change(state, m)
        });
    }
    bag
}

/// Replaces a compressed image by `change` of its header bytes and picture.
pub fn change_picture(
    message: &mut Message,
    front: usize,
    format: image::ImageFormat,
    change: impl FnOnce(&mut image::DynamicImage),
) {
    let mut compressed: CompressedImage = decode(&message.data).unwrap();
    let mut picture = image::load_from_memory(&compressed.data[front..]).unwrap();
    change(&mut picture);
    let mut file = Cursor::new(Vec::new());
    picture.write_to(&mut file, format).unwrap();
    compressed.data = [&compressed.data[..front], &file.into_inner()].concat();
    message.data = encode(&compressed).unwrap();
}
