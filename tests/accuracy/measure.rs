//! The figures of a twin: its files against the truth.

use std::path::Path;

use evaluate::{EvaluateOptions, Evaluation, evaluate_runs};
use serde_json::Value;

use super::table::{Figure, Key, Table};

/// Reads a JSON file.
pub fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// A twin in the world of the truth against it.
pub fn evaluation(twin: &Path, truth: &Path) -> Evaluation {
    let mut report = evaluate_runs(&[twin.to_owned()], truth, &EvaluateOptions::default()).unwrap();
    report.trials.remove(0)
}

/// The one figure of a run without a twin.
pub fn failed(run: &str, outcome: &str) -> Table {
    let mut rows = Rows { run, table: Table::new() };
    rows.word("twin", "parts", format!("none, {outcome}"), false);
    rows.table
}

/// All figures of the twin in a folder, in the world of the truth.
pub fn measure(run_name: &str, twin: &Path, truth: &Path) -> Table {
    let mut rows = Rows { run: run_name, table: Table::new() };
    let report = json(&twin.join("report.json"));
    let code = |warning: &Value| warning["code"].as_str().unwrap().to_owned();
    let mut codes: Vec<String> = list(&report["warnings"]).iter().map(code).collect();
    codes.sort_unstable();
    rows.add("twin", "warnings", Figure::Codes(codes));
    // A recording of which nothing is known but that nothing moved.
    if !truth.join("truth.json").exists() {
        let parts = list(&report["links"]).len();
        rows.word("twin", "parts", format!("{parts} of 1"), parts == 1);
        return rows.table;
    }
    let trial = evaluation(twin, truth);
    let parts = format!("{} of {}", trial.parts_found, trial.parts_true);
    rows.word("twin", "parts", parts, trial.parts_found == trial.parts_true);
    for state in [0, 1] {
        let whole = &trial.mesh[&format!("state{state}/whole")];
        rows.number("surface", &format!("state{state}_seen_mm"), whole.seen_mm);
        rows.number("surface", &format!("state{state}_accuracy_mm"), whole.accuracy_mm);
    }
    let true_parts = json(&truth.join("truth.json"));
    for row in &trial.joints {
        let part = row.part.as_str();
        let Some(kind) = &row.kind else {
            rows.word(part, "type", "missing".into(), false);
            continue;
        };
        let is_right = row.type_right == Some(true);
        let kind = if is_right { kind.clone() } else { format!("{kind}, not {}", row.type_true) };
        rows.word(part, "type", kind, is_right);
        rows.number(part, "axis_deg", row.axis_deg);
        rows.number(part, "line_mm", row.axis_mm);
        rows.number(part, "motion_deg", row.motion_deg);
        rows.number(part, "motion_mm", row.motion_mm);
        rows.number(part, "error_mm", row.error_mm);
        let joint = row.joint.as_deref().unwrap();
        let truth = list(&true_parts["parts"]).iter().find(|p| p["name"] == part).unwrap();
        let stated = list(&report["joints"]).iter().find(|j| j["name"] == joint).unwrap();
        // Of the joint's position: the rotation between both motions holds the axis' error, too.
        let motion = (position(&report, 1, joint) - position(&report, 0, joint)).abs();
        let motion_error = (motion - truth["motion"].as_f64().unwrap().abs()).abs();
        rows.ratio(part, "axis_per_std", row.axis_deg, &stated["axis_std_deg"]);
        rows.ratio(part, "line_per_std", row.axis_mm, &stated["origin_std_mm"]);
        rows.ratio(part, "motion_per_std", Some(motion_error), &stated["motion_std"]["value"]);
    }
    rows.table
}

/// Position of a joint in a state.
fn position(report: &Value, state: usize, joint: &str) -> f64 {
    report["states"][state]["joints"][joint].as_f64().unwrap_or_else(|| panic!("{joint} has no position"))
}

fn list(value: &Value) -> &[Value] {
    value.as_array().unwrap()
}

/// The figures of one run.
struct Rows<'a> {
    run: &'a str,
    table: Table,
}

impl Rows<'_> {
    fn add(&mut self, item: &str, figure: &str, value: Figure) {
        self.table.insert(Key { run: self.run.into(), item: item.into(), figure: figure.into() }, value);
    }

    fn word(&mut self, item: &str, figure: &str, text: String, is_right: bool) {
        self.add(item, figure, Figure::Word { text, is_right });
    }

    /// Adds a number that has a meaning for the item.
    fn number(&mut self, item: &str, figure: &str, value: Option<f64>) {
        if let Some(value) = value {
            self.add(item, figure, Figure::Number(value));
        }
    }

    /// Adds an error over the standard deviation that is stated for it.
    fn ratio(&mut self, item: &str, figure: &str, error: Option<f64>, std: &Value) {
        self.number(item, figure, error.zip(std.as_f64()).map(|(error, std)| error / std));
    }
}
