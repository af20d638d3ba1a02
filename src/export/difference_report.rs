//! Where the cameras saw something else than the twin shows, in shares of what was compared.

use serde::{Deserialize, Serialize};

use super::number::round_significant;
use crate::{
    note::{Note, NoteCode},
    surface::Difference,
};

/// Significant digits of a share.
const DIGITS: usize = 3;
/// A larger share is not explained.
const MOST: f64 = 0.1;

/// How many readings were compared, and how many of them the twin does not explain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Compared.
    pub compared: usize,
    /// Of these the object where the twin has nothing.
    pub lacks: usize,
    /// Of these the twin where the camera saw through.
    pub surplus: usize,
}

impl Tally {
    /// Counts a reading.
    pub fn count(&mut self, difference: Difference) {
        self.compared += usize::from(difference != Difference::Unread);
        self.lacks += usize::from(difference == Difference::Lacks);
        self.surplus += usize::from(difference == Difference::Surplus);
    }

    /// Adds what was counted elsewhere.
    pub fn add(&mut self, other: &Self) {
        self.compared += other.compared;
        self.lacks += other.lacks;
        self.surplus += other.surplus;
    }

    /// Share of the readings that the twin does not explain.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.of(self.lacks + self.surplus)
    }

    fn of(&self, count: usize) -> f64 {
        round_significant(count as f64 / self.compared.max(1) as f64, DIGITS)
    }
}

/// A state of the object, all views of it together.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StateDifference {
    /// The state.
    pub state: usize,
    /// Readings that were compared.
    pub readings: usize,
    /// Share of them that the twin does not explain.
    pub share: f64,
    /// Share of them that show the object where the twin has nothing.
    pub lacks: f64,
    /// Share of them that saw through where the twin is.
    pub surplus: f64,
    /// The same by view.
    pub views: Vec<NamedShare>,
    /// The same by link, of the readings where the twin shows it.
    pub links: Vec<NamedShare>,
}

/// A share of what has a name.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NamedShare {
    /// The name.
    pub name: String,
    /// The share.
    pub share: f64,
}

impl StateDifference {
    /// What is said where the twin differs by more than errors explain.
    #[must_use]
    pub fn warning(&self) -> Option<Note> {
        if self.share <= MOST {
            return None;
        }
        let [share, lacks, surplus] = [self.share, self.lacks, self.surplus].map(|s| 100.0 * s);
        let worst = self.links.iter().max_by(|a, b| a.share.total_cmp(&b.share));
        let worst =
            worst.map_or_else(String::new, |l| format!("; of {} it is {:.1} %", l.name, 100.0 * l.share));
        let text = format!(
            "state {}: {share:.1} % of what the cameras read of the object is not where the twin is ({lacks:.1} \
             % where it has nothing, {surplus:.1} % behind it){worst}",
            self.state
        );
        Some(Note::new(NoteCode::TwinDiffers, text))
    }

    /// Of what was counted in each view and on each link.
    #[must_use]
    pub fn new(state: usize, views: &[(String, Tally)], links: &[(String, Tally)]) -> Self {
        let mut all = Tally::default();
        views.iter().for_each(|(_, tally)| all.add(tally));
        let named = |of: &[(String, Tally)]| {
            of.iter().map(|(name, tally)| NamedShare { name: name.clone(), share: tally.share() }).collect()
        };
        Self {
            state,
            readings: all.compared,
            share: all.share(),
            lacks: all.of(all.lacks),
            surplus: all.of(all.surplus),
            views: named(views),
            links: named(links),
        }
    }
}
