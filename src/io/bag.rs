//! A recording on disk: a rosbag2 folder, a bare `.mcap` file, a `.bag` of ROS 1, or a folder of images.
//!
//! `metadata.yaml` is read only for the files' names and compression; everything else comes from the files
//! themselves.

use std::{
    collections::BTreeSet,
    fs,
    io::{self, BufReader, Read},
    path::{Path, PathBuf},
};

use serde::Deserialize;

use super::{
    expansion::{Expansion, Within},
    folder::ImageFolder,
    mcap_file::{Channels, FileReport, RECORD_LIMIT, RawMessage, read_messages, summary_channels},
    package_path::below,
    ros1_bag::{ROS1_BAG, read_ros1_bag},
};
use capture::CaptureError;
use common::files;
use common::limits::{METADATA, NAMED, YamlError, parse_yaml};
use common::note::{Note, NoteCode};

/// Largest number of files of one bag.
const MAX_FILES: usize = 10_000;

/// The files of one recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Bag {
    /// The given folder or file.
    pub path: PathBuf,
    /// Its files: of MCAP, of ROS 1, or images.
    pub files: Vec<PathBuf>,
    /// The folder of images that it is, if it is one.
    pub images: Option<ImageFolder>,
    /// Whether every message is compressed by itself with zstd (`compression_mode: message`).
    compressed_messages: bool,
    /// Notes on what it is.
    pub notes: Vec<Note>,
    /// Notes about losses of the folder.
    pub warnings: Vec<Note>,
}

#[derive(Deserialize)]
struct MetadataFile {
    rosbag2_bagfile_information: Metadata,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Metadata {
    storage_identifier: String,
    compression_format: String,
    compression_mode: String,
    relative_file_paths: Vec<String>,
}

/// Counts messages of a file that could not be decompressed.
#[derive(Default)]
struct Undecodable {
    count: usize,
    /// Why the first of them could not.
    first: String,
}

impl Undecodable {
    /// Passes a message to the visitor without its own compression, or counts it as undecodable.
    fn visit_unpacked(
        &mut self,
        message: &RawMessage,
        budget: &mut Expansion,
        visit: &mut dyn FnMut(&RawMessage) -> Result<(), CaptureError>,
    ) -> Result<(), CaptureError> {
        match unpack_message(message.data, budget) {
            Ok(data) => visit(&RawMessage { data: &data, ..*message }),
            Err(why) => {
                if self.count == 0 {
                    self.first = why.to_string();
                }
                self.count += 1;
                Ok(())
            }
        }
    }
}

impl Bag {
    /// Whether a path can be a bag: an MCAP or ROS 1 file, a folder with bag files or metadata in it, or a
    /// folder of images in a form that is known.
    #[must_use]
    pub fn is_at(path: &Path) -> bool {
        if path.is_dir() {
            return path.join("metadata.yaml").is_file()
                || [is_mcap, named_ros1, named_db3].iter().any(|test| !files_with(path, *test).is_empty())
                || ImageFolder::is_at(path);
        }
        path.is_file() && (is_mcap(path) || is_ros1(path) || is_db3(path) || starts_with(path, mcap::MAGIC))
    }

    /// Name of its form.
    #[must_use]
    pub fn form(&self) -> String {
        match &self.images {
            Some(images) => images.form.to_owned(),
            None if self.files.iter().any(|f| is_ros1(f)) => {
                format!("ROS 1 bag, {} file(s)", self.files.len())
            }
            None => format!("MCAP, {} file(s)", self.files.len()),
        }
    }

    /// Unit of depth in whole numbers, meters, where the form of a folder says it.
    #[must_use]
    pub fn depth_unit_m(&self) -> Option<f64> {
        self.images.as_ref().map(ImageFolder::depth_unit_m)
    }

    /// Finds the files of a bag.
    ///
    /// # Errors
    /// [`CaptureError`] for sqlite3 bags, metadata that points outside the folder, unknown compression, or a
    /// bag without files.
    pub fn open(path: &Path) -> Result<Self, CaptureError> {
        let mut bag = Self {
            path: path.to_owned(),
            files: Vec::new(),
            images: None,
            compressed_messages: false,
            notes: Vec::new(),
            warnings: Vec::new(),
        };
        if !path.exists() {
            return Err(CaptureError::Missing { path: path.to_owned() });
        }
        if path.is_file() {
            if is_db3(path) {
                return Err(CaptureError::Sqlite { path: path.to_owned() });
            }
            bag.files.push(path.to_owned());
            return Ok(bag);
        }
        let yaml = path.join("metadata.yaml");
        bag.images = if yaml.is_file() { None } else { ImageFolder::open(path)? };
        if let Some(images) = &bag.images {
            bag.files = images.files();
            bag.notes.push(images.note(path));
            return Ok(bag);
        }
        if yaml.is_file() {
            match read_metadata(&yaml) {
                Ok(metadata) => bag.apply(&metadata)?,
                Err(why) => bag.warnings.push(Note::new(
                    NoteCode::MetadataUnreadable,
                    format!(
                        "`{}` cannot be read ({why}); all .mcap files beside it are used",
                        yaml.display()
                    ),
                )),
            }
        } else if !files_with(path, is_mcap).is_empty() {
            bag.warnings.push(Note::new(
                NoteCode::MetadataMissing,
                format!(
                    "`{}` has no metadata.yaml (the recording was not closed); its .mcap files are used",
                    path.display()
                ),
            ));
        }
        // metadata.yaml may name files that were renamed since: the existing ones are read.
        if bag.files.is_empty() {
            bag.files = files_with(path, is_mcap);
        }
        if bag.files.is_empty() {
            bag.files = files_with(path, named_ros1);
        }
        if let Some(file) = bag.files.iter().find(|f| is_db3(f)) {
            return Err(CaptureError::Sqlite { path: file.clone() });
        }
        let databases = files_with(path, named_db3);
        match (bag.files.is_empty(), databases.as_slice()) {
            (false, _) => Ok(bag),
            // Without metadata.yaml the file can be converted, the folder cannot.
            (true, [one]) => {
                Err(CaptureError::Sqlite { path: if yaml.is_file() { path.to_owned() } else { one.clone() } })
            }
            (true, [_, ..]) => Err(CaptureError::Sqlite { path: path.to_owned() }),
            (true, []) => Err(CaptureError::NotARecording {
                path: path.to_owned(),
                reason: "the folder holds no .mcap file".into(),
            }),
        }
    }

    fn apply(&mut self, metadata: &Metadata) -> Result<(), CaptureError> {
        let yaml = self.path.join("metadata.yaml");
        let refuse = |reason| Err(CaptureError::Metadata { path: yaml.clone(), reason });
        match metadata.storage_identifier.as_str() {
            "mcap" | "" => {}
            "sqlite3" => return Err(CaptureError::Sqlite { path: self.path.clone() }),
            other => {
                return refuse(format!(
                    "storage `{other}` is not supported; convert the bag to mcap with `ros2 bag convert`"
                ));
            }
        }
        let mode = metadata.compression_mode.to_ascii_lowercase();
        let format = metadata.compression_format.to_ascii_lowercase();
        // `storage` and `file` need nothing further: chunks name their compression, and files end in .zstd.
        if !matches!(mode.as_str(), "" | "none" | "message" | "file" | "storage") {
            return refuse(format!(
                "compression_mode `{mode}` is not supported; convert the bag with `ros2 bag convert`"
            ));
        }
        if matches!(mode.as_str(), "message" | "file") && format != "zstd" {
            return refuse(format!(
                "compression_format `{format}` is not supported (zstd is); convert the bag with `ros2 bag \
                 convert`"
            ));
        }
        self.compressed_messages = mode == "message";
        if metadata.relative_file_paths.len() > MAX_FILES {
            return refuse(format!(
                "it lists {} files, more than {MAX_FILES}",
                metadata.relative_file_paths.len()
            ));
        }
        let mut missing = Vec::new();
        let mut seen = BTreeSet::new();
        for name in &metadata.relative_file_paths {
            // A bag from elsewhere must not make the program read other files of this machine.
            let Some(relative) = below(name) else {
                return refuse(format!(
                    "relative_file_paths names `{}`, which lies outside the bag; nothing was read",
                    name.escape_debug()
                ));
            };
            let file = self.path.join(relative);
            if is_db3(&file) {
                return Err(CaptureError::Sqlite { path: self.path.clone() });
            }
            if !file.is_file() {
                missing.push(name.escape_debug().to_string());
            } else if !seen.insert(fs::canonicalize(&file).unwrap_or_else(|_| file.clone())) {
                // Compared by canonical path: otherwise messages of `a.mcap` would be read again as those of
                // `./a.mcap`.
                return refuse(format!(
                    "relative_file_paths names `{}` twice; name every file once",
                    name.escape_debug()
                ));
            } else {
                self.files.push(file);
            }
        }
        if !missing.is_empty() {
            let more = if missing.len() > NAMED {
                format!(" and {} more", missing.len() - NAMED)
            } else {
                String::new()
            };
            missing.truncate(NAMED);
            self.warnings.push(Note::new(
                NoteCode::FilesMissing,
                format!("`{}` lists files that are not there: {}{more}", yaml.display(), missing.join(", ")),
            ));
        }
        Ok(())
    }

    /// Passes every message of every file to the visitor, in file order, and reports how each file was read.
    /// Reading twice gives the same messages in the same order.
    ///
    /// # Errors
    /// The visitor's error; [`CaptureError::Read`]; [`CaptureError::Corrupt`] if no file gave a single
    /// message but was damaged.
    pub fn read(
        &self,
        visit: &mut dyn FnMut(&RawMessage) -> Result<(), CaptureError>,
    ) -> Result<Vec<(PathBuf, FileReport)>, CaptureError> {
        self.read_messages(true, visit)
    }

    /// The same, of images of a folder only the start with their size.
    ///
    /// # Errors
    /// Those of [`Self::read`].
    pub fn read_starts(
        &self,
        visit: &mut dyn FnMut(&RawMessage) -> Result<(), CaptureError>,
    ) -> Result<Vec<(PathBuf, FileReport)>, CaptureError> {
        self.read_messages(false, visit)
    }

    fn read_messages(
        &self,
        pixels: bool,
        visit: &mut dyn FnMut(&RawMessage) -> Result<(), CaptureError>,
    ) -> Result<Vec<(PathBuf, FileReport)>, CaptureError> {
        if let Some(images) = &self.images {
            return Ok(vec![(self.path.clone(), images.read(pixels, visit)?)]);
        }
        let mut reports = Vec::new();
        // One budget for all files: ten thousand small ones may not unpack to more than one large one.
        let bytes = self.files.iter().filter_map(|f| fs::metadata(f).ok()).map(|m| m.len()).sum();
        let mut expansion = Expansion::of(bytes);
        // Messages that are compressed by themselves have a budget of their own, as their chunks are not
        // compressed again.
        let mut of_messages = expansion;
        for path in &self.files {
            let mut undecodable = Undecodable::default();
            let mut unpacking =
                |message: &RawMessage| undecodable.visit_unpacked(message, &mut of_messages, visit);
            let visit: &mut dyn FnMut(&RawMessage) -> Result<(), CaptureError> =
                if self.compressed_messages { &mut unpacking } else { visit };
            let mut report = read_file(path, &mut expansion, visit)?;
            if undecodable.count > 0 && report.stopped.is_none() {
                let Undecodable { count, first } = undecodable;
                report.stopped = Some(format!("{count} messages could not be decompressed (first: {first})"));
            }
            reports.push((path.clone(), report));
        }
        // Damage is an error only if nothing could be read.
        match reports.iter().find(|(_, r)| !r.is_whole()) {
            Some((path, report)) if reports.iter().all(|(_, r)| r.messages == 0) => {
                let chunk = || report.bad_chunks.first().map(|(n, why)| format!("chunk {n}: {why}"));
                let reason = report
                    .stopped
                    .clone()
                    .or_else(chunk)
                    .unwrap_or_else(|| "no message has a known topic".into());
                Err(CaptureError::Corrupt { path: path.clone(), reason })
            }
            _ => Ok(reports),
        }
    }
}

fn read_file(
    path: &Path,
    expansion: &mut Expansion,
    visit: &mut dyn FnMut(&RawMessage) -> Result<(), CaptureError>,
) -> Result<FileReport, CaptureError> {
    let failed = |source| CaptureError::Read { path: path.to_owned(), source };
    let mut file = BufReader::with_capacity(1 << 20, files::open_regular(path).map_err(failed)?);
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("zstd")) {
        // A stream cannot be read from its end, so there is no summary. Chunks inside have a budget of their
        // own, as the stream around them already counts against the bag's.
        let decoder = zstd::Decoder::with_buffer(file).map_err(failed)?;
        let mut inside = *expansion;
        let source = Within { source: decoder, expansion };
        return read_messages(BufReader::new(source), &mut Channels::default(), &mut inside, visit);
    }
    if starts_with(path, ROS1_BAG) {
        return read_ros1_bag(file, expansion, visit);
    }
    let mut channels = summary_channels(&mut file).map_err(failed)?;
    read_messages(file, &mut channels, expansion, visit)
}

/// A payload compressed by itself.
fn unpack_message(data: &[u8], expansion: &mut Expansion) -> io::Result<Vec<u8>> {
    let mut unpacked = Vec::new();
    let decoder = zstd::Decoder::new(data)?;
    Within { source: decoder, expansion }.take(RECORD_LIMIT).read_to_end(&mut unpacked)?;
    Ok(unpacked)
}

/// Why a `metadata.yaml` is not used.
#[derive(Debug, thiserror::Error)]
enum MetadataError {
    #[error(transparent)]
    Read(#[from] io::Error),
    #[error(transparent)]
    Yaml(#[from] YamlError),
}

fn read_metadata(path: &Path) -> Result<Metadata, MetadataError> {
    let text = files::read_text(path, METADATA)?;
    Ok(parse_yaml::<MetadataFile>(&text)?.rosbag2_bagfile_information)
}

/// The files of a folder with a given property, sorted by name.
fn files_with(folder: &Path, test: fn(&Path) -> bool) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<_> =
        entries.map(|e| e.path()).filter(|p| p.is_file() && test(p)).take(MAX_FILES).collect();
    // `read_dir` has no order, and both readings of a bag must see the same one.
    files.sort();
    files
}

fn is_mcap(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    name.ends_with(".mcap") || name.ends_with(".mcap.zstd")
}

/// Whether a file is a bag of ROS 1, by its name or its first bytes.
fn is_ros1(path: &Path) -> bool {
    named_ros1(path) || starts_with(path, ROS1_BAG)
}

fn named_ros1(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    name.ends_with(".bag") || name.ends_with(".bag.active")
}

/// Whether a file is an sqlite3 database, by its name or its first bytes.
fn is_db3(path: &Path) -> bool {
    named_db3(path) || starts_with(path, b"SQLite format 3\0")
}

fn named_db3(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    name.ends_with(".db3") || name.ends_with(".db3.zstd")
}

fn starts_with(path: &Path, magic: &[u8]) -> bool {
    let mut start = Vec::new();
    files::open_regular(path).and_then(|f| f.take(magic.len() as u64).read_to_end(&mut start)).is_ok()
        && start == magic
}
