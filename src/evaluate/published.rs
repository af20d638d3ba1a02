//! The published metrics in their printed units, over trials (docs/method.md 13).
//!
//! The definitions are those of the published tables, with one exception: the axis position of parallel lines
//! is their distance, where a released tool prints zero. As in the tables, the true joint type determines the
//! numbers of a joint; correct types are counted separately.

use serde::Serialize;

use super::{compare::Evaluation, surface_metrics::mean_of};

/// One published metric over all trials.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PublishedRow {
    /// Name as printed in the tables, followed by the part if there are several.
    pub metric: String,
    /// Unit of the printed numbers.
    pub unit: &'static str,
    /// Value of every trial; `None` if it failed.
    pub trials: Vec<Option<f64>>,
    /// Number of failed trials.
    pub failed: usize,
    /// Mean over the trials with a value.
    pub mean: Option<f64>,
    /// Population standard deviation over the trials with a value.
    pub std: Option<f64>,
    /// Value of the best trial.
    pub best: Option<f64>,
}

impl PublishedRow {
    /// Number of decimal places printed.
    pub(super) fn decimal_places(&self) -> usize {
        if self.unit == "m" { 4 } else { 3 }
    }
}

/// The published metrics of all trials.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Published {
    /// Index of the best trial: the one with the most smallest values (docs/method.md 13.3).
    pub best_trial: usize,
    /// Number of trials without a twin, or with a missing part.
    pub failed_trials: usize,
    /// Rows in the order of the tables; Chamfer distances in the start state (0) and the end state (1).
    pub rows: Vec<PublishedRow>,
}

impl Published {
    /// The published metrics of some trials of the same object; `None` without trials.
    pub fn of_trials(trials: &[Evaluation]) -> Option<Self> {
        // All trials have the same rows, determined by the truth.
        let names: Vec<(String, &'static str)> =
            published_numbers(trials.first()?).into_iter().map(|(n, u, _)| (n, u)).collect();
        let table: Vec<Vec<Option<f64>>> =
            trials.iter().map(|t| published_numbers(t).into_iter().map(|(_, _, v)| v).collect()).collect();
        let columns: Vec<Vec<Option<f64>>> =
            (0..names.len()).map(|i| table.iter().map(|t| t[i]).collect()).collect();
        // Each surface counts once: the released evaluation has one state, the start.
        let votes: Vec<Vec<Option<f64>>> =
            names.iter().zip(&columns).filter(|((n, _), _)| !is_of_end(n)).map(|(_, c)| c.clone()).collect();
        let best_trial = best_trial(&votes, trials.len());
        let mut rows = Vec::with_capacity(names.len());
        for ((metric, unit), trials) in names.into_iter().zip(columns) {
            let (mean, std) = mean_std(&trials);
            let failed = trials.iter().filter(|v| v.is_none()).count();
            rows.push(PublishedRow { metric, unit, mean, std, failed, best: trials[best_trial], trials });
        }
        // A trial missing a part has no numbers for it: means leave it out, and the count of failed trials
        // shows it.
        let failed_trials = trials.iter().filter(|t| t.joints.iter().any(|j| j.missing)).count();
        Some(Self { best_trial, failed_trials, rows })
    }
}

/// Name, unit and printed value of every published metric of one trial. Names and units depend on the truth
/// only.
fn published_numbers(trial: &Evaluation) -> Vec<(String, &'static str, Option<f64>)> {
    let mut out = Vec::new();
    for joint in &trial.joints {
        let turns = joint.type_true != "prismatic";
        let name = |metric: &str| format!("{metric} ({})", joint.part);
        out.push((name("Axis Ang"), "deg", joint.axis_deg));
        if turns {
            // The tables print this number in units of 0.1 m.
            out.push((name("Axis Pos"), "0.1 m", joint.axis_mm.map(|mm| mm / 100.0)));
            out.push((name("Part Motion"), "deg", joint.motion_deg));
        } else {
            out.push((name("Part Motion"), "m", joint.motion_mm.map(|mm| mm / 1000.0)));
        }
    }
    for (state, label) in [(0, "start"), (1, "end")] {
        let cd = |part: &str| trial.mesh.get(&format!("state{state}/{part}")).and_then(|row| row.cd);
        out.push((format!("CD-s {label}"), "1e-3 m^2", cd("static")));
        for joint in &trial.joints {
            out.push((format!("CD-m {label} ({})", joint.part), "1e-3 m^2", cd(&joint.part)));
        }
        out.push((format!("CD-w {label}"), "1e-3 m^2", cd("whole")));
    }
    out
}

/// Whether a metric belongs to a surface in the end state.
fn is_of_end(metric: &str) -> bool {
    metric.starts_with("CD") && metric.split(' ').nth(1) == Some("end")
}

/// Mean and population standard deviation of the values present.
fn mean_std(values: &[Option<f64>]) -> (Option<f64>, Option<f64>) {
    let values: Vec<f64> = values.iter().flatten().copied().collect();
    let Some(m) = mean_of(&values) else { return (None, None) };
    let squared: Vec<f64> = values.iter().map(|v| (v - m) * (v - m)).collect();
    (Some(m), mean_of(&squared).map(f64::sqrt))
}

/// Index of the trial with the smallest value in most metrics. Ties are decided by the smallest value of the
/// metric with the largest variance, then of the next one; then by the order of the trials.
fn best_trial(columns: &[Vec<Option<f64>>], trials: usize) -> usize {
    let mut order: Vec<usize> = (0..columns.len()).collect();
    let variance: Vec<f64> = columns.iter().map(|c| mean_std(c).1.unwrap_or(0.0)).collect();
    // Metrics varying most between trials come first (docs/method.md 13.3).
    order.sort_by(|&a, &b| variance[b].total_cmp(&variance[a]));
    let least: Vec<f64> =
        columns.iter().map(|column| column.iter().flatten().copied().fold(f64::INFINITY, f64::min)).collect();
    // For each trial: number of smallest values, and in which metrics.
    let mut scores: Vec<(usize, Vec<bool>)> = Vec::with_capacity(trials);
    for trial in 0..trials {
        let attains: Vec<bool> = order.iter().map(|&m| columns[m][trial] == Some(least[m])).collect();
        scores.push((attains.iter().filter(|a| **a).count(), attains));
    }
    (0..trials).fold(0, |best, t| if scores[t] > scores[best] { t } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn best_trial_has_most_minima_and_ties_go_by_variance() {
        let columns = |rows: &[&[f64]]| {
            rows.iter().map(|r| r.iter().map(|v| Some(*v)).collect()).collect::<Vec<Vec<_>>>()
        };
        assert_eq!(best_trial(&columns(&[&[3.0, 1.0, 2.0], &[3.0, 1.0, 2.0], &[0.0, 1.0, 2.0]]), 3), 1);
        // One minimum each: the second metric varies most.
        assert_eq!(best_trial(&columns(&[&[1.0, 1.1], &[9.0, 2.0]]), 2), 1);
        assert_eq!(best_trial(&columns(&[&[1.0, 1.0]]), 2), 0);
        assert_eq!(best_trial(&[vec![None, Some(5.0)]], 2), 1, "a failed trial attains nothing");
    }

    #[test]
    fn surfaces_of_the_end_state_do_not_vote() {
        let all = ["Axis Ang (lid)", "CD-s start", "CD-m end (lid)", "CD-w end", "Part Motion (end)"];
        assert_eq!(all.map(is_of_end), [false, false, true, true, false]);
    }

    #[test]
    fn spread_is_over_trials_that_did_not_fail() {
        assert_eq!(mean_std(&[Some(1.0), None, Some(3.0)]), (Some(2.0), Some(1.0)));
        assert_eq!(mean_std(&[None]), (None, None));
    }
}
