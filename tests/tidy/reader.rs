//! Reads Rust source well enough for the rules: what is code, what is comment, what is a literal.

use std::{fs, path::Path};

const TEST: &str = "#[cfg(test)]";

/// A source file, and its code without comments, literals and tests; lines are kept.
pub struct Source {
    /// Path below `src/`.
    pub name: String,
    /// The file as it is.
    pub text: String,
    pub code: String,
}

impl Source {
    pub fn layer(&self) -> &str {
        self.name.split(['/', '.']).next().unwrap_or_default()
    }
}

/// All files of `src/`; test modules in files of their own are left out.
pub fn sources() -> Vec<Source> {
    let mut sources = Vec::new();
    read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), "", &mut sources);
    let test_files: Vec<String> = sources.iter().flat_map(test_modules).collect();
    sources.retain(|(name, _)| !test_files.iter().any(|t| name.starts_with(t)));
    let clean = |(name, text): (String, String)| Source { name, code: without_tests(&blank(&text)), text };
    let sources: Vec<Source> = sources.into_iter().map(clean).collect();
    assert!(sources.len() > 20, "src/ was not found");
    sources
}

pub fn read(folder: &Path, prefix: &str, sources: &mut Vec<(String, String)>) {
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
    let below = if name.ends_with("mod.rs") || name.ends_with("lib.rs") {
        beside.clone()
    } else {
        format!("{}/", name.trim_end_matches(".rs"))
    };
    let declared = |rest: &str| {
        let rest = rest.trim_start();
        if let Some(path) = rest.strip_prefix("#[path = \"") {
            return Some(format!("{beside}{}", path.split_once(".rs\"")?.0));
        }
        let module = ["pub(super) ", "pub(crate) ", "pub ", ""]
            .iter()
            .find_map(|p| rest.strip_prefix(p)?.strip_prefix("mod "))?;
        let module = module.split_once(';')?.0.trim();
        module.chars().all(|c| c.is_alphanumeric() || c == '_').then(|| format!("{below}{module}"))
    };
    let text = uniform(text);
    let modules = text.split(TEST).skip(1).filter_map(declared);
    modules.flat_map(|module| [format!("{module}.rs"), format!("{module}/")]).collect()
}

/// What a character of a source file belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Code,
    Comment,
    /// A string or character literal.
    Literal,
    /// A raw string, which cannot be broken into lines.
    Raw,
}

/// Every character with what it belongs to.
pub fn kinds(text: &str) -> Vec<(char, Kind)> {
    let chars: Vec<char> = text.chars().collect();
    let starts = |at: usize, word: &str| word.chars().enumerate().all(|(k, c)| chars.get(at + k) == Some(&c));
    let mut found = Vec::with_capacity(chars.len());
    let mut at = 0;
    while at < chars.len() {
        let (end, kind) = if starts(at, "//") {
            let end = (at..chars.len()).find(|&k| chars[k] == '\n').unwrap_or(chars.len());
            (end, Kind::Comment)
        } else if starts(at, "/*") {
            (comment_end(&chars, at), Kind::Comment)
        } else if let Some(hashes) = raw_string(&chars, at) {
            let close = format!("\"{}", "#".repeat(hashes));
            let open = at + 2 + hashes;
            let end =
                (open..chars.len()).find(|&k| starts(k, &close)).map_or(chars.len(), |k| k + close.len());
            (end, Kind::Raw)
        } else if chars[at] == '"' {
            (quote_end(&chars, at, '"'), Kind::Literal)
        } else if chars[at] == '\'' && (chars.get(at + 1) == Some(&'\\') || chars.get(at + 2) == Some(&'\''))
        {
            (quote_end(&chars, at, '\''), Kind::Literal)
        } else {
            (at + 1, Kind::Code)
        };
        found.extend(chars[at..end].iter().map(|c| (*c, kind)));
        at = end;
    }
    found
}

/// Blanks comments, strings and character literals; keeps every line break.
pub fn blank(text: &str) -> String {
    let mut before = Kind::Code;
    let mut code = String::with_capacity(text.len());
    for (c, kind) in kinds(text) {
        if kind == Kind::Code || c == '\n' {
            code.push(c);
        } else if kind != before {
            code.push(' ');
        }
        before = kind;
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
    let after_word =
        at > 0 && (chars[at - 1].is_alphanumeric() || chars[at - 1] == '_') && chars[at - 1] != 'b';
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
pub fn without_tests(code: &str) -> String {
    replace_tests(code, |_| String::new())
}

/// The same; line numbers stay.
pub fn with_tests_blank(code: &str) -> String {
    replace_tests(code, |test| test.chars().filter(|c| *c == '\n').collect())
}

fn replace_tests(code: &str, by: impl Fn(&str) -> String) -> String {
    let code = uniform(code);
    let mut pieces = code.split(TEST);
    let mut kept = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let open = piece.find('{').unwrap_or(piece.len());
        let end = match piece.find(';') {
            Some(semicolon) if semicolon < open => semicolon + 1,
            _ => open + block_length(&piece[open..]),
        };
        kept.push_str(&by(&piece[..end]));
        kept.push_str(&piece[end..]);
    }
    kept
}

/// How much deeper in brackets and braces code is behind a character.
pub fn depth_change(c: char) -> i32 {
    i32::from("([{".contains(c)) - i32::from(")]}".contains(c))
}

/// Length of the group that starts with the bracket or brace at the start of `code`.
pub fn block_length(code: &str) -> usize {
    let mut depth = 0;
    for (at, c) in code.char_indices() {
        depth += depth_change(c);
        if depth == 0 {
            return at + 1;
        }
    }
    code.len()
}

/// Name and number of lines of every function with a body.
pub fn functions(code: &str) -> Vec<(String, usize)> {
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
pub fn paths(code: &str, root: &str) -> Vec<String> {
    let start = format!("{root}::");
    let own = |at: usize| !code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':');
    let tails =
        code.match_indices(&start).filter(|(at, _)| own(*at)).map(|(at, _)| &code[at + start.len()..]);
    tails.flat_map(|tail| spelled_out(root, tail)).collect()
}

/// The paths of the use tree at the start of `tree`, each below `prefix`.
pub fn spelled_out(prefix: &str, tree: &str) -> Vec<String> {
    let tree = tree.trim_start();
    if tree.starts_with('{') {
        let inside = &tree[1..block_length(tree) - 1];
        return split_at_commas(inside).into_iter().flat_map(|t| spelled_out(prefix, t)).collect();
    }
    let name: String = tree.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    match (name.is_empty(), tree[name.len()..].strip_prefix("::")) {
        (true, _) => Vec::new(),
        (false, Some(rest))
            if rest.trim_start().starts_with(|c: char| c.is_alphabetic() || c == '_' || c == '{') =>
        {
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
