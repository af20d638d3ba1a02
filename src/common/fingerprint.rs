//! The inputs of a result (recordings, settings, seed, version), and the key under which the result is kept.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
    hash::Hasher as _,
    io::{self, Read as _, Seek as _, SeekFrom},
    path::Path,
};

use serde::{Deserialize, Serialize};
use twox_hash::XxHash64;

use crate::files::{files_below, open_regular};

/// The key of a kept result: its stage, and a digest of everything it depends on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Key {
    pub(crate) stage: String,
    digest: u64,
}

impl Key {
    /// The key of a result that depends on these byte strings.
    pub fn of<'a>(stage: &str, pieces: impl IntoIterator<Item = &'a [u8]>) -> Self {
        Self { stage: stage.to_owned(), digest: digest(pieces) }
    }
}

/// As a file name.
impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-{:016x}", self.stage.replace('/', "."), self.digest)
    }
}

/// XXH64 of pieces of bytes.
fn digest<'a>(pieces: impl IntoIterator<Item = &'a [u8]>) -> u64 {
    let mut sum = XxHash64::default();
    for piece in pieces {
        // Lengths are included, so no two lists of pieces give the same bytes.
        sum.write(&(piece.len() as u64).to_le_bytes());
        sum.write(piece);
    }
    sum.finish()
}

/// Up to this size, bytes, a file is hashed whole; of a larger file, [`SAMPLES`] evenly spread pieces are
/// hashed.
const WHOLE_BYTES: u64 = 64 << 20;
/// Number of pieces.
const SAMPLES: u64 = 64;
/// Length of a piece, bytes.
const SAMPLE_BYTES: u64 = 1 << 20;

/// Named facts about a run. Two runs whose facts are equal compute the same.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Fingerprint(BTreeMap<String, String>);

impl Fingerprint {
    /// Adds a fact.
    pub fn with(mut self, name: impl Into<String>, value: impl ToString) -> Self {
        self.0.insert(name.into(), value.to_string());
        self
    }

    /// Adds every leaf of a serializable value, e.g. of a configuration, as `name.key`.
    ///
    /// # Errors
    /// If it cannot be serialized.
    pub fn with_settings(mut self, name: &str, settings: &impl Serialize) -> io::Result<Self> {
        self.add(name, &serde_json::to_value(settings)?);
        Ok(self)
    }

    /// Adds the content of a file, or of all files of a folder. Names and sizes count; modification times and
    /// locations do not.
    ///
    /// # Errors
    /// If something cannot be read, or the folder holds more than 100,000 files.
    pub fn with_source(mut self, name: &str, path: &Path) -> io::Result<Self> {
        let files = if path.is_dir() { files_below(path)? } else { vec![String::new()] };
        let mut sum = XxHash64::default();
        let mut total = 0;
        for file in &files {
            let bytes = if file.is_empty() {
                add_content(path, &mut sum)?
            } else {
                add_content(&path.join(file), &mut sum)?
            };
            sum.write(file.as_bytes());
            total += bytes;
        }
        let value = format!("{} files, {total} bytes, content {:016x}", files.len(), sum.finish());
        self.0.insert(name.to_owned(), value);
        Ok(self)
    }

    /// Sentences about what differs from `other`, in terms of this one's facts.
    pub fn differences(&self, other: &Self) -> Vec<String> {
        let names: BTreeSet<&String> = self.0.keys().chain(other.0.keys()).collect();
        let show = |value: Option<&String>| value.map_or("absent", String::as_str).to_owned();
        let differs = |name: &&String| self.0.get(*name) != other.0.get(*name);
        names
            .into_iter()
            .filter(differs)
            .map(|n| format!("{n} is {}, was {}", show(self.0.get(n)), show(other.0.get(n))))
            .collect()
    }

    /// Only the facts whose names are `wanted`.
    #[must_use]
    pub fn only(&self, wanted: impl Fn(&str) -> bool) -> Self {
        Self(self.0.iter().filter(|(name, _)| wanted(name)).map(|(n, v)| (n.clone(), v.clone())).collect())
    }

    fn pieces(&self) -> impl Iterator<Item = &[u8]> {
        self.0.iter().flat_map(|(name, value)| [name.as_bytes(), value.as_bytes()])
    }

    /// The key of a result that depends on all facts.
    pub fn key(&self, stage: &str) -> Key {
        Key::of(stage, self.pieces())
    }

    /// A digest of all facts.
    pub fn text(&self) -> String {
        format!("{:016x}", digest(self.pieces()))
    }

    fn add(&mut self, name: &str, value: &serde_json::Value) {
        match value {
            serde_json::Value::Object(map) => {
                map.iter().for_each(|(key, inner)| self.add(&format!("{name}.{key}"), inner))
            }
            _ => drop(self.0.insert(name.to_owned(), value.to_string())),
        }
    }
}

/// Adds size and content of a file; returns its size, bytes.
fn add_content(path: &Path, sum: &mut XxHash64) -> io::Result<u64> {
    let named = |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", path.display()));
    let mut file = open_regular(path).map_err(named)?;
    let bytes = file.metadata().map_err(named)?.len();
    // The size too: of a large file only pieces are read.
    sum.write(&bytes.to_le_bytes());
    let pieces = if bytes <= WHOLE_BYTES { 1 } else { SAMPLES };
    let length = if pieces == 1 { bytes } else { SAMPLE_BYTES };
    let mut buffer = vec![0; 1 << 16];
    for piece in 0..pieces {
        // The last piece ends where the file does.
        let start = u128::from(bytes - length) * u128::from(piece) / u128::from((pieces - 1).max(1));
        file.seek(SeekFrom::Start(start as u64)).map_err(named)?;
        let mut rest = (&mut file).take(length);
        loop {
            match rest.read(&mut buffer).map_err(named)? {
                0 => break,
                n => sum.write(&buffer[..n]),
            }
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn differences_are_named() {
        let a = Fingerprint::default()
            .with("seed", 1)
            .with_settings("config", &serde_json::json!({"field": {"levels": 8}}))
            .unwrap();
        let b = Fingerprint::default()
            .with("seed", 2)
            .with_settings("config", &serde_json::json!({"field": {"levels": 12}}))
            .unwrap();
        assert_eq!(a.differences(&b), ["config.field.levels is 8, was 12", "seed is 1, was 2"]);
        assert_eq!(a.differences(&a), [""; 0]);
        assert_ne!(a.text(), b.text());
        assert_eq!(a.clone().with("extra", 3).differences(&a), ["extra is 3, was absent"]);
        assert_ne!(
            Fingerprint::default().with("ab", "c").text(),
            Fingerprint::default().with("a", "bc").text()
        );
    }

    #[test]
    fn the_content_of_a_recording_counts_and_its_place_does_not() {
        let root = tempfile::tempdir().unwrap();
        let make = |folder: &str, files: &[(&str, &str)]| {
            let folder = root.path().join(folder);
            for (name, text) in files {
                let path = folder.join(name);
                fs::create_dir_all(path.parent().unwrap()).unwrap();
                fs::write(path, text).unwrap();
            }
            Fingerprint::default().with_source("input", &folder).unwrap()
        };
        let a = make("a", &[("state0/x.mcap", "abc"), ("state1/x.mcap", "defg")]);
        assert_eq!(a, make("b", &[("state1/x.mcap", "defg"), ("state0/x.mcap", "abc")]));
        assert_ne!(a, make("c", &[("state0/x.mcap", "abd"), ("state1/x.mcap", "defg")]));
        assert_ne!(a, make("d", &[("state0/y.mcap", "abc"), ("state1/x.mcap", "defg")]));
        assert_ne!(a, make("e", &[("state0/x.mcap", "abcd"), ("state1/x.mcap", "efg")]));
        let file = |name: &str| Fingerprint::default().with_source("input", &root.path().join(name));
        assert!(file("a/state0/x.mcap").is_ok());
        assert!(file("a/missing").unwrap_err().to_string().contains("missing"));
    }

    #[test]
    fn a_large_file_is_sampled_to_its_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("large.bin");
        let digest = |tail: u8| {
            let mut file = fs::File::create(&path).unwrap();
            file.set_len(3 * WHOLE_BYTES).unwrap();
            file.seek(SeekFrom::End(-1)).unwrap();
            io::Write::write_all(&mut file, &[tail]).unwrap();
            Fingerprint::default().with_source("input", &path).unwrap().text()
        };
        assert_ne!(digest(0), digest(1));
    }
}
