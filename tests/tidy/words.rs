//! Line lengths and words: what is read, not what is compiled.

use std::path::Path;

use super::reader::{Kind, kinds, read};

const MAX_COLUMNS: usize = 110;
/// Words that the house does not use in comments and strings, and what it says instead. A part of a word
/// counts where the entry starts with `~`.
const BANNED: [(&str, &str); 11] = [
    ("told", "reported, given, known"),
    ("tells", "says, shows, reports, distinguishes"),
    ("foretold", "predicted"),
    ("leans", "is tilted"),
    ("landing", "end point of a moved sample; its score"),
    ("landings", "end points of moved samples; their scores"),
    ("swivel", "unobservable spin"),
    ("cells of evidence", "independent samples"),
    ("~metre", "meter"),
    ("~colour", "color"),
    ("~neighbour", "neighbor"),
];

/// Lines of `src/`, `tests/` and `benches/` with too many columns. Lines of raw strings are data and stay as
/// they are.
pub fn long_lines() -> Vec<String> {
    let mut found = Vec::new();
    for folder in ["src", "tests", "benches"] {
        for (name, text) in files(folder) {
            for (number, line) in lines(&text) {
                let raw = line.iter().any(|(_, kind)| *kind == Kind::Raw);
                if line.len() > MAX_COLUMNS && !raw {
                    found.push(format!(
                        "{folder}/{name}:{number}: {} columns, {MAX_COLUMNS} at most",
                        line.len()
                    ));
                }
            }
        }
    }
    found
}

/// Uses of banned words in comments and strings of `src/`.
pub fn banned_words() -> Vec<String> {
    let mut found = Vec::new();
    for (name, text) in files("src") {
        for (number, line) in lines(&text) {
            let read: String =
                line.iter().map(|(c, kind)| if *kind == Kind::Code { '|' } else { *c }).collect();
            let used = BANNED.iter().filter(|(word, _)| holds(&read.to_lowercase(), word));
            found.extend(used.map(|(word, better)| {
                format!("src/{name}:{number}: \"{}\" (say: {better})", word.trim_start_matches('~'))
            }));
        }
    }
    found
}

/// Whether a line holds a word: whole, or as a part of another where the word starts with `~`.
fn holds(line: &str, word: &str) -> bool {
    if let Some(part) = word.strip_prefix('~') {
        return line.contains(part);
    }
    let letter = |c: char| c.is_alphanumeric() || c == '_';
    line.match_indices(word)
        .any(|(at, _)| !line[..at].ends_with(letter) && !line[at + word.len()..].starts_with(letter))
}

fn files(folder: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    read(&Path::new(env!("CARGO_MANIFEST_DIR")).join(folder), "", &mut found);
    assert!(!found.is_empty(), "{folder}/ was not found");
    found
}

fn lines(text: &str) -> Vec<(usize, Vec<(char, Kind)>)> {
    let chars = kinds(text);
    chars.split(|(c, _)| *c == '\n').enumerate().map(|(n, line)| (n + 1, line.to_vec())).collect()
}

#[test]
fn words_are_found_whole_or_in_part() {
    assert!(holds("as it was told.", "told") && !holds("foretold", "told") && !holds("told_by", "told"));
    assert!(holds("two millimetres", "~metre") && !holds("two millimeters", "~metre"));
}
