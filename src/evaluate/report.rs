//! Evaluations as text and JSON.

use std::fmt::Write as _;

use serde::Serialize;

use super::{
    compare::{Evaluation, MeshRow},
    joint_metrics::JointRow,
    published::Published,
};

/// The evaluation of one or several runs (trials) of one object.
#[derive(Clone, Debug, Serialize)]
pub struct EvaluationReport {
    /// Folder of the truth.
    pub truth: String,
    /// Samples per surface.
    pub samples: usize,
    /// Seed of the samples.
    pub seed: u64,
    /// Components smaller than this share of the largest one were dropped; `None`: all were kept.
    pub min_component: Option<f64>,
    /// Evaluation of every run.
    pub trials: Vec<Evaluation>,
    /// The published metrics over all runs.
    pub published: Option<Published>,
}

impl EvaluationReport {
    /// The report as indented JSON. An entry of a run has the keys of the reference tool, and more.
    pub fn to_json(&self) -> String {
        // Maps with text keys and finite or missing numbers can always be serialized.
        serde_json::to_string_pretty(self).unwrap_or_default()
    }

    /// The report as text tables.
    pub fn to_text(&self) -> String {
        let mut out = format!("truth {}\n", self.truth);
        for trial in &self.trials {
            push_trial(&mut out, trial);
        }
        if let Some(published) = &self.published {
            push_published(&mut out, published, self.trials.len());
        }
        let filter = match self.min_component {
            Some(share) => format!("components below {:.0} % of the largest were dropped", 100.0 * share),
            None => "all components were kept".into(),
        };
        writeln!(out, "\n{} samples per surface, seed {}; {filter}.", self.samples, self.seed).ok();
        out
    }
}

fn push_trial(out: &mut String, trial: &Evaluation) {
    // Writing to a string cannot fail, here and below.
    if let Some(why) = &trial.failed {
        writeln!(out, "\nrun {} failed: {why}", trial.run).ok();
        return;
    }
    writeln!(out, "\nrun {}: {} parts found, {} true", trial.run, trial.parts_found, trial.parts_true).ok();
    let head = ["part", "type", "axis deg", "axis mm", "motion", "error mm"].map(String::from);
    let joints = trial.joints.iter().map(joint_cells);
    table(out, &std::iter::once(head.to_vec()).chain(joints).collect::<Vec<_>>());
    out.push('\n');
    let head = ["surface", "CD 1e-3 m^2", "floor", "0.0637 A", "accuracy mm", "seen mm"].map(String::from);
    let rows = trial.mesh.iter().map(|(name, row)| mesh_cells(name, row));
    table(out, &std::iter::once(head.to_vec()).chain(rows).collect::<Vec<_>>());
}

/// Motions from state 0 to all other states, as text.
fn motions_text(first: f64, row: &JointRow) -> String {
    let all = std::iter::once(first).chain(row.further_motions.iter().copied());
    all.map(|m| format!("{m:.3}")).collect::<Vec<_>>().join(" / ")
}

fn joint_cells(row: &JointRow) -> Vec<String> {
    if row.missing {
        return vec![row.part.clone(), format!("missing ({})", row.type_true)];
    }
    let kind = row.kind.clone().unwrap_or_default();
    let kind = if row.type_right == Some(true) { kind } else { format!("{kind}, not {}", row.type_true) };
    let motion = match (row.motion_deg, row.motion_mm) {
        (Some(deg), _) => format!("{} deg", motions_text(deg, row)),
        (_, Some(mm)) => format!("{} mm", motions_text(mm, row)),
        _ => "-".into(),
    };
    vec![row.part.clone(), kind, cell(row.axis_deg), cell(row.axis_mm), motion, cell(row.error_mm)]
}

fn mesh_cells(name: &str, row: &MeshRow) -> Vec<String> {
    let numbers = [row.cd, row.cd_floor, Some(row.cd_floor_expected), row.accuracy_mm, row.seen_mm];
    std::iter::once(name.to_owned()).chain(numbers.map(cell)).collect()
}

fn push_published(out: &mut String, published: &Published, trials: usize) {
    let spread = if trials > 1 {
        format!(" over {trials} trials, best trial {}", published.best_trial + 1)
    } else {
        String::new()
    };
    writeln!(out, "\nmetrics as published{spread}").ok();
    let mut rows = vec![["metric", "unit", "mean", "std", "best", "trials"].map(String::from).to_vec()];
    for row in &published.rows {
        let places = row.decimal_places();
        // F, as the tables print failed trials.
        let failed = |v: Option<f64>| v.map_or("F".into(), |v| format!("{v:.places$}"));
        rows.push(vec![
            row.metric.clone(),
            row.unit.into(),
            failed(row.mean),
            failed(row.std),
            failed(row.best),
            format!("{} of {trials}", trials - row.failed),
        ]);
    }
    if trials == 1 {
        rows.iter_mut().for_each(|r| r.truncate(3));
        rows[0][2] = "value".into();
    }
    table(out, &rows);
    if published.failed_trials > 0 {
        writeln!(
            out,
            "in {} of {trials} trials a part or the twin is missing; mean and std are over the trials that \
             have the number",
            published.failed_trials
        )
        .ok();
    }
}

fn cell(value: Option<f64>) -> String {
    value.map_or("-".into(), |v| format!("{v:.3}"))
}

/// Columns as wide as their widest cell, two blanks apart; the first left-aligned, the others right-aligned.
fn table(out: &mut String, rows: &[Vec<String>]) {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| rows.iter().filter_map(|r| r.get(c)).map(|s| s.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    for row in rows {
        let cells = row.iter().zip(&widths).enumerate();
        let cells: Vec<String> =
            cells.map(|(i, (s, &w))| if i == 0 { format!("{s:<w$}") } else { format!("{s:>w$}") }).collect();
        writeln!(out, "  {}", cells.join("  ").trim_end()).ok();
    }
}
