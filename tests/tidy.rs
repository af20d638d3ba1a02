//! The rules of the house, checked by reading the source: layers, rooms, circles, purity, sizes, words, line
//! lengths, where constants come from, and which equations are cited where.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

#[path = "tidy/constants.rs"]
mod constants;
#[path = "tidy/equations.rs"]
mod equations;
#[path = "tidy/house.rs"]
mod house;
#[path = "tidy/reader.rs"]
mod reader;
#[path = "tidy/words.rs"]
mod words;

use std::{
    collections::{BTreeMap, BTreeSet},
    io::Write as _,
};

use constants::ORIGINS;
use house::{House, reached};
use reader::{Source, blank, functions, paths, sources, without_tests};

/// Modules of the crate; each may use itself and what stands before it.
const LAYERS: [&str; 23] = [
    "limits",
    "vectors",
    "lists",
    "note",
    "random",
    "statistics",
    "geometry",
    "capture",
    "surface",
    "synth",
    "field",
    "model",
    "gap",
    "articulate",
    "export",
    "files",
    "config",
    "io",
    "evaluate",
    "run",
    "node",
    "cli",
    "internal",
];
/// The first layer that may use files, environment or clock; those before it are pure.
const FIRST_IMPURE: &str = "files";
/// What a pure layer does without.
const IMPURE: [&str; 8] = [
    "std::fs",
    "std::env",
    "std::net",
    "std::process",
    "std::thread::sleep",
    "std::time::SystemTime",
    "std::time::Instant",
    "std::io::stdin",
];
/// Rooms of a layer, in the order data flows: each may use itself and what stands before it in its line.
const ROOMS: [&[&str]; 4] = [
    &[
        "articulate/observations",
        "articulate/samples",
        "articulate/pair",
        "articulate/matches",
        "articulate/propose",
        "articulate/world",
        "articulate/parts",
        "articulate/joints",
        "articulate/part_surface",
    ],
    &["articulate/observations", "articulate/neural"],
    &["gap/record", "gap/model", "gap/fit", "gap/judge", "gap/camera"],
    &["gap/camera/record", "gap/camera/model", "gap/camera/effects", "gap/camera/fit", "gap/camera/judge"],
];
const MAX_FILE_LINES: usize = 500;
const MAX_FUNCTION_LINES: usize = 80;

#[test]
fn layers_use_only_what_stands_before_them() {
    let rank = |layer: &str| LAYERS.iter().position(|l| *l == layer);
    let offence = |source: &Source, path: &str| {
        let used = path.split("::").nth(1).unwrap_or_default();
        (rank(used) > rank(source.layer())).then(|| format!("{} uses {path}", source.name))
    };
    let below_main = |s: &&Source| !["lib", "main"].contains(&s.layer());
    let sources = sources();
    for source in sources.iter().filter(below_main) {
        assert!(rank(source.layer()).is_some(), "{}: give the new layer a place in LAYERS", source.name);
    }
    let found: Vec<_> = sources
        .iter()
        .filter(below_main)
        .flat_map(|s| paths(&s.code, "crate").into_iter().filter_map(|p| offence(s, &p)))
        .collect();
    assert!(found.is_empty(), "order: {}\n{}", LAYERS.join(" < "), found.join("\n"));
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let house = House { sources: sources() };
    let arrows: BTreeMap<&str, BTreeSet<&str>> =
        house.sources.iter().map(|s| (s.name.as_str(), house.imports_of(s))).collect();
    let mut found = Vec::new();
    let mut seen = BTreeSet::new();
    for &file in arrows.keys() {
        let circle: Vec<&str> =
            reached(&arrows, file).into_iter().filter(|f| reached(&arrows, f).contains(file)).collect();
        if !circle.is_empty() && circle.iter().all(|f| seen.insert(*f)) {
            let inside = |f: &&str| {
                let to: Vec<_> = arrows[*f].iter().copied().filter(|t| circle.contains(t)).collect();
                format!("  {f} -> {}", to.join(", "))
            };
            let lines: Vec<String> = circle.iter().map(inside).collect();
            found.push(format!("a circle of {} files:\n{}", circle.len(), lines.join("\n")));
        }
    }
    assert!(found.is_empty(), "{} circles\n{}", found.len(), found.join("\n"));
}

#[test]
fn rooms_use_only_what_stands_before_them() {
    let house = House { sources: sources() };
    let mut found = Vec::new();
    for source in &house.sources {
        let used = house.imports_of(source).into_iter().filter(|used| breaks_order(&source.name, used));
        found.extend(used.map(|used| format!("{} uses {used}", source.name)));
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// Whether a file of a room of [`ROOMS`] uses one of the same layer that no line allows, or that a line
/// refuses.
fn breaks_order(file: &str, used: &str) -> bool {
    let place = |line: &[&str], file: &str| {
        let is_in = |room: &&str| file.strip_prefix(*room).is_some_and(|rest| rest.starts_with(['/', '.']));
        line.iter().position(is_in)
    };
    let layer = |file: &str| file.split('/').next().unwrap_or_default().to_owned();
    let has_room = |file: &str| ROOMS.iter().any(|line| place(line, file).is_some());
    if layer(file) != layer(used) || !has_room(file) || !has_room(used) {
        return false;
    }
    let both: Vec<_> =
        ROOMS.iter().filter_map(|line| Some((place(line, file)?, place(line, used)?))).collect();
    both.is_empty() || both.iter().any(|(own, other)| other > own)
}

#[test]
fn constants_say_where_they_come_from() {
    let all = constants::constants();
    for layer in ["articulate", "gap"] {
        let count =
            |origin: &str| all.iter().filter(|c| c.layer == layer && c.origin == Some(origin)).count();
        let counts = ORIGINS.map(|origin| format!("{origin} {}", count(origin)));
        // Not through the macros, whose output a test that passes swallows.
        writeln!(std::io::stderr(), "constants of {layer}: {}", counts.join(", ")).unwrap();
    }
    let missing: Vec<_> = all.iter().filter(|c| c.origin.is_none()).map(|c| c.place.as_str()).collect();
    assert!(
        missing.is_empty(),
        "{} float constants whose comment has none of {}\n{}",
        missing.len(),
        ORIGINS.join(" "),
        missing.join("\n")
    );
}

#[test]
fn every_equation_is_cited() {
    let found = equations::uncited();
    assert!(found.is_empty(), "equations of docs/method.md that src/ cites nowhere: {}", found.join(", "));
}

#[test]
fn citations_name_what_is_there() {
    let found = equations::lost();
    assert!(found.is_empty(), "not in docs/method.md:\n{}", found.join("\n"));
}

#[test]
fn published_equations_lead_to_their_functions() {
    let found = equations::wrong_rows();
    assert!(found.is_empty(), "the table of docs/method.md 12.12:\n{}", found.join("\n"));
}

#[test]
fn lines_are_short() {
    let found = words::long_lines();
    assert!(found.is_empty(), "{} long lines\n{}", found.len(), found.join("\n"));
}

#[test]
fn comments_and_messages_use_the_words_of_the_house() {
    let found = words::banned_words();
    assert!(found.is_empty(), "{} words\n{}", found.len(), found.join("\n"));
}

#[test]
fn pure_layers_touch_no_file_environment_or_clock() {
    let sources = sources();
    let pure_layers: Vec<&str> = LAYERS.into_iter().take_while(|layer| *layer != FIRST_IMPURE).collect();
    assert_eq!(pure_layers.last(), Some(&"export"), "the pure layers end with export");
    let pure = sources.iter().filter(|s| pure_layers.contains(&s.layer()));
    let found: Vec<_> = pure
        .flat_map(|s| paths(&s.code, "std").into_iter().map(|p| (s.name.clone(), p)))
        .filter(|(_, path)| IMPURE.iter().any(|i| path == i || path.starts_with(&format!("{i}::"))))
        .map(|(name, path)| format!("{name} uses {path}"))
        .collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn files_and_functions_are_short() {
    let mut found = Vec::new();
    for source in sources() {
        let lines = source.code.lines().count();
        if lines > MAX_FILE_LINES {
            found.push(format!("{}: {lines} lines, {MAX_FILE_LINES} at most", source.name));
        }
        let long = functions(&source.code).into_iter().filter(|(_, lines)| *lines > MAX_FUNCTION_LINES);
        found.extend(long.map(|(name, lines)| {
            format!("{}: fn {name} has {lines} lines, {MAX_FUNCTION_LINES} at most", source.name)
        }));
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn nothing_unwraps_or_prints_behind_the_callers_back() {
    let banned = [".unwrap()", ".expect(", "println!", "eprintln!", "todo!", "unimplemented!", "dbg!"];
    let lines = |s: Source| {
        let at = move |(n, line): (usize, &str)| {
            banned.iter().find(|b| line.contains(*b)).map(|b| format!("{}:{}: {b}", s.name, n + 1))
        };
        s.code.lines().enumerate().filter_map(at).collect::<Vec<_>>()
    };
    let found: Vec<_> = sources().into_iter().flat_map(lines).collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn the_reader_sees_code_and_nothing_else() {
    let text = r##"
        use std::{fs::{self, File}, io::Read as _}; // std::env
        /* std::net /* nested */ */
        const A: &str = "std::process \" {";
        const B: &str = r#"std::env "x" {"#;
        const C: [char; 3] = ['{', '\'', '"'];
        fn long<'a>(x: &'a [u8; 3]) -> bool where
            Self: Sized {
            crate::run::go();
            true
        }
        trait T { fn declared(&self); }
        #[cfg(test)]
        mod tests { fn t() { std::env::args().unwrap(); } }
        #[cfg(all(test, feature = "x"))]
        fn also() { std::net::y(); }
        fn after() {}
    "##;
    let code = without_tests(&blank(text));
    assert_eq!(paths(&code, "std"), ["std::fs::self", "std::fs::File", "std::io::Read"]);
    assert_eq!(paths(&code, "crate"), ["crate::run::go"]);
    assert_eq!(functions(&code), [("long".to_owned(), 5), ("after".to_owned(), 1)]);
}
