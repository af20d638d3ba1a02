//! The commands that a page of Markdown prints: every command of every `sh` block.
//!
//! A comment before a block, which no reader of the page sees, may say why the test does not run it:
//! `<!-- not run: REASON -->`, or `<!-- slow: 90 s -->` for what runs where all is asked for.
//! `exit code 3` in the comment after a command, which every reader sees, says how it ends; else with 0.

use std::process::Command;

/// Whether and when a command runs.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    Runs,
    Slow(String),
    NotRun(String),
}

/// A command as printed, its continued lines included.
#[derive(Clone, Debug, PartialEq)]
pub struct Printed {
    pub page: String,
    /// Line of the page on which it begins, from 1.
    pub line: usize,
    pub text: String,
    pub exit_code: i32,
    pub mark: Mark,
}

/// Lines outside an `sh` block that begin so are commands that nobody would run.
const PROGRAMS: [&str; 6] = ["artitwin ", "cargo ", "python ", "pip ", "ros2 ", "$ "];

/// The commands of a page, from top to bottom.
///
/// # Panics
/// Where a mark stands before no `sh` block or gives no reason, where a command stands in another block, and
/// where a block ends amid a command.
pub fn commands(page: &str, markdown: &str) -> Vec<Printed> {
    let (mut found, mut mark, mut block) = (Vec::new(), None::<Mark>, None::<(bool, String)>);
    for (number, line) in markdown.lines().enumerate() {
        let at = || format!("{page}:{}: {line}", number + 1);
        let fence = line.trim_start().strip_prefix("```");
        match (&mut block, fence) {
            (None, Some(language)) => {
                let is_shell = language == "sh";
                assert!(is_shell || mark.is_none(), "{}: a mark before no block of sh", at());
                block = Some((is_shell, String::new()));
            }
            (Some((_, open)), Some(_)) => {
                assert!(open.is_empty(), "{}: the block ends amid a command: {open}", at());
                (block, mark) = (None, None);
            }
            (Some((true, open)), None) => {
                open.push_str(line);
                open.push('\n');
                if is_whole(open) {
                    let text = std::mem::take(open).trim().to_owned();
                    let line = number + 2 - text.lines().count();
                    if text.lines().any(|l| !l.is_empty() && !l.starts_with('#')) {
                        let (exit_code, mark) = (exit_code(&text), mark.clone().unwrap_or(Mark::Runs));
                        found.push(Printed { page: page.to_owned(), line, text, exit_code, mark });
                    }
                }
            }
            (_, None) => {
                let is_command = PROGRAMS.iter().any(|p| line.trim_start().starts_with(p));
                let is_code = block.is_some() || line.starts_with("    ");
                assert!(!(is_command && is_code), "{}: a command in no block of sh", at());
                if block.is_none() && !line.trim().is_empty() {
                    assert!(mark.is_none(), "{}: a mark before no block of sh", at());
                    mark = mark_of(line);
                }
            }
        }
    }
    found
}

fn mark_of(line: &str) -> Option<Mark> {
    let comment = line.trim().strip_prefix("<!-- ")?.strip_suffix(" -->")?;
    let reason = |kind: &str| comment.strip_prefix(kind).map(|r| r.trim().to_owned());
    let mark = reason("not run:").map(Mark::NotRun).or_else(|| reason("slow:").map(Mark::Slow))?;
    assert!(!matches!(&mark, Mark::NotRun(r) | Mark::Slow(r) if r.is_empty()), "no reason: {line}");
    Some(mark)
}

/// Whether lines are a whole command: bash can read it and nothing continues.
fn is_whole(lines: &str) -> bool {
    let read = Command::new("bash").args(["-n", "-c", lines]).output().expect("bash");
    read.status.success() && read.stderr.is_empty() && !lines.trim_end().ends_with('\\')
}

fn exit_code(text: &str) -> i32 {
    let digits = |rest: &str| rest.chars().take_while(char::is_ascii_digit).collect::<String>();
    let comment = text.rsplit_once(" # ").map_or("", |(_, comment)| comment);
    comment.split_once("exit code ").map_or(0, |(_, rest)| digits(rest).parse().expect("an exit code"))
}

#[test]
fn commands_are_taken_as_printed() {
    let page = "# Page\n\n```sh\nartitwin a    # exit code 3: a warning\n\n# a remark\n\
                for x in 1 2; do\n  echo $x\ndone\nartitwin b \\\n  --c\n```\n\n\
                <!-- not run: a camera -->\n```sh\nros2 bag record\n```\n\n\
                ```text\nno command\n```\n\n<!-- slow: 90 s -->\n\n```sh\nartitwin d <<< e\n```\n";
    let found = commands("p.md", page);
    let seen: Vec<_> = found.iter().map(|c| (c.line, c.text.as_str(), c.exit_code, c.mark.clone())).collect();
    let (slow, not_run) = (Mark::Slow("90 s".into()), Mark::NotRun("a camera".into()));
    assert_eq!(
        seen,
        [
            (4, "artitwin a    # exit code 3: a warning", 3, Mark::Runs),
            (7, "for x in 1 2; do\n  echo $x\ndone", 0, Mark::Runs),
            (10, "artitwin b \\\n  --c", 0, Mark::Runs),
            (16, "ros2 bag record", 0, not_run),
            (26, "artitwin d <<< e", 0, slow),
        ]
    );
}

#[test]
fn what_would_not_be_run_is_refused() {
    let refused = |page: &str| std::panic::catch_unwind(|| commands("p.md", page)).is_err();
    assert!(refused("    artitwin reconstruct x\n"), "indented");
    assert!(refused("```\nartitwin reconstruct x\n```\n"), "a block of no language");
    assert!(refused("<!-- not run: -->\n```sh\nx\n```\n"), "no reason");
    assert!(refused("<!-- not run: hardware -->\nText.\n\n```sh\nx\n```\n"), "a mark far from its block");
    assert!(refused("```sh\nfor x in 1 2; do\n```\n"), "half a command");
}
