//! Where numbers come from: every named float constant says it in its comment, and in the layers that decide
//! most every number has a name.

use super::reader::{blank, sources, with_tests_blank};

/// `derived:` follows from theory or another number; `measured:` read off a file or an experiment that is
/// named; `tuned:` searched on a set of recordings that is named; `chosen:` a judgement, with its reason.
pub const ORIGINS: [&str; 4] = ["derived:", "measured:", "tuned:", "chosen:"];
/// Layers in whose code numbers have names.
const NAMED: [&str; 2] = ["articulate", "gap"];
/// What needs no name: numbers of arithmetic, the levels of 8 bits among them ...
const ARITHMETIC: [f64; 7] = [0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 255.0];
/// ... and guards against a division by zero, which are no larger.
const GUARD: f64 = 1e-9;

/// A named float constant.
pub struct Constant {
    /// `path:line: NAME`.
    pub place: String,
    /// Its layer.
    pub layer: String,
    /// One of [`ORIGINS`].
    pub origin: Option<&'static str>,
}

/// All float constants, tests excluded.
pub fn constants() -> Vec<Constant> {
    let mut found = Vec::new();
    for source in sources() {
        let code = with_tests_blank(&blank(&source.text));
        let code: Vec<&str> = code.lines().collect();
        let text: Vec<&str> = source.text.lines().collect();
        for (number, name) in float_constants(&code) {
            let comment = comment_before(&text, &code, number);
            found.push(Constant {
                place: format!("src/{}:{}: {name}", source.name, number + 1),
                layer: source.layer().to_owned(),
                origin: ORIGINS.into_iter().find(|o| comment.contains(o)),
            });
        }
    }
    found
}

/// Float literals of [`NAMED`] without a name, as `path:line: literal`; tests excluded.
///
/// A literal has a name in a constant, and in `fn default`, whose fields are settings. It needs none if it is
/// one of [`ARITHMETIC`], a whole power of ten from ten on, at most [`GUARD`], or in a formula with
/// `derived:` in the comment right before its line.
pub fn unnamed() -> Vec<String> {
    let mut found = Vec::new();
    for source in sources().into_iter().filter(|s| NAMED.contains(&s.layer())) {
        let code = without_names(&with_tests_blank(&blank(&source.text)));
        let text: Vec<&str> = source.text.lines().collect();
        for (number, line) in code.lines().enumerate() {
            let before = text[..number].iter().rev().take_while(|l| l.trim_start().starts_with("//"));
            if before.into_iter().any(|l| l.contains("derived:")) {
                continue;
            }
            let unnamed = float_literals(line).into_iter().filter(|l| needs_name(l));
            found.extend(unnamed.map(|l| format!("src/{}:{}: {l}", source.name, number + 1)));
        }
    }
    found
}

fn needs_name(literal: &str) -> bool {
    let digits = literal.trim_end_matches("f64").trim_end_matches("f32").replace('_', "");
    let value: f64 = digits.parse().unwrap_or(f64::NAN);
    let is_unit = value >= 10.0 && value.log10().fract() == 0.0;
    !(ARITHMETIC.contains(&value) || value <= GUARD || is_unit)
}

/// Float literals of a line of code.
fn float_literals(line: &str) -> Vec<String> {
    let chars: Vec<char> = line.chars().collect();
    let at = |k: usize| chars.get(k).copied().unwrap_or(' ');
    let digits = |mut k: usize| {
        while at(k).is_ascii_digit() || at(k) == '_' {
            k += 1;
        }
        k
    };
    let mut found = Vec::new();
    let mut start = 0;
    while start < chars.len() {
        let word = |k: usize| at(k).is_alphanumeric() || at(k) == '_';
        if !at(start).is_ascii_digit() || start > 0 && (word(start - 1) || at(start - 1) == '.') {
            start += 1;
            continue;
        }
        let whole = digits(start);
        let mut end = whole;
        if at(end) == '.' && at(end + 1) != '.' && !at(end + 1).is_alphabetic() {
            end = digits(end + 1);
        }
        if at(end) == 'e' {
            end = digits(end + 1 + usize::from(at(end + 1) == '-'));
        }
        let suffix = [at(end), at(end + 1), at(end + 2)].iter().collect::<String>();
        if suffix == "f64" || suffix == "f32" {
            end += 3;
        }
        if end > whole {
            found.push(chars[start..end].iter().collect());
        }
        start = end;
    }
    found
}

/// Code with the values of constants and the bodies of `fn default` blanked; lines stay.
fn without_names(code: &str) -> String {
    let mut kept = String::with_capacity(code.len());
    let mut depth_of_name = None;
    let mut depth = 0;
    for line in code.split_inclusive('\n') {
        let opens_constant = constant(line).is_some() || line.trim_start().starts_with("static ");
        if depth_of_name.is_none() && (opens_constant || line.contains("fn default()")) {
            depth_of_name = Some(depth);
        }
        let named = depth_of_name.is_some();
        for c in line.chars() {
            depth += i32::from("([{".contains(c)) - i32::from(")]}".contains(c));
            let ends = c == ';' || c == '}';
            if ends && depth_of_name.is_some_and(|d| depth == d) {
                depth_of_name = None;
            }
        }
        kept.push_str(if named { "\n" } else { line });
    }
    kept
}

/// Line and name of every constant whose type holds a float.
fn float_constants<'a>(code: &[&'a str]) -> Vec<(usize, &'a str)> {
    let of_line = |(number, line): (usize, &&'a str)| {
        let name = constant(line)?;
        let whole = code[number..].iter().take(3).copied().collect::<Vec<_>>().concat();
        let (kind, _) = whole.split_once('=')?;
        (kind.contains("f64") || kind.contains("f32")).then_some((number, name))
    };
    code.iter().enumerate().filter_map(of_line).collect()
}

/// The name of the constant that a line starts.
fn constant(line: &str) -> Option<&str> {
    let line = line.trim_start();
    let line = line.strip_prefix("pub").map_or(line, |rest| {
        let rest = rest.trim_start();
        if rest.starts_with('(') { rest.split_once(')').map_or("", |(_, r)| r).trim_start() } else { rest }
    });
    let (name, _) = line.strip_prefix("const ")?.split_once(':')?;
    name.chars().all(|c| c.is_uppercase() || c.is_numeric() || c == '_').then_some(name)
}

/// The comment above a constant; constants that follow each other without one share it.
fn comment_before(text: &[&str], code: &[&str], number: usize) -> String {
    let is_comment = |line: &str| line.trim_start().starts_with("//");
    let passed_over = |n: usize| {
        let constant_ends = code[n].trim_end().ends_with(';') && constant(code[n]).is_some();
        text[n].trim_start().starts_with("#[") || constant_ends
    };
    let top = (0..number).rev().take_while(|&n| passed_over(n)).last().unwrap_or(number);
    let lines: Vec<&str> = text[..top].iter().rev().take_while(|l| is_comment(l)).copied().collect();
    lines.into_iter().rev().map(|l| l.trim_start().trim_start_matches('/')).collect::<Vec<_>>().join(" ")
}

#[test]
fn constants_are_found_with_their_comments() {
    let text = "/// Far\n/// (tuned: x).\npub(crate) const FAR_M: f64 = 1.0;\n\
                const NEAR: [f64; 2] =\n  [1.0, 2.0];\n\n\
                const N: usize = 2;\nconst LONE: f32 = 1.0;\nconst fn f(x: f64) {}\n";
    let lines: Vec<&str> = text.lines().collect();
    let found = float_constants(&lines);
    assert_eq!(found.iter().map(|f| f.1).collect::<Vec<_>>(), ["FAR_M", "NEAR", "LONE"]);
    let comments: Vec<String> = found.iter().map(|f| comment_before(&lines, &lines, f.0)).collect();
    assert!(comments[0].contains("tuned:") && comments[1].contains("tuned:") && comments[2].is_empty());
}

#[test]
fn literals_are_found_where_they_have_no_name() {
    let code = "const A: [f64; 2] =\n    [0.3, 7.0];\nfn default() -> Self {\n    let a = 0.7;\n    a\n}\n\
                let x = 0.25 * s.0.1 + 5e-3 - 12f64.sqrt() + a[1..7] + 7 + x1.2;\n";
    let left = without_names(code);
    assert_eq!(left.lines().count(), code.lines().count());
    let found: Vec<String> = left.lines().flat_map(float_literals).collect();
    assert_eq!(found, ["0.25", "5e-3", "12f64"]);
    let needed: Vec<bool> = ["0.5", "10.0", "1e3", "20.0", "1e-9", "1e-6"].map(needs_name).into();
    assert_eq!(needed, [false, false, false, true, false, true]);
}
