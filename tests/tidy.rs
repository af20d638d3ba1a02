//! The rules of the house, checked by reading the source: rooms, purity, sizes, words, line
//! lengths, where constants come from, and which equations are cited where.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

#[path = "tidy/constants.rs"]
mod constants;
#[path = "tidy/equations.rs"]
mod equations;
#[path = "tidy/house.rs"]
mod house;
#[path = "tidy/language.rs"]
mod language;
#[path = "tidy/reader.rs"]
mod reader;
#[path = "tidy/words.rs"]
mod words;

use std::{collections::BTreeSet, io::Write as _};

use constants::ORIGINS;
use house::House;
use reader::{Source, blank, functions, paths, sources, without_tests};

/// What touches no file, environment or clock: crates, and modules of `common`.
const PURE: [&str; 12] = [
    "common/limits",
    "common/note",
    "numeric",
    "geometry",
    "capture",
    "surface",
    "synth",
    "field",
    "model",
    "gap",
    "articulate",
    "export",
];
/// What these do without.
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
const MAX_FUNCTION_LINES: usize = 120;

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
    let layers: BTreeSet<&str> = all.iter().map(|c| c.layer.as_str()).collect();
    for layer in layers {
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
fn numbers_in_code_have_names() {
    let found = constants::unnamed();
    assert!(found.is_empty(), "{} float literals without a name\n{}", found.len(), found.join("\n"));
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

/// Most of each gauge over all crates: per thousand lines, in percent, per thousand words.
const MOST_NAMED_CLOSURES: f64 = 8.0;
const MOST_TUPLE_LETS: f64 = 0.5;
const MOST_ONE_WORD_FUNCTIONS: f64 = 42.0;
const MOST_TUPLE_PARAMETERS: f64 = 1.1;
const MOST_RELATIVE_PRONOUNS: f64 = 20.0;

#[test]
fn the_code_reads_as_plain_statements() {
    // Not through the macros, whose output a test that passes swallows.
    let mut out = std::io::stderr();
    let all = language::gauges();
    for (layer, gauges) in &all {
        writeln!(out, "{layer}: {gauges}").unwrap();
    }
    let total = language::total(all.values());
    writeln!(out, "all: {total}").unwrap();
    assert!(total.named_closures_per_thousand_lines() <= MOST_NAMED_CLOSURES, "{total}");
    assert!(total.tuple_lets_per_thousand_lines() <= MOST_TUPLE_LETS, "{total}");
    assert!(total.percent_of_one_word() <= MOST_ONE_WORD_FUNCTIONS, "{total}");
    assert!(total.percent_with_tuple_parameters() <= MOST_TUPLE_PARAMETERS, "{total}");
    assert!(total.pronouns_per_thousand_words() <= MOST_RELATIVE_PRONOUNS, "{total}");
}

#[test]
fn named_closures_take_one_line() {
    let found = language::long_closures();
    assert!(found.is_empty(), "{} closures that could be functions\n{}", found.len(), found.join("\n"));
}

#[test]
fn types_of_a_crate_have_names_of_their_own() {
    let found = language::repeated_types();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn pure_layers_touch_no_file_environment_or_clock() {
    let is_pure = |name: &str| {
        PURE.iter().any(|pure| name.strip_prefix(pure).is_some_and(|rest| rest.starts_with(['/', '.'])))
    };
    let sources = sources();
    let pure: Vec<&Source> = sources.iter().filter(|s| is_pure(&s.name)).collect();
    for layer in PURE {
        assert!(pure.iter().any(|s| s.name.starts_with(layer)), "{layer} is not there");
    }
    let found: Vec<_> = pure
        .into_iter()
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
