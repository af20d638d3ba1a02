//! A doubt in `report.json`.

use serde::Serialize;

use super::doubt::{Doubt, Looks};
use common::note::NoteCode;

/// A joint that is not diagnosed.
#[derive(Debug, Serialize)]
pub struct DoubtJson {
    joint: String,
    code: NoteCode,
    /// What the input looks like: a class that has a weight of 0.95 together.
    looks: Vec<String>,
    /// Natural logarithm of its odds against numbers that are what they are taken for.
    log_odds: f64,
    /// The twin's inertia as a multiple of what motion and efforts show.
    inertia_ratio: f64,
    /// Share of the squared effort that is left unexplained, so and as given.
    left: f64,
    left_as_given: f64,
    /// The joint that shows it, where this one does not contradict.
    by: Option<String>,
    remedy: String,
}

impl DoubtJson {
    /// Of a doubt.
    #[must_use]
    pub fn of(doubt: &Doubt) -> Self {
        Self {
            joint: doubt.joint.clone(),
            code: doubt.code(),
            looks: doubt.looks.iter().map(Looks::words).collect(),
            log_odds: doubt.log_odds,
            inertia_ratio: doubt.inertia_ratio,
            left: doubt.left.0,
            left_as_given: doubt.left.1,
            by: doubt.by.clone(),
            remedy: doubt.remedy(),
        }
    }
}
