//! Where numbers come from: every named float constant of the layers that decide says it in its comment.

use super::reader::{blank, sources, with_tests_blank};

/// Layers whose constants decide what is found.
const LAYERS: [&str; 2] = ["articulate", "gap"];
/// `derived:` from theory or another number; `measured:` in a file; `tuned:` on a set of recordings; `chosen:` a
/// judgement.
pub const ORIGINS: [&str; 4] = ["derived:", "measured:", "tuned:", "chosen:"];

/// A named float constant.
pub struct Constant {
    /// `path:line: NAME`.
    pub place: String,
    /// Its layer.
    pub layer: String,
    /// One of [`ORIGINS`].
    pub origin: Option<&'static str>,
}

/// All float constants of [`LAYERS`], tests excluded.
pub fn constants() -> Vec<Constant> {
    let mut found = Vec::new();
    for source in sources().into_iter().filter(|s| LAYERS.contains(&s.layer())) {
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
