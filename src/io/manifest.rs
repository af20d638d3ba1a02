//! Records a result folder's files, so a later command knows whether they are unchanged.
//!
//! `manifest.json` is in the folder itself and lists every other file. Equal files give equal manifests.

use std::{
    collections::BTreeMap,
    fmt, fs,
    io::{self, Read as _, Write as _},
    path::Path,
};

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use common::files;

/// Name of the file.
pub(super) const MANIFEST: &str = "manifest.json";
/// Largest accepted manifest, bytes: more than [`MAX_ENTRIES`] lines.
const MAX_BYTES: u64 = 64 << 20;
/// Largest number of files and folders; no result has a hundredth of it.
const MAX_ENTRIES: usize = 100_000;
/// Size of a read, bytes.
const PIECE: usize = 1 << 16;

/// The command that wrote a result folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ResultKind {
    /// `reconstruct`: a twin.
    Reconstruct,
    /// `diagnose`: a diagnosis.
    Diagnose,
    /// `synth`: a synthetic object.
    Synth,
    /// `demo`: a demonstration.
    Demo,
}

impl fmt::Display for ResultKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Reconstruct => "reconstruct",
            Self::Diagnose => "diagnose",
            Self::Synth => "synth",
            Self::Demo => "demo",
        })
    }
}

/// Files of a result folder, by relative path with `/`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    /// Version of the program.
    artitwin: String,
    /// The command that wrote the folder.
    pub command: ResultKind,
    files: BTreeMap<String, Content>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Content {
    bytes: u64,
    sha256: String,
}

impl Manifest {
    /// Describes the contents of a folder and writes the manifest into it.
    ///
    /// # Errors
    /// If a file cannot be read, the manifest cannot be written, or the folder holds anything but files.
    pub fn write(folder: &Path, command: ResultKind) -> io::Result<()> {
        let mut files = BTreeMap::new();
        for (path, held) in listed(folder)? {
            match held {
                Held::File { bytes } => {
                    drop(files.insert(path.clone(), Content { bytes, sha256: sha256(&folder.join(&path))? }))
                }
                Held::Folder => {}
                // A link or device in our own folder was put there by somebody else.
                Held::Other => return Err(io::Error::other(format!("{path} is no file"))),
            }
        }
        let manifest = Self { artitwin: env!("CARGO_PKG_VERSION").to_owned(), command, files };
        fs::File::create_new(folder.join(MANIFEST))?.write_all(&manifest.bytes()?)
    }

    /// The manifest of a folder; `None` without a readable one.
    pub fn read(folder: &Path) -> Option<Self> {
        let path = folder.join(MANIFEST);
        fs::symlink_metadata(&path).ok().filter(|m| m.is_file() && m.len() <= MAX_BYTES)?;
        // A damaged manifest counts as missing, so the folder is not replaced.
        serde_json::from_slice(&fs::read(path).ok()?).ok()
    }

    /// Sentences about the differences between the folder and its manifest: every file or folder added,
    /// removed or edited. A link, or anything else that is not a file, counts as an edit.
    /// # Errors
    /// If the folder or a file cannot be read, or the folder holds more than 100,000 files.
    pub fn differences(&self, folder: &Path) -> io::Result<Vec<String>> {
        let mut there = listed(folder)?;
        let mut found = Vec::new();
        for (path, content) in &self.files {
            match there.remove(path) {
                None => found.push(format!("{path} was removed")),
                Some(Held::File { bytes })
                    // The size first: reading the file costs more.
                    if bytes == content.bytes && sha256(&folder.join(path))? == content.sha256 => {}
                Some(_) => found.push(format!("{path} was edited")),
            }
        }
        // Folders have no entry of their own. In sorted order, the first path from `folder/` on shows whether
        // the folder contains a file of ours; an added empty folder is a change.
        there.retain(|path, held| {
            let below = format!("{path}/");
            let first = self.files.range(below.clone()..).next();
            *held != Held::Folder || !first.is_some_and(|(p, _)| p.starts_with(&below))
        });
        found.extend(there.into_keys().map(|path| format!("{path} was added")));
        if fs::read(folder.join(MANIFEST))? != self.bytes()? {
            found.push(format!("{MANIFEST} was edited"));
        }
        Ok(found)
    }

    fn bytes(&self) -> io::Result<Vec<u8>> {
        let mut bytes = serde_json::to_vec_pretty(self)?;
        bytes.push(b'\n');
        Ok(bytes)
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Held {
    File {
        bytes: u64,
    },
    Folder,
    /// Something else: a link, a pipe, a device.
    Other,
}

/// Everything below a folder but its manifest.
fn listed(folder: &Path) -> io::Result<BTreeMap<String, Held>> {
    let mut found = BTreeMap::new();
    let mut open = vec![(folder.to_owned(), String::new())];
    while let Some((path, prefix)) = open.pop() {
        for entry in fs::read_dir(&path)? {
            let entry = entry?;
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            // Of the entry itself: a link is not followed.
            let meta = entry.metadata()?;
            if name == MANIFEST && meta.is_file() {
                continue;
            }
            let held = match (meta.is_file(), meta.is_dir()) {
                (true, _) => Held::File { bytes: meta.len() },
                (_, true) => Held::Folder,
                _ => Held::Other,
            };
            if held == Held::Folder {
                open.push((entry.path(), format!("{name}/")));
            }
            found.insert(name, held);
            if found.len() > MAX_ENTRIES {
                return Err(io::Error::other(format!("it holds more than {MAX_ENTRIES} files")));
            }
        }
    }
    Ok(found)
}

/// SHA-256 of a file, in hex.
///
/// # Errors
/// If it cannot be read.
pub fn sha256(path: &Path) -> io::Result<String> {
    let mut file = files::open_regular(path)?;
    // Piece by piece: results hold files of hundreds of megabytes.
    let mut digest = Sha256::new();
    let mut piece = vec![0; PIECE];
    loop {
        match file.read(&mut piece)? {
            0 => return Ok(hex(&digest.finalize())),
            n => digest.update(&piece[..n]),
        }
    }
}

/// Bytes as hexadecimal digits.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder as a command leaves it.
    fn written() -> tempfile::TempDir {
        let temp = tempfile::tempdir().unwrap();
        fs::create_dir_all(temp.path().join("meshes/visual")).unwrap();
        fs::write(temp.path().join("report.json"), "{}").unwrap();
        fs::write(temp.path().join("meshes/visual/lid.obj"), "v 0 0 0").unwrap();
        Manifest::write(temp.path(), ResultKind::Reconstruct).unwrap();
        temp
    }

    fn differences(temp: &tempfile::TempDir) -> Vec<String> {
        Manifest::read(temp.path()).unwrap().differences(temp.path()).unwrap()
    }

    #[test]
    fn it_names_program_command_and_every_file() {
        let temp = written();
        let text = fs::read_to_string(temp.path().join(MANIFEST)).unwrap();
        let [lid, report] = [
            "7b6f74e68a82e1ba99b66e56054d46975b1869661ffa0c7f17301f69cbb64463",
            "44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a",
        ];
        let expected = format!(
            "{{\n  \"artitwin\": \"{}\",\n  \"command\": \"reconstruct\",\n  \"files\": {{\n    \
             \"meshes/visual/lid.obj\": {{\n      \"bytes\": 7,\n      \"sha256\": \"{lid}\"\n    }},\n    \
             \"report.json\": {{\n      \"bytes\": 2,\n      \"sha256\": \"{report}\"\n    }}\n  }}\n}}\n",
            env!("CARGO_PKG_VERSION")
        );
        assert_eq!(text, expected);
        assert_eq!(differences(&temp), [""; 0]);
    }

    #[test]
    fn every_change_is_seen() {
        let changes: [(&str, fn(&Path), &[&str]); 8] = [
            ("edited", |f| fs::write(f.join("report.json"), "[]").unwrap(), &["report.json was edited"]),
            ("longer", |f| fs::write(f.join("report.json"), "{}\n").unwrap(), &["report.json was edited"]),
            (
                "added",
                |f| fs::write(f.join("meshes/notes.txt"), "").unwrap(),
                &["meshes/notes.txt was added"],
            ),
            ("hidden", |f| fs::write(f.join(".notes"), "").unwrap(), &[".notes was added"]),
            ("folder", |f| fs::create_dir(f.join("empty")).unwrap(), &["empty was added"]),
            (
                "removed",
                |f| fs::remove_dir_all(f.join("meshes")).unwrap(),
                &["meshes/visual/lid.obj was removed"],
            ),
            (
                "below",
                |f| fs::write(f.join("meshes/manifest.json"), "").unwrap(),
                &["meshes/manifest.json was added"],
            ),
            (
                "manifest",
                |f| {
                    let text = fs::read_to_string(f.join(MANIFEST)).unwrap();
                    fs::write(f.join(MANIFEST), format!("{text} ")).unwrap();
                },
                &["manifest.json was edited"],
            ),
        ];
        for (name, change, expected) in changes {
            let temp = written();
            change(temp.path());
            assert_eq!(differences(&temp), expected, "{name}");
        }
    }

    #[test]
    #[cfg(unix)]
    fn a_link_is_a_change_though_it_leads_to_the_same_bytes() {
        let temp = written();
        let (file, other) = (temp.path().join("report.json"), tempfile::tempdir().unwrap());
        fs::rename(&file, other.path().join("report.json")).unwrap();
        std::os::unix::fs::symlink(other.path().join("report.json"), &file).unwrap();
        assert_eq!(differences(&temp), ["report.json was edited"]);
        let manifest = temp.path().join(MANIFEST);
        fs::rename(&manifest, other.path().join(MANIFEST)).unwrap();
        std::os::unix::fs::symlink(other.path().join(MANIFEST), &manifest).unwrap();
        assert_eq!(Manifest::read(temp.path()), None);
    }

    #[test]
    fn what_is_no_manifest_is_none() {
        for text in ["", "{}", "null", "{\"artitwin\": \"1\", \"command\": \"paint\", \"files\": {}}"] {
            let temp = tempfile::tempdir().unwrap();
            fs::write(temp.path().join(MANIFEST), text).unwrap();
            assert_eq!(Manifest::read(temp.path()), None, "{text}");
        }
    }
}
