//! How the code reads, counted: closures, tuple lets, names, relative pronouns.

use std::{collections::BTreeMap, fmt};

use super::reader::{Kind, Source, block_length, depth_change, kinds, sources};

/// What is counted in one crate, outside tests.
#[derive(Clone, Debug, Default)]
pub struct Gauges {
    /// Lines with code.
    pub lines: usize,
    pub named_closures: usize,
    /// `let (a, b) = (x, y)`.
    pub tuple_lets: usize,
    pub functions: usize,
    pub one_word_functions: usize,
    pub tuple_parameters: usize,
    /// Words of comments.
    pub words: usize,
    pub relative_pronouns: usize,
}

impl Gauges {
    pub fn named_closures_per_thousand_lines(&self) -> f64 {
        1e3 * share(self.named_closures, self.lines)
    }

    pub fn tuple_lets_per_thousand_lines(&self) -> f64 {
        1e3 * share(self.tuple_lets, self.lines)
    }

    pub fn percent_of_one_word(&self) -> f64 {
        1e2 * share(self.one_word_functions, self.functions)
    }

    pub fn percent_with_tuple_parameters(&self) -> f64 {
        1e2 * share(self.tuple_parameters, self.functions)
    }

    pub fn pronouns_per_thousand_words(&self) -> f64 {
        1e3 * share(self.relative_pronouns, self.words)
    }
}

impl fmt::Display for Gauges {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} lines; a thousand lines: {:.1} named closures, {:.1} tuple lets; {} functions: {:.0} % \
             of one word, {:.1} % with a tuple parameter; {:.0} relative pronouns a thousand words",
            self.lines,
            self.named_closures_per_thousand_lines(),
            self.tuple_lets_per_thousand_lines(),
            self.functions,
            self.percent_of_one_word(),
            self.percent_with_tuple_parameters(),
            self.pronouns_per_thousand_words(),
        )
    }
}

fn share(count: usize, of: usize) -> f64 {
    count as f64 / of.max(1) as f64
}

/// The gauges of several crates together.
pub fn total<'a>(all: impl Iterator<Item = &'a Gauges>) -> Gauges {
    let mut total = Gauges::default();
    for gauges in all {
        total.lines += gauges.lines;
        total.named_closures += gauges.named_closures;
        total.tuple_lets += gauges.tuple_lets;
        total.functions += gauges.functions;
        total.one_word_functions += gauges.one_word_functions;
        total.tuple_parameters += gauges.tuple_parameters;
        total.words += gauges.words;
        total.relative_pronouns += gauges.relative_pronouns;
    }
    total
}

/// The gauges of every crate, by its name.
pub fn gauges() -> BTreeMap<String, Gauges> {
    let mut all: BTreeMap<String, Gauges> = BTreeMap::new();
    for source in sources() {
        let gauges = all.entry(source.layer().to_owned()).or_default();
        gauges.lines += source.code.lines().filter(|line| !line.trim().is_empty()).count();
        gauges.named_closures += named_closures(&source.code).len();
        gauges.tuple_lets += tuple_lets(&source.code);
        for function in signatures(&source.code) {
            gauges.functions += 1;
            gauges.one_word_functions += usize::from(!function.name.contains('_'));
            gauges.tuple_parameters += usize::from(function.has_tuple_parameter);
        }
        let words = comment_words(&source.text);
        gauges.words += words.len();
        gauges.relative_pronouns += words.iter().filter(|word| is_relative_pronoun(word)).count();
    }
    all
}

/// Closures with a name that take more than one line, as `file:line: name`.
pub fn long_closures() -> Vec<String> {
    let mut found = Vec::new();
    for source in sources() {
        let Source { name, text, code } = &source;
        for closure in named_closures(code).into_iter().filter(|closure| closure.lines > 1) {
            // Code without tests has fewer lines than the file: the line is looked for in the text.
            let starts = |line: &str| {
                let rest = line.trim_start().trim_start_matches("let ").trim_start_matches("mut ");
                rest.strip_prefix(&closure.name).is_some_and(|rest| rest.trim_start().starts_with(['=', ':']))
            };
            let line = text.lines().position(starts).map_or(0, |line| line + 1);
            found.push(format!("src/{name}:{line}: {} has {} lines", closure.name, closure.lines));
        }
    }
    found
}

/// Names of types that stand more than once in a crate, as `crate: name (count)`.
pub fn repeated_types() -> Vec<String> {
    let mut counts: BTreeMap<(String, String), usize> = BTreeMap::new();
    for source in sources() {
        for keyword in ["struct ", "enum "] {
            for (at, _) in source.code.match_indices(keyword) {
                let stands_alone = at == 0 || source.code[..at].ends_with([' ', '\n']);
                let name = word_at(&source.code[at + keyword.len()..]);
                // One without values stands in for a type of a feature.
                let is_stand_in =
                    source.code[at + keyword.len() + name.len()..].trim_start().starts_with("{}");
                if stands_alone && !is_stand_in && name.starts_with(char::is_uppercase) {
                    *counts.entry((source.layer().to_owned(), name.to_owned())).or_default() += 1;
                }
            }
        }
    }
    let repeated = counts.into_iter().filter(|(_, count)| *count > 1);
    repeated.map(|((layer, name), count)| format!("{layer}: {name} ({count})")).collect()
}

struct NamedClosure {
    name: String,
    lines: usize,
}

/// `let name = |...| ...;` of code.
fn named_closures(code: &str) -> Vec<NamedClosure> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices("let ") {
        let rest = code[at + 4..].trim_start_matches("mut ");
        let name = word_at(rest);
        let Some((pattern, value)) = rest.split_once('=') else { continue };
        let has_type = pattern[name.len()..].trim_start().starts_with(':');
        let value = value.trim_start().trim_start_matches("move ").trim_start();
        if !name.is_empty() && (has_type || pattern.trim() == name) && value.starts_with('|') {
            let end = statement_end(value);
            found.push(NamedClosure { name: name.to_owned(), lines: value[..end].lines().count() });
        }
    }
    found
}

/// Bytes up to the semicolon that ends a statement.
fn statement_end(code: &str) -> usize {
    let mut depth = 0;
    let end = code.find(|c| {
        depth += depth_change(c);
        depth < 0 || depth == 0 && c == ';'
    });
    end.unwrap_or(code.len())
}

fn tuple_lets(code: &str) -> usize {
    let is_tuple_let = |(at, _): &(usize, &str)| {
        let statement = &code[*at + 4..];
        let Some(rest) = statement.get(block_length(statement)..) else { return false };
        let value = rest.trim_start().strip_prefix('=').map(str::trim_start);
        let Some(value) = value.filter(|value| value.starts_with('(')) else { return false };
        let tuple = &value[..block_length(value)];
        value[tuple.len()..].trim_start().starts_with(';') && has_comma(tuple)
    };
    code.match_indices("let (").filter(is_tuple_let).count()
}

/// Whether a group in brackets has a comma of its own.
fn has_comma(group: &str) -> bool {
    let mut depth = 0;
    group.chars().any(|c| {
        depth += depth_change(c);
        depth == 1 && c == ','
    })
}

struct Signature {
    name: String,
    has_tuple_parameter: bool,
}

fn signatures(code: &str) -> Vec<Signature> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices("fn ") {
        let after_word = code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
        let name = word_at(&code[at + 3..]);
        let Some(open) = code[at..].find('(') else { continue };
        if !after_word && !name.is_empty() {
            let parameters = &code[at + open..][..block_length(&code[at + open..])];
            let squeezed: String = parameters.chars().filter(|c| !c.is_whitespace()).collect();
            let has_tuple_parameter =
                [":(", ":&(", "(("].iter().any(|mark| squeezed.contains(mark) && !squeezed.contains(":()"));
            found.push(Signature { name: name.to_owned(), has_tuple_parameter });
        }
    }
    found
}

fn word_at(code: &str) -> &str {
    let end = code.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(code.len());
    &code[..end]
}

/// Words of all comments, in lower case, without code between back quotes.
fn comment_words(text: &str) -> Vec<String> {
    let comment: String =
        kinds(text).into_iter().map(|(c, kind)| if kind == Kind::Comment { c } else { ' ' }).collect();
    let prose: String = comment.split('`').step_by(2).collect::<Vec<_>>().join(" ");
    let words = prose.split(|c: char| !c.is_alphabetic() && c != '\'').filter(|word| !word.is_empty());
    words.map(str::to_lowercase).collect()
}

/// `that` counts always: a demonstrative is not told apart from a relative pronoun.
fn is_relative_pronoun(word: &str) -> bool {
    ["that", "which", "who", "whom", "whose", "what"].contains(&word)
}
