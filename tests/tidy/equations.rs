//! Equations of `docs/method.md`: what cites them, and the table of the published ones.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    ops::RangeInclusive,
    path::Path,
};

use super::reader::{Kind, Source, functions, kinds, sources};

const DOCUMENT: &str = "docs/method.md";
/// Title of the section that holds the table.
const TABLE: &str = "\n### 12.12 ";
/// Equations of the published supplement: the table has each of them.
const PUBLISHED: RangeInclusive<u32> = 17..=34;

/// Number of a section or an equation: `12` or `12.8`.
type Number = Vec<u32>;

/// A row of the table.
struct Row {
    published: Vec<u32>,
    here: Vec<Number>,
    file: String,
    function: String,
}

/// Equations that no comment of `src/` and no row of the table cites.
pub fn uncited() -> Vec<String> {
    let document = document();
    let mut known: BTreeSet<Number> = rows(&document).into_iter().flatten().flat_map(|r| r.here).collect();
    for source in sources() {
        known.extend(equations(&comments(&source.text)).into_iter().map(|(_, number)| number));
    }
    tags(&document).difference(&known).map(|n| format!("({})", written(n))).collect()
}

/// Citations in comments of `src/` that name no equation and no section of the document.
pub fn lost() -> Vec<String> {
    let document = document();
    let (tags, titles) = (tags(&document), titles(&document));
    let mut found = Vec::new();
    for source in sources() {
        let text = comments(&source.text);
        let place = |at: usize| format!("src/{}:{}", source.name, text[..at].lines().count().max(1));
        for (at, number) in equations(&text) {
            if !tags.contains(&number) {
                found.push(format!("{}: equation ({})", place(at), written(&number)));
            }
        }
        for (at, number) in sections(&text) {
            if !titles.contains(&number) {
                found.push(format!("{}: section {}", place(at), written(&number)));
            }
        }
    }
    found
}

/// What is wrong with the table.
pub fn wrong_rows() -> Vec<String> {
    let sources: BTreeMap<String, Source> =
        sources().into_iter().map(|s| (format!("src/{}", s.name), s)).collect();
    let mut found = Vec::new();
    let mut missing: BTreeSet<u32> = PUBLISHED.collect();
    for row in rows(&document()) {
        match row {
            Err(line) => found.push(format!("not a row of five cells: {line}")),
            Ok(row) => {
                row.published.iter().for_each(|n| _ = missing.remove(n));
                found.extend(wrong(&row, &sources));
            }
        }
    }
    found.extend(missing.into_iter().map(|n| format!("no row has the published equation {n}")));
    found
}

/// What is wrong with a row: its function must stand in its file, and the file must cite its equations.
fn wrong(row: &Row, sources: &BTreeMap<String, Source>) -> Vec<String> {
    let Row { file, function, .. } = row;
    let Some(source) = sources.get(file) else {
        return vec![format!("{file} is not there")];
    };
    let mut found = Vec::new();
    if !functions(&source.code).iter().any(|(name, _)| name == function) {
        found.push(format!("{file} has no fn {function}"));
    }
    let cited: BTreeSet<Number> =
        equations(&comments(&source.text)).into_iter().map(|(_, number)| number).collect();
    let uncited = row.here.iter().filter(|n| !cited.contains(*n));
    found.extend(uncited.map(|n| format!("{file} does not cite ({})", written(n))));
    found
}

fn document() -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(DOCUMENT)).unwrap()
}

/// Rows of the table; as an error a line that is none.
fn rows(document: &str) -> Vec<Result<Row, String>> {
    let (_, section) = document.split_once(TABLE).unwrap_or_default();
    let table = section.lines().take_while(|line| !line.starts_with("##"));
    let lines = table.filter(|line| line.starts_with('|')).skip(2);
    lines.map(|line| row(line).ok_or_else(|| line.to_owned())).collect()
}

fn row(line: &str) -> Option<Row> {
    let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
    if cells.len() != 5 {
        return None;
    }
    let quoted = |cell: &str| -> Option<String> {
        let inside = cell.strip_prefix('`')?.strip_suffix('`')?;
        Some(inside.to_owned())
    };
    let here: Vec<Number> = equations(cells[2]).into_iter().map(|(_, number)| number).collect();
    if here.is_empty() {
        return None;
    }
    Some(Row { published: published(cells[0])?, here, file: quoted(cells[3])?, function: quoted(cells[4])? })
}

/// Numbers of a first cell: `19`, `21, 24`, `17 to 24`.
fn published(cell: &str) -> Option<Vec<u32>> {
    let mut numbers = Vec::new();
    for part in cell.split(',') {
        let (from, to) = part.split_once(" to ").unwrap_or((part, part));
        let from: u32 = from.trim().parse().ok()?;
        let to: u32 = to.trim().parse().ok()?;
        numbers.extend(from..=to);
    }
    Some(numbers)
}

/// Numbers of the equations that a document has.
fn tags(document: &str) -> BTreeSet<Number> {
    let inside = document.split("\\tag{").skip(1).filter_map(|rest| rest.split('}').next());
    inside.filter_map(number).collect()
}

/// Numbers of the sections that a document has.
fn titles(document: &str) -> BTreeSet<Number> {
    let title = |line: &str| {
        let rest = line.strip_prefix("## ").or_else(|| line.strip_prefix("### "))?;
        number(rest.split(' ').next()?)
    };
    document.lines().filter_map(title).collect()
}

/// The comments of a source; all else is blank, and lines stay.
fn comments(text: &str) -> String {
    let kept = |(c, kind): (char, Kind)| if kind == Kind::Comment || c == '\n' { c } else { ' ' };
    kinds(text).into_iter().map(kept).collect()
}

/// Equations that a text cites, `(12.8)`, with their places.
fn equations(text: &str) -> Vec<(usize, Number)> {
    let cited = |(at, _): (usize, &str)| {
        let (inside, _) = text[at + 1..].split_once(')')?;
        let number = number(inside).filter(|n| n.len() == 2)?;
        Some((at, number))
    };
    text.match_indices('(').filter_map(cited).collect()
}

/// Sections that a text cites by the document's path, one or a list of them, with the places of the paths.
fn sections(text: &str) -> Vec<(usize, Number)> {
    let path = format!("{DOCUMENT} ");
    let mut found = Vec::new();
    for (at, _) in text.match_indices(&path) {
        let rest = &text[at + path.len()..];
        let end = rest.find(|c: char| !c.is_ascii_digit() && !"., ".contains(c)).unwrap_or(rest.len());
        let items = rest[..end].split(", ").filter_map(|item| number(item.trim_matches(['.', ',', ' '])));
        found.extend(items.map(|number| (at, number)));
    }
    found
}

/// `12` or `12.8`. A factor such as 0.5 or 1.05 is no number of an equation.
fn number(text: &str) -> Option<Number> {
    let part = |digits: &str| {
        let is_plain = digits.bytes().all(|b| b.is_ascii_digit()) && !digits.starts_with('0');
        digits.parse::<u32>().ok().filter(|_| is_plain)
    };
    let parts: Option<Number> = text.split('.').map(part).collect();
    parts.filter(|n| n.len() <= 2)
}

fn written(number: &[u32]) -> String {
    number.iter().map(u32::to_string).collect::<Vec<_>>().join(".")
}

#[test]
fn citations_are_read_from_comments_alone() {
    let text = "/// By docs/method.md (12.8) and (3.5), not 0.5 (1.05), (2) or (0.5).\n\
                // docs/method.md 2.8, 4, 5) and docs/method.md 6.\nlet a = f(7.7);\nlet b = \"(8.8)\";\n";
    let comments = comments(text);
    let numbers = |found: Vec<(usize, Number)>| found.iter().map(|f| written(&f.1)).collect::<Vec<_>>();
    assert_eq!(numbers(equations(&comments)), ["12.8", "3.5"]);
    assert_eq!(numbers(sections(&comments)), ["2.8", "4", "5", "6"]);
}

#[test]
fn a_table_is_read_and_its_faults_are_found() {
    let text = "## 12 Fields\n$$ x \\tag{12.8} $$\n### 12.12 Table\n\
                | a | b | c | d | e |\n|---|---|---|---|---|\n\
                | 17 to 19, 24 | a | (12.8) | `src/f.rs` | `go` |\n\
                | 20 | a | (12.8), (12.9) | `src/f.rs` | `gone` |\n\
                | 21 | a | (12.8) | `src/g.rs` | `go` |\n| 22 | a | none | `src/f.rs` | `go` |\n\
                ## 13 Next\n| 23 | a | (12.8) | `src/f.rs` | `go` |\n";
    assert_eq!(tags(text), BTreeSet::from([vec![12, 8]]));
    assert_eq!(titles(text), BTreeSet::from([vec![12], vec![12, 12], vec![13]]));
    let code = "fn go() {}\n".to_owned();
    let source = Source { name: "f.rs".to_owned(), text: format!("// (12.8)\n{code}"), code };
    let sources = BTreeMap::from([("src/f.rs".to_owned(), source)]);
    let found = rows(text);
    assert_eq!(found.len(), 4);
    let faults = |k: usize| found[k].as_ref().map_or_else(|line| vec![line.clone()], |r| wrong(r, &sources));
    assert_eq!(found[0].as_ref().ok().map(|r| r.published.clone()), Some(vec![17, 18, 19, 24]));
    assert!(faults(0).is_empty());
    assert_eq!(faults(1), ["src/f.rs has no fn gone", "src/f.rs does not cite (12.9)"]);
    assert_eq!(faults(2), ["src/g.rs is not there"]);
    assert!(found[3].is_err());
}
