//! `docs/method.md` and what refers to it: numbers rise, references resolve, named files exist.
//!
//! A section is referred to as the document's path with its number (`5.3`), an equation as the path with its
//! number in parentheses (`(5.3)`).

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

const DOCUMENT: &str = "docs/method.md";
/// Where references stand.
const FOLDERS: [&str; 6] = ["src", "tests", "benches", "docs", "eval", "examples"];
const FILES: [&str; 4] = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md"];
const SUFFIXES: [&str; 4] = ["rs", "md", "py", "toml"];

/// Number of a section or an equation: `12` or `12.3`.
type Number = Vec<u32>;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn document() -> String {
    fs::read_to_string(root().join(DOCUMENT)).unwrap()
}

/// The number that a text begins with; a full stop behind it ends a sentence.
fn number(text: &str) -> Option<Number> {
    let end = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let digits = text[..end].trim_end_matches('.');
    let number: Option<Number> = digits.split('.').map(|n| n.parse().ok()).collect();
    number.filter(|n| n.len() <= 2)
}

/// The number of an equation in parentheses that a text begins with.
fn equation(text: &str) -> Option<Number> {
    let inside = text.strip_prefix('(')?.split(')').next()?;
    let plain = inside.chars().all(|c| c.is_ascii_digit() || c == '.');
    number(inside).filter(|n| plain && n.len() == 2 && n[0] > 0)
}

/// Numbers of the sections, in their order.
fn sections(document: &str) -> Vec<Number> {
    let title = |line: &str| number(line.strip_prefix("## ").or(line.strip_prefix("### "))?);
    document.lines().filter_map(title).collect()
}

/// Numbers of the equations, in their order.
fn equations(document: &str) -> Vec<Number> {
    document.match_indices("\\tag{").filter_map(|(at, tag)| number(&document[at + tag.len()..])).collect()
}

/// Texts in which references may stand, by path.
fn texts() -> Vec<(String, String)> {
    let mut found = Vec::new();
    FOLDERS.iter().for_each(|folder| read(&root().join(folder), &mut found));
    FILES.iter().for_each(|file| read(&root().join(file), &mut found));
    assert!(found.len() > 100, "src, tests and docs were not found");
    found
}

fn read(path: &Path, found: &mut Vec<(String, String)>) {
    if let Ok(entries) = fs::read_dir(path) {
        let mut paths: Vec<PathBuf> = entries.map(|e| e.unwrap().path()).collect();
        paths.sort();
        paths.iter().for_each(|p| read(p, found));
    } else if path.extension().is_some_and(|e| SUFFIXES.iter().any(|s| *s == e))
        && let Ok(text) = fs::read_to_string(path)
    {
        found.push((path.strip_prefix(root()).unwrap().display().to_string(), text));
    }
}

/// What stands behind each `word` of a text, with the number of its line.
fn behind<'a>(text: &'a str, word: &'a str) -> impl Iterator<Item = (usize, &'a str)> {
    text.match_indices(word).map(move |(at, w)| (text[..at].lines().count().max(1), &text[at + w.len()..]))
}

#[test]
fn numbers_of_sections_and_equations_rise() {
    let document = document();
    for (what, numbers) in [("section", sections(&document)), ("equation", equations(&document))] {
        assert!(numbers.len() > 50, "{} {what}s", numbers.len());
        for pair in numbers.windows(2) {
            let [before, after] = [&pair[0], &pair[1]];
            let next = if after.len() == 1 || before[0] != after[0] {
                after[0] == before[0] + 1 && after.get(1).is_none_or(|n| *n == 1)
            } else {
                after[1] == before.get(1).unwrap_or(&0) + 1
            };
            let skipped = what == "equation" && after[0] > before[0] && after[1] == 1;
            assert!(next || skipped, "{what} {after:?} after {before:?}");
        }
    }
}

#[test]
fn references_resolve() {
    let document = document();
    let sections: BTreeSet<Number> = sections(&document).into_iter().collect();
    let equations: BTreeSet<Number> = equations(&document).into_iter().collect();
    let mut lost = Vec::new();
    let mut count = 0;
    for (name, text) in texts() {
        for (line, rest) in behind(&text, "docs/method.md ") {
            let resolves = match (number(rest), equation(rest)) {
                (Some(n), _) => sections.contains(&n),
                (None, Some(n)) => equations.contains(&n),
                (None, None) => continue,
            };
            count += 1;
            if !resolves {
                lost.push(format!("{name}:{line}: {}", rest.lines().next().unwrap_or_default()));
            }
        }
    }
    // Within the document the path is left out.
    for (line, rest) in behind(&document, "section ").chain(behind(&document, "sections ")) {
        if number(rest).is_some_and(|n| !sections.contains(&n)) {
            lost.push(format!("{DOCUMENT}:{line}: section {}", rest.lines().next().unwrap_or_default()));
        }
    }
    for (at, _) in document.match_indices('(') {
        if equation(&document[at..]).is_some_and(|n| !equations.contains(&n)) {
            lost.push(format!("{DOCUMENT}: {}", &document[at..at + document[at..].find(')').unwrap() + 1]));
        }
    }
    assert!(lost.is_empty(), "{count} references, of which nothing has the number of\n{}", lost.join("\n"));
}

#[test]
fn references_have_one_form() {
    let starts_number = |rest: &str| rest.trim_start().starts_with(|c: char| c.is_ascii_digit() || c == '(');
    let mut found = Vec::new();
    for (name, text) in texts().into_iter().filter(|(name, _)| name != "tests/method.rs") {
        for (at, word) in text.match_indices("ethod.md") {
            let rest = &text[at + word.len()..];
            let whole = text[..at].ends_with("docs/m");
            // A comment that breaks between the path and the number hides the reference.
            let broken = rest.strip_prefix('\n').is_some_and(|next| {
                starts_number(next.trim_start().trim_start_matches(['/', '!', '#', '*']))
            });
            if broken || (!whole && starts_number(rest)) {
                found.push(format!("{name}:{}", text[..at].lines().count()));
            }
        }
        for (line, rest) in behind(&text, "Eq. ").filter(|(_, rest)| starts_number(rest)) {
            found.push(format!("{name}:{line}: Eq. {}", rest.lines().next().unwrap_or_default()));
        }
    }
    assert!(found.is_empty(), "not of the form \"{DOCUMENT} 8.6\":\n{}", found.join("\n"));
}

#[test]
fn files_that_the_document_names_exist() {
    let document = document();
    let quoted = document.split('`').skip(1).step_by(2);
    let named = quoted.filter(|q| {
        q.split('/').next().is_some_and(|f| FOLDERS.contains(&f)) && q.contains('/') && !q.contains(' ')
    });
    let (there, gone): (Vec<&str>, Vec<&str>) = named.partition(|q| root().join(q).exists());
    assert!(gone.is_empty(), "named in {DOCUMENT}, but gone:\n{}", gone.join("\n"));
    assert!(there.len() > 50, "{} files", there.len());
}
