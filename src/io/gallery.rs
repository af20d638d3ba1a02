//! The results under some folders, as cards of a gallery.

use std::{
    ffi::OsStr,
    fs, io,
    path::{Component, Path, PathBuf},
};

use serde::de::DeserializeOwned;

use super::manifest::{MANIFEST, Manifest, ResultKind};
use common::files;
use common::limits::{FileLimit, REPORT};
use export::{GalleryCard, ReadJoint, ReadReport, counted_noun};
use gap::judge::report_json::ReadDiagnosis;

/// Depth to which folders are searched: objects in dates in labs.
const MAX_DEPTH: usize = 6;
/// Largest number of searched folders.
const MAX_FOLDERS: usize = 100_000;
/// Size limit of a card's picture; the program's own have a tenth of it.
const PICTURE: FileLimit = FileLimit { what: "a picture of a gallery", bytes: 2 << 20 };

/// Results, and unreadable ones with the reason.
#[derive(Clone, Debug, Default)]
pub struct Gallery {
    /// Cards, sorted by folder.
    pub cards: Vec<GalleryCard>,
    /// A sentence for each unreadable result.
    pub unread: Vec<String>,
}

/// Reads the results of `reconstruct` and `diagnose` under some folders, for a page in `page_folder`.
///
/// # Errors
/// The given folder that cannot be read, and why.
pub fn read_gallery(roots: &[PathBuf], page_folder: &Path) -> Result<Gallery, (PathBuf, io::Error)> {
    let absolute = |path: &Path| fs::canonicalize(path).map_err(|e| (path.to_owned(), e));
    let from = absolute(page_folder)?;
    let mut results: Vec<PathBuf> = Vec::new();
    for root in roots {
        find(&absolute(root)?, MAX_DEPTH, &mut 0, &mut results).map_err(|e| (root.clone(), e))?;
    }
    results.sort();
    results.dedup();
    let mut gallery = Gallery::default();
    for folder in results {
        match card(&folder, &relative(&from, &folder)) {
            Ok(card) => gallery.cards.extend(card),
            Err(why) => gallery.unread.push(format!("{}: {why}", folder.display())),
        }
    }
    Ok(gallery)
}

/// Collects folders with a manifest. Folders inside them, links and hidden names, which may be unfinished
/// results, are not searched.
fn find(folder: &Path, depth: usize, seen: &mut usize, results: &mut Vec<PathBuf>) -> io::Result<()> {
    if folder.join(MANIFEST).is_file() {
        results.push(folder.to_owned());
        return Ok(());
    }
    *seen += 1;
    if depth == 0 || *seen > MAX_FOLDERS {
        return Ok(());
    }
    for entry in fs::read_dir(folder)?.flatten() {
        let is_hidden = entry.file_name().as_encoded_bytes().starts_with(b".");
        if !is_hidden && entry.file_type().is_ok_and(|t| t.is_dir()) {
            // A folder without permission to read holds none of our results.
            find(&entry.path(), depth - 1, seen, results).ok();
        }
    }
    Ok(())
}

/// The card of a result; `None` for results without a card.
fn card(folder: &Path, at: &Path) -> Result<Option<GalleryCard>, String> {
    let manifest = Manifest::read(folder).ok_or_else(|| format!("{MANIFEST} cannot be read"))?;
    let own = folder.file_name().unwrap_or(OsStr::new("result")).to_string_lossy().into_owned();
    let mut name = own.clone();
    let (verdict, found) = match manifest.command {
        ResultKind::Reconstruct => {
            let report: ReadReport = report_of(folder)?;
            if !report.name.is_empty() {
                name.clone_from(&report.name);
            }
            (twin_verdict(&report, &own), report.joints.iter().filter_map(motion).collect())
        }
        ResultKind::Diagnose => {
            let report: ReadDiagnosis = report_of(folder)?;
            let is_good = report.verdict == "none" || report.verdict == "named";
            let found = report.findings.iter();
            let found = found.map(|f| format!("{}: {}", f.joint, f.effect.replace('_', " "))).collect();
            ((report.verdict, is_good), found)
        }
        _ => return Ok(None),
    };
    let pages = [("report", "report.html"), ("viewer", "viewer.html")];
    let links = pages.iter().filter(|(_, file)| folder.join(file).is_file());
    Ok(Some(GalleryCard {
        name,
        folder: at.display().to_string(),
        picture: files::read_limited(&folder.join("preview/thumbnail.png"), PICTURE).ok(),
        verdict,
        found,
        links: links.map(|(name, file)| ((*name).to_owned(), encoded(&at.join(file)))).collect(),
    }))
}

fn report_of<T: DeserializeOwned>(folder: &Path) -> Result<T, String> {
    let failed = |why: String| format!("report.json: {why}");
    let text = files::read_text(&folder.join("report.json"), REPORT).map_err(|e| failed(e.to_string()))?;
    serde_json::from_str(&text).map_err(|e| failed(e.to_string()))
}

fn twin_verdict(report: &ReadReport, folder: &str) -> (String, bool) {
    let parts = counted_noun(report.links.len(), "part");
    if folder.ends_with("_rejected") {
        return (format!("{parts}, rejected"), false);
    }
    match report.warnings.len() {
        0 => (format!("{parts}, no warnings"), true),
        n => (format!("{parts}, {}", counted_noun(n, "warning")), false),
    }
}

fn motion(joint: &ReadJoint) -> Option<String> {
    let motion = joint.motion.as_ref()?;
    let value = motion.value?;
    Some(if motion.unit == "rad" {
        format!("{} turns {:.1}\u{b0}", joint.child, value.to_degrees())
    } else {
        format!("{} slides {:.1} mm", joint.child, 1e3 * value)
    })
}

/// A path relative to a folder; both are given absolute.
fn relative(from: &Path, to: &Path) -> PathBuf {
    let (from, to): (Vec<Component>, Vec<Component>) =
        (from.components().collect(), to.components().collect());
    let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    let up = from[shared..].iter().map(|_| Component::ParentDir);
    up.chain(to[shared..].iter().copied()).collect()
}

/// A relative path as part of an address (RFC 3986, 2.1).
fn encoded(path: &Path) -> String {
    let mut text = String::new();
    for byte in path.as_os_str().as_encoded_bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' => {
                text.push(char::from(*byte));
            }
            _ => text.push_str(&format!("%{byte:02X}")),
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(folder: &Path, name: &str, text: &str) {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    #[test]
    fn results_are_found_wherever_they_lie_and_damage_is_told_apart() {
        let temp = tempfile::tempdir().unwrap();
        let manifest = |of: &str| format!(r#"{{"artitwin": "0", "command": "{of}", "files": {{}}}}"#);
        let twin = temp.path().join("lab/a b");
        write(&twin, MANIFEST, &manifest("reconstruct"));
        write(
            &twin,
            "report.json",
            r#"{"name": "box", "links": [{}, {}], "warnings": [{}], "joints":
               [{"child": "lid", "motion": {"value": 1.5707963, "unit": "rad"}}]}"#,
        );
        write(&twin, "report.html", "");
        write(&twin, "preview/thumbnail.png", "png");
        // What lies inside of a result belongs to it.
        write(&twin, &format!("inner/{MANIFEST}"), "{}");
        let diagnosis = temp.path().join("gap");
        write(&diagnosis, MANIFEST, &manifest("diagnose"));
        write(
            &diagnosis,
            "report.json",
            r#"{"verdict": "named", "findings": [{"joint": "j", "effect": "coulomb_friction"}]}"#,
        );
        write(temp.path(), &format!("made/{MANIFEST}"), &manifest("synth"));
        write(temp.path(), &format!("torn/{MANIFEST}"), "{");
        write(temp.path(), &format!(".unfinished/{MANIFEST}"), "{");
        let page = temp.path().join("pages");
        fs::create_dir(&page).unwrap();
        let found = read_gallery(&[temp.path().to_owned(), temp.path().join("lab")], &page).unwrap();
        assert_eq!(found.cards.len(), 2, "{found:?}");
        assert!(found.unread.len() == 1 && found.unread[0].contains("torn"), "{found:?}");
        let [gap, own] = &found.cards[..] else { panic!() };
        assert_eq!((gap.name.as_str(), gap.found[0].as_str()), ("gap", "j: coulomb friction"));
        assert_eq!(gap.verdict, ("named".to_owned(), true));
        assert_eq!(own.found, ["lid turns 90.0\u{b0}"]);
        assert_eq!(own.verdict, ("2 parts, 1 warning".to_owned(), false));
        assert_eq!(own.links, [("report".to_owned(), "../lab/a%20b/report.html".to_owned())]);
        assert_eq!(own.picture.as_deref(), Some(b"png".as_slice()));
        assert!(
            read_gallery(&[temp.path().to_owned(), temp.path().join("nowhere")], &page)
                .unwrap_err()
                .0
                .ends_with("nowhere")
        );
    }
}
