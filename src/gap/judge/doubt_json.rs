//! A doubt in `report.json`.

use serde::Serialize;

use super::doubt::{Doubt, Looks};
use common::note::NoteCode;

/// A joint without a diagnosis.
#[derive(Debug, Serialize)]
pub struct DoubtJson {
    joint: String,
    code: NoteCode,
    /// Appearances of the input: a class with a weight of 0.95 together.
    looks: Vec<String>,
    /// Natural logarithm of its odds against the numbers as given.
    log_odds: f64,
    /// The twin's inertia as a multiple of the inertia by motion and efforts.
    inertia_ratio: f64,
    /// Unexplained share of the squared effort, so and as given.
    left: f64,
    left_as_given: f64,
    /// The joint to show it, where this one does not contradict.
    by: Option<String>,
    remedy: String,
}

impl DoubtJson {
    /// Of a doubt.
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
