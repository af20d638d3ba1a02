//! The file of expected figures: runs, their items, and figures by name; a line an item.

use std::{collections::BTreeMap, fmt::Write as _, path::PathBuf};

use serde_json::Value;

use super::table::{Figure, Key, Line, Mark, Table};

fn path() -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "tests", "accuracy", "expected.json"].iter().collect()
}

/// The expected figures; none where there is no file yet.
pub fn read() -> Table {
    let Ok(text) = std::fs::read_to_string(path()) else { return Table::new() };
    let runs: BTreeMap<String, BTreeMap<String, BTreeMap<String, Value>>> =
        serde_json::from_str(&text).unwrap();
    let mut table = Table::new();
    for (run, items) in runs {
        for (item, figures) in items {
            for (figure, value) in figures {
                let value = match value {
                    Value::Number(number) => Figure::Number(number.as_f64().unwrap()),
                    Value::String(text) => Figure::Word { text, is_right: false },
                    other => Figure::Codes(serde_json::from_value(other).unwrap()),
                };
                table.insert(Key { run: run.clone(), item: item.clone(), figure }, value);
            }
        }
    }
    table
}

/// Takes found figures into the file: with `1` those that got better and new ones, with `worse` all. Says
/// what it did.
pub fn accept(lines: &[Line], how: Option<&str>) -> String {
    let takes = |mark: Mark| match how {
        None => false,
        Some("1") => matches!(mark, Mark::Better | Mark::New),
        Some("worse") => true,
        Some(other) => panic!("ARTITWIN_ACCEPT={other}: give 1 or worse"),
    };
    let kept = |line: &Line| {
        let figure = if takes(line.mark) { &line.found } else { &line.expected };
        figure.clone().map(|figure| (line.key.clone(), figure))
    };
    let taken = lines.iter().filter(|line| takes(line.mark)).count();
    if taken == 0 {
        return String::new();
    }
    write(&lines.iter().filter_map(kept).collect());
    format!("{taken} of {} figures were written to {}\n", lines.len(), path().display())
}

fn write(table: &Table) {
    let mut runs = BTreeMap::<&str, BTreeMap<&str, BTreeMap<&str, Value>>>::new();
    for (key, figure) in table {
        let value = match figure {
            Figure::Number(number) => (*number).into(),
            Figure::Word { text, .. } => text.as_str().into(),
            Figure::Codes(codes) => codes.as_slice().into(),
        };
        runs.entry(&key.run).or_default().entry(&key.item).or_default().insert(&key.figure, value);
    }
    let run = |(name, items): (&str, BTreeMap<&str, BTreeMap<&str, Value>>)| {
        let mut lines = Vec::new();
        for (item, figures) in items {
            let mut line = format!("    {}: {{", Value::from(item));
            for (number, (figure, value)) in figures.into_iter().enumerate() {
                let comma = if number == 0 { "" } else { ", " };
                write!(line, "{comma}{}: {value}", Value::from(figure)).unwrap();
            }
            lines.push(line + "}");
        }
        format!("  {}: {{\n{}\n  }}", Value::from(name), lines.join(",\n"))
    };
    let text: Vec<String> = runs.into_iter().map(run).collect();
    std::fs::write(path(), format!("{{\n{}\n}}\n", text.join(",\n"))).unwrap();
}
