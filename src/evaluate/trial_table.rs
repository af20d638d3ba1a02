//! Methods side by side over trials, as in the published tables: mean and deviation, best trial, failures;
//! also time and memory.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use super::{
    published::{Published, PublishedRow},
    surface_metrics::mean_of,
};

/// Time and memory of a trial.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialCost {
    /// Wall time, seconds.
    pub seconds: f64,
    /// Peak resident memory, MiB; `None` if the system does not report it.
    pub peak_mib: Option<f64>,
}

/// All trials of a method on an object.
#[derive(Clone, Debug, Serialize)]
pub struct MethodTrials {
    /// Name of the object.
    pub object: String,
    /// Name of the method.
    pub method: String,
    /// The published metrics over all trials.
    pub published: Published,
    /// Why trials failed, each with the index of its seed.
    pub failures: Vec<(usize, String)>,
    /// Why twins were rejected, each with the index of its seed; they are measured all the same.
    pub rejected: Vec<(usize, String)>,
    /// Time and memory of every trial.
    pub costs: Vec<TrialCost>,
}

/// The trials of all objects and methods.
#[derive(Clone, Debug, Serialize)]
pub struct TrialTable {
    /// Number of trials of each object and method.
    pub seeds: u64,
    /// Sorted by object, then method.
    pub trials: Vec<MethodTrials>,
}

impl TrialTable {
    /// An empty table for `seeds` trials each.
    pub fn new(seeds: u64) -> Self {
        Self { seeds, trials: Vec::new() }
    }

    /// Adds the trials of a method on an object, with the reasons for rejected twins; adds nothing if there
    /// are no trials.
    pub fn add_trials(
        &mut self,
        object: &str,
        method: &str,
        trials: &[super::Evaluation],
        rejected: Vec<Option<String>>,
        costs: Vec<TrialCost>,
    ) {
        let Some(published) = Published::of_trials(trials) else { return };
        let failures = trials.iter().enumerate().filter_map(|(seed, t)| Some((seed, t.failed.clone()?)));
        self.trials.push(MethodTrials {
            object: object.to_owned(),
            method: method.to_owned(),
            published,
            rejected: rejected.into_iter().enumerate().filter_map(|(s, why)| Some((s, why?))).collect(),
            failures: failures.collect(),
            costs,
        });
    }

    /// The table as indented JSON.
    pub fn to_json(&self) -> String {
        // Text and finite or missing numbers can always be serialized.
        serde_json::to_string_pretty(self).unwrap_or_default()
    }

    /// One Markdown table per object, with a row for each metric and a column for each method.
    pub fn to_markdown(&self) -> String {
        let mut out = format!(
            "Mean ± deviation over the trials ({} seeds) in which the metric exists, and (best trial: the \
             one with the most least values). F: no trial has it. Components below 10 % of the largest one's \
             area are dropped, as published. Methods that infer as published are given the number of \
             parts.\n",
            self.seeds
        );
        let mut objects: Vec<&str> = self.trials.iter().map(|t| t.object.as_str()).collect();
        objects.dedup();
        for object in objects {
            let own: Vec<&MethodTrials> = self.trials.iter().filter(|t| t.object == object).collect();
            push_object(&mut out, object, &own);
        }
        out
    }
}

fn push_object(out: &mut String, object: &str, methods: &[&MethodTrials]) {
    out.push('\n');
    push_row(out, object, methods, |m| m.method.clone());
    push_row(out, "---", methods, |_| "---".to_owned());
    let metrics = methods.first().map_or(&[][..], |m| &m.published.rows);
    for (k, metric) in metrics.iter().enumerate() {
        push_row(out, &format!("{}, {}", metric.metric, metric.unit), methods, |m| {
            m.published.rows.get(k).map_or("F".into(), metric_cell)
        });
    }
    push_row(out, "failed trials", methods, |m| {
        format!("{} of {}", m.published.failed_trials, m.costs.len())
    });
    push_row(out, "twins that a simulator would not load", methods, |m| {
        format!("{} of {}", m.rejected.len(), m.costs.len() - m.published.failed_trials)
    });
    push_row(out, "seconds", methods, |m| {
        let seconds: Vec<f64> = m.costs.iter().map(|c| c.seconds).collect();
        mean_of(&seconds).map_or("-".into(), |s| format!("{s:.0}"))
    });
    push_row(out, "memory, MiB", methods, |m| {
        let peaks: Vec<f64> = m.costs.iter().filter_map(|c| c.peak_mib).collect();
        mean_of(&peaks).map_or("-".into(), |s| format!("{s:.0}"))
    });
}

/// A row of the table: its name and a cell for each method.
fn push_row(out: &mut String, name: &str, methods: &[&MethodTrials], cell: impl Fn(&MethodTrials) -> String) {
    let cells: Vec<String> =
        std::iter::once(name.to_owned()).chain(methods.iter().map(|m| cell(m))).collect();
    // Writing to a string cannot fail.
    writeln!(out, "| {} |", cells.join(" | ")).unwrap_or_default();
}

/// Mean, deviation and best trial of a metric, and the number of trials with a value if some have none.
fn metric_cell(row: &PublishedRow) -> String {
    let places = row.decimal_places();
    let (Some(mean), Some(std)) = (row.mean, row.std) else { return "F".into() };
    let best = row.best.map_or("F".into(), |b| format!("{b:.places$}"));
    let trials = row.trials.len();
    let of = if row.failed == 0 { String::new() } else { format!(" [{} of {trials}]", trials - row.failed) };
    format!("{mean:.places$} ± {std:.places$} ({best}){of}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_says_over_how_many_trials_it_is() {
        let row = |trials: Vec<Option<f64>>, mean, std, best| PublishedRow {
            metric: "Axis Ang (lid)".into(),
            unit: "deg",
            failed: trials.iter().filter(|t| t.is_none()).count(),
            trials,
            mean,
            std,
            best,
        };
        let some = row(vec![Some(1.0), None, Some(3.0)], Some(2.0), Some(1.0), Some(1.0));
        assert_eq!(metric_cell(&some), "2.000 ± 1.000 (1.000) [2 of 3]");
        assert_eq!(metric_cell(&row(vec![None; 2], None, None, None)), "F");
    }
}
