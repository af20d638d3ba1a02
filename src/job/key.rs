//! The key of a job: a digest of all that determines its result.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::request::Reads;
use crate::{
    files::below,
    io::{hex, sha256, twin_path},
};

/// Hexadecimal digits.
const DIGITS: usize = 32;

/// The key of a job whose inputs have these identities.
#[must_use]
pub fn key(command: &str, name: &str, identities: &[(Reads, String)], settings: &Value) -> String {
    let inputs: Vec<Value> =
        identities.iter().map(|(reads, identity)| json!([format!("{reads:?}"), identity])).collect();
    let all = json!({
        "format": "artitwin-key/1",
        "version": env!("CARGO_PKG_VERSION"),
        "command": command,
        "name": name,
        "inputs": inputs,
        "settings": settings,
    });
    // Keys of a JSON object are sorted.
    hex(&Sha256::digest(all.to_string()))[..DIGITS].to_owned()
}

/// The identity of a file or folder of this machine, by names and contents, not by where it lies; and its
/// bytes.
///
/// # Errors
/// If something cannot be read, or there are more than 100,000 files.
pub fn content(path: &Path, reads: Reads) -> io::Result<(String, u64)> {
    if reads == Reads::Twin {
        return twin(path);
    }
    if !fs::metadata(path)?.is_dir() {
        return Ok((sha256(path)?, fs::metadata(path)?.len()));
    }
    of_files(below(path)?.iter().map(|file| (file.as_str(), path.join(file))))
}

/// The identity of a twin: its URDF, and the SDF and USD beside it.
fn twin(path: &Path) -> io::Result<(String, u64)> {
    // A folder without a URDF, or with several, is refused by the command: here it counts as what it holds.
    let Ok(urdf) = twin_path(path) else { return content(path, Reads::File) };
    let beside = [("sdf", urdf.with_file_name("model.sdf")), ("usd", urdf.with_extension("usda"))];
    let there = beside.into_iter().filter(|(_, path)| path.is_file());
    of_files(std::iter::once(("urdf", urdf.clone())).chain(there))
}

fn of_files<'a>(files: impl Iterator<Item = (&'a str, PathBuf)>) -> io::Result<(String, u64)> {
    let (mut digest, mut bytes) = (Sha256::new(), 0);
    for (name, path) in files {
        add(&mut digest, name, &sha256(&path)?);
        bytes += fs::metadata(&path)?.len();
    }
    Ok((hex(&digest.finalize()), bytes))
}

fn add(digest: &mut Sha256, name: &str, content: &str) {
    digest.update((name.len() as u64).to_le_bytes());
    digest.update(name);
    digest.update(content);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::temp::Temp;

    #[test]
    fn a_key_is_of_what_determines_the_result() {
        let inputs = |text: &str| vec![(Reads::Views, text.to_owned())];
        let of = |name: &str, input: &str, seed: u64| {
            key("reconstruct", name, &inputs(input), &json!({"seed": seed, "a": 1}))
        };
        let base = of("box", "x", 1);
        assert!(base.len() == 32 && base.chars().all(|c| c.is_ascii_hexdigit()), "{base}");
        assert_eq!(base, key("reconstruct", "box", &inputs("x"), &json!({"a": 1, "seed": 1})));
        for other in [of("box", "x", 2), of("box", "y", 1), of("lid", "x", 1)] {
            assert_ne!(base, other);
        }
    }

    #[test]
    fn content_counts_and_its_place_does_not() {
        let root = Temp::new("job-content");
        let write = |path: &str, text: &str| {
            let path = root.0.join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        let of = |path: &str, reads| content(&root.0.join(path), reads).unwrap().0;
        write("a/state0/x.mcap", "one");
        write("b/state0/x.mcap", "one");
        write("c/state0/y.mcap", "one");
        assert_eq!(of("a", Reads::Views), of("b", Reads::Views));
        assert_ne!(of("a", Reads::Views), of("c", Reads::Views));
        // A twin's report has times in it.
        write("run1/box.urdf", "<robot/>");
        write("run2/box.urdf", "<robot/>");
        write("run2/report.json", "{}");
        assert_eq!(of("run1", Reads::Twin), of("run2", Reads::Twin));
        assert_eq!(of("run1", Reads::Twin), of("run1/box.urdf", Reads::Twin));
        write("run2/box.usda", "");
        assert_ne!(of("run1", Reads::Twin), of("run2", Reads::Twin));
    }
}
