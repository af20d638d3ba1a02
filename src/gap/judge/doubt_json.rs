//! A doubt in `report.json`.

use serde::Serialize;

use super::doubt::{Doubt, Looks};
use common::note::NoteCode;

/// A joint left without a diagnosis.
#[derive(Debug, Serialize)]
pub struct DoubtJson {
    joint: String,
    code: NoteCode,
    /// What the input looks like: together these have a weight of 0.95.
    looks: Vec<String>,
    /// Natural logarithm of the odds against the numbers as given.
    log_odds: f64,
    /// The twin's inertia as a multiple of the inertia shown by motion and efforts.
    inertia_ratio: f64,
    /// Share of the squared effort left unexplained, under the convention and as given.
    left: f64,
    left_as_given: f64,
    /// The joint showing the convention, if this one only does not contradict it.
    by: Option<String>,
    remedy: String,
}

impl DoubtJson {
    /// The report's entry for a doubt.
    #[must_use]
    pub fn of_doubt(doubt: &Doubt) -> Self {
        Self {
            joint: doubt.joint.clone(),
            code: doubt.note_code(),
            looks: doubt.looks.iter().map(Looks::in_words).collect(),
            log_odds: doubt.log_odds,
            inertia_ratio: doubt.inertia_ratio,
            left: doubt.left.0,
            left_as_given: doubt.left.1,
            by: doubt.by.clone(),
            remedy: doubt.remedy_text(),
        }
    }
}
