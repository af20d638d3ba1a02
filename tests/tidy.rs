//! The rules of the house, checked by reading `src/`: layers, purity, sizes. Comments, literals and test modules do not count.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

use std::{fs, path::Path};

/// Modules of the crate; each may use itself and what stands before it.
const LAYERS: [&str; 17] = [
    "limits",
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
];
/// Layers without files, environment or clock.
const PURE: [&str; 10] = ["limits", "geometry", "capture", "surface", "synth", "field", "model", "gap", "articulate", "export"];
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
/// What every layer may use, with the reason.
const EXCEPTIONS: [&str; 3] = [
    // A pure function of seed, stage and step; it stands with the stages that it is for.
    "crate::run::stage_rng",
    // The seam through which `articulate` reads colors; a field implements it.
    "crate::articulate::ColorField",
    "crate::articulate::ColorSample",
];
const TEST: &str = "#[cfg(test)]";
const MAX_FILE_LINES: usize = 500;
const MAX_FUNCTION_LINES: usize = 80;

/// A source file without comments, literals and tests; lines are kept.
struct Source {
    /// Path below `src/`.
    name: String,
    code: String,
}

impl Source {
    fn layer(&self) -> &str {
        self.name.split(['/', '.']).next().unwrap_or_default()
    }
}

#[test]
fn layers_use_only_what_stands_before_them() {
    let rank = |layer: &str| LAYERS.iter().position(|l| *l == layer);
    let offence = |source: &Source, path: &str| {
        let used = path.split("::").nth(1).unwrap_or_default();
        let excepted = EXCEPTIONS.contains(&path);
        (!excepted && rank(used) > rank(source.layer())).then(|| format!("{} uses {path}", source.name))
    };
    let below_main = |s: &&Source| !["lib", "main"].contains(&s.layer());
    let sources = sources();
    for source in sources.iter().filter(below_main) {
        assert!(rank(source.layer()).is_some(), "{}: give the new layer a place in LAYERS", source.name);
    }
    let found: Vec<_> =
        sources.iter().filter(below_main).flat_map(|s| paths(&s.code, "crate").into_iter().filter_map(|p| offence(s, &p))).collect();
    assert!(found.is_empty(), "order: {}\n{}", LAYERS.join(" < "), found.join("\n"));
}

#[test]
fn pure_layers_touch_no_file_environment_or_clock() {
    let sources = sources();
    let pure = sources.iter().filter(|s| PURE.contains(&s.layer()));
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
        found.extend(long.map(|(name, lines)| format!("{}: fn {name} has {lines} lines, {MAX_FUNCTION_LINES} at most", source.name)));
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn nothing_unwraps_or_prints_behind_the_callers_back() {
    let banned = [".unwrap()", ".expect(", "println!", "eprintln!", "todo!", "unimplemented!", "dbg!"];
    let lines = |s: Source| {
        let at = move |(n, line): (usize, &str)| banned.iter().find(|b| line.contains(*b)).map(|b| format!("{}:{}: {b}", s.name, n + 1));
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

/// All files of `src/`; test modules in files of their own are left out.
fn sources() -> Vec<Source> {
    let mut sources = Vec::new();
    read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), "", &mut sources);
    let test_files: Vec<String> = sources.iter().flat_map(test_modules).collect();
    sources.retain(|(name, _)| !test_files.iter().any(|t| name.starts_with(t)));
    let clean = |(name, text): (String, String)| Source { name, code: without_tests(&blank(&text)) };
    let sources: Vec<Source> = sources.into_iter().map(clean).collect();
    assert!(sources.len() > 20, "src/ was not found");
    sources
}

fn read(folder: &Path, prefix: &str, sources: &mut Vec<(String, String)>) {
    let mut entries: Vec<_> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let name = format!("{prefix}{}", path.file_name().unwrap().to_str().unwrap());
        if path.is_dir() {
            read(&path, &format!("{name}/"), sources);
        } else if path.extension().is_some_and(|e| e == "rs") {
            sources.push((name, fs::read_to_string(&path).unwrap()));
        }
    }
}

/// Files and folders that a file declares by `#[cfg(test)] mod name;`, a `#[path]` between them or not.
fn test_modules((name, text): &(String, String)) -> Vec<String> {
    let beside = name.rsplit_once('/').map_or(String::new(), |(folder, _)| format!("{folder}/"));
    let below = if name.ends_with("mod.rs") { beside.clone() } else { format!("{}/", name.trim_end_matches(".rs")) };
    let declared = |rest: &str| {
        let rest = rest.trim_start();
        if let Some(path) = rest.strip_prefix("#[path = \"") {
            return Some(format!("{beside}{}", path.split_once(".rs\"")?.0));
        }
        let module = rest.trim_start_matches("pub(super) ").trim_start_matches("pub(crate) ").strip_prefix("mod ")?;
        let module = module.split_once(';')?.0.trim();
        module.chars().all(|c| c.is_alphanumeric() || c == '_').then(|| format!("{below}{module}"))
    };
    let text = uniform(text);
    let modules = text.split(TEST).skip(1).filter_map(declared);
    modules.flat_map(|module| [format!("{module}.rs"), format!("{module}/")]).collect()
}

/// Blanks comments, strings and character literals; keeps every line break.
fn blank(text: &str) -> String {
    let chars: Vec<char> = text.chars().collect();
    let starts = |at: usize, word: &str| word.chars().enumerate().all(|(k, c)| chars.get(at + k) == Some(&c));
    let mut code = String::with_capacity(text.len());
    let mut at = 0;
    while at < chars.len() {
        let end = if starts(at, "//") {
            (at..chars.len()).find(|&k| chars[k] == '\n').unwrap_or(chars.len())
        } else if starts(at, "/*") {
            comment_end(&chars, at)
        } else if let Some(hashes) = raw_string(&chars, at) {
            let close = format!("\"{}", "#".repeat(hashes));
            let open = at + 2 + hashes;
            (open..chars.len()).find(|&k| starts(k, &close)).map_or(chars.len(), |k| k + close.len())
        } else if chars[at] == '"' {
            quote_end(&chars, at, '"')
        } else if chars[at] == '\'' && (chars.get(at + 1) == Some(&'\\') || chars.get(at + 2) == Some(&'\'')) {
            quote_end(&chars, at, '\'')
        } else {
            code.push(chars[at]);
            at += 1;
            continue;
        };
        code.extend(chars[at..end].iter().filter(|c| **c == '\n'));
        code.push(' ');
        at = end;
    }
    code
}

fn comment_end(chars: &[char], start: usize) -> usize {
    let mut depth = 0;
    let mut at = start;
    while at < chars.len() {
        match chars[at..] {
            ['/', '*', ..] => (depth, at) = (depth + 1, at + 2),
            ['*', '/', ..] => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
        if depth == 0 {
            break;
        }
    }
    at
}

/// Number of hashes of a raw string that starts here.
fn raw_string(chars: &[char], at: usize) -> Option<usize> {
    let after_word = at > 0 && (chars[at - 1].is_alphanumeric() || chars[at - 1] == '_') && chars[at - 1] != 'b';
    if chars[at] != 'r' || after_word {
        return None;
    }
    let hashes = chars[at + 1..].iter().take_while(|c| **c == '#').count();
    (chars.get(at + 1 + hashes) == Some(&'"')).then_some(hashes)
}

fn quote_end(chars: &[char], start: usize, quote: char) -> usize {
    let mut at = start + 1;
    while at < chars.len() && chars[at] != quote {
        at += if chars[at] == '\\' { 2 } else { 1 };
    }
    (at + 1).min(chars.len())
}

/// Writes `#[cfg(all(test, ...))]` as [`TEST`].
fn uniform(code: &str) -> String {
    let mut pieces = code.split("#[cfg(all(test,");
    let mut text = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        text.push_str(TEST);
        text.push_str(piece.split_once(")]").map_or("", |(_, rest)| rest));
    }
    text
}

/// Removes what `#[cfg(test)]` stands before.
fn without_tests(code: &str) -> String {
    let code = uniform(code);
    let mut pieces = code.split(TEST);
    let mut kept = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let open = piece.find('{').unwrap_or(piece.len());
        let end = match piece.find(';') {
            Some(semicolon) if semicolon < open => semicolon + 1,
            _ => open + block_length(&piece[open..]),
        };
        kept.push_str(&piece[end..]);
    }
    kept
}

/// Length of the block that starts with the brace at the start of `code`.
fn block_length(code: &str) -> usize {
    let mut depth = 0;
    for (at, c) in code.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return at + 1;
        }
    }
    code.len()
}

/// Name and number of lines of every function with a body.
fn functions(code: &str) -> Vec<(String, usize)> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices("fn ") {
        let after_word = code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
        let name: String = code[at + 3..].chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
        // A semicolon inside brackets is an array length.
        let mut depth = 0;
        let end = code[at..].find(|c| {
            depth += i32::from("([".contains(c)) - i32::from(")]".contains(c));
            depth == 0 && (c == '{' || c == ';')
        });
        let Some(open) = end.map(|e| at + e).filter(|&e| code[e..].starts_with('{')) else { continue };
        if !after_word && !name.is_empty() {
            found.push((name, code[at..open + block_length(&code[open..])].lines().count()));
        }
    }
    found
}

/// All paths that start with `root::`, groups in braces spelled out.
fn paths(code: &str, root: &str) -> Vec<String> {
    let start = format!("{root}::");
    let own = |at: usize| !code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':');
    let tails = code.match_indices(&start).filter(|(at, _)| own(*at)).map(|(at, _)| &code[at + start.len()..]);
    tails.flat_map(|tail| spelled_out(root, tail)).collect()
}

/// The paths of the use tree at the start of `tree`, each below `prefix`.
fn spelled_out(prefix: &str, tree: &str) -> Vec<String> {
    let tree = tree.trim_start();
    if tree.starts_with('{') {
        let inside = &tree[1..block_length(tree) - 1];
        return split_at_commas(inside).into_iter().flat_map(|t| spelled_out(prefix, t)).collect();
    }
    let name: String = tree.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    match (name.is_empty(), tree[name.len()..].strip_prefix("::")) {
        (true, _) => Vec::new(),
        (false, Some(rest)) if rest.trim_start().starts_with(|c: char| c.is_alphabetic() || c == '_' || c == '{') => {
            spelled_out(&format!("{prefix}::{name}"), rest)
        }
        _ => vec![format!("{prefix}::{name}")],
    }
}

fn split_at_commas(list: &str) -> Vec<&str> {
    let mut depth = 0;
    list.split(|c| {
        depth += i32::from(c == '{') - i32::from(c == '}');
        c == ',' && depth == 0
    })
    .collect()
}
