//! Differences between camera readings and the twin, as shares of the compared readings.

use serde::{Deserialize, Serialize};

use super::number::round_significant;
use common::note::{Note, NoteCode};
use surface::Difference;

/// Significant digits of a share.
const DIGITS: usize = 3;
/// Share, of a state or of a link's readings in it, above which there is a warning.
///
/// measured: docs/method.md 11.4, between right twins and twins with a joint off or a part left out
const MOST: f64 = 0.05;
/// Share of a state's readings below which no link gives a warning.
///
/// derived: a part explains at least as much (docs/method.md 7)
const LEAST: f64 = 0.004;

/// How many readings were compared, and how many of them the twin does not explain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Number of compared readings.
    pub compared: usize,
    /// Number of these that show the object where the twin has nothing.
    pub lacks: usize,
    /// Number of these that see through the twin.
    pub surplus: usize,
}

impl Tally {
    /// Counts a reading.
    pub fn count_reading(&mut self, difference: Difference) {
        self.compared += usize::from(difference != Difference::Unread);
        self.lacks += usize::from(difference == Difference::Lacks);
        self.surplus += usize::from(difference == Difference::Surplus);
    }

    /// Adds the counts of another tally.
    pub fn add_tally(&mut self, other: &Self) {
        self.compared += other.compared;
        self.lacks += other.lacks;
        self.surplus += other.surplus;
    }

    /// Share of the readings that the twin does not explain, from 0 to 1.
    pub fn unexplained_share(&self) -> f64 {
        self.share_of(self.lacks + self.surplus)
    }

    fn share_of(&self, count: usize) -> f64 {
        round_significant(count as f64 / self.compared.max(1) as f64, DIGITS)
    }
}

/// The differences in a state of the object, over all its views.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StateDifference {
    /// Index of the state.
    pub state: usize,
    /// Number of compared readings.
    pub readings: usize,
    /// Share of them that the twin does not explain.
    pub share: f64,
    /// Share of them that show the object where the twin has nothing.
    pub lacks: f64,
    /// Share of them that lie behind the twin's surface.
    pub surplus: f64,
    /// The unexplained share by view.
    pub views: Vec<NamedShare>,
    /// The unexplained share by link, among the readings where the twin shows the link.
    pub links: Vec<NamedShare>,
}

/// The unexplained share of a view or of a link.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NamedShare {
    /// The name.
    pub name: String,
    /// Number of compared readings.
    pub readings: usize,
    /// Share of them that the twin does not explain.
    pub share: f64,
}

impl StateDifference {
    /// A warning if the twin differs by more than errors explain.
    pub fn difference_warning(&self) -> Option<Note> {
        let least_readings = LEAST * self.readings as f64;
        let differing =
            self.links.iter().filter(|l| l.share > MOST && l.share * l.readings as f64 > least_readings);
        let worst = differing.max_by(|a, b| a.share.total_cmp(&b.share));
        if self.share <= MOST && worst.is_none() {
            return None;
        }
        let [share, lacks, surplus] = [self.share, self.lacks, self.surplus].map(|s| 100.0 * s);
        let worst =
            worst.map_or_else(String::new, |l| format!("; of {} it is {:.1} %", l.name, 100.0 * l.share));
        let text = format!(
            "state {}: {share:.1} % of what the cameras read is not where the twin is ({lacks:.1} % where it \
             has nothing, {surplus:.1} % behind it){worst}; report.html shows where",
            self.state
        );
        Some(Note::new(NoteCode::TwinDiffers, text))
    }

    /// The differences in a state, from the tallies of its views and of all links.
    pub fn new(state: usize, views: &[(String, Tally)], links: &[(String, Tally)]) -> Self {
        let mut all = Tally::default();
        views.iter().for_each(|(_, tally)| all.add_tally(tally));
        Self {
            state,
            readings: all.compared,
            share: all.unexplained_share(),
            lacks: all.share_of(all.lacks),
            surplus: all.share_of(all.surplus),
            views: named_shares(views),
            links: named_shares(links),
        }
    }
}

fn named_shares(tallies: &[(String, Tally)]) -> Vec<NamedShare> {
    let mut shares = Vec::with_capacity(tallies.len());
    for (name, tally) in tallies {
        shares.push(NamedShare {
            name: name.clone(),
            readings: tally.compared,
            share: tally.unexplained_share(),
        });
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tally(compared: usize, lacks: usize, surplus: usize) -> Tally {
        Tally { compared, lacks, surplus }
    }

    fn of(views: &[Tally], links: &[Tally]) -> StateDifference {
        let named =
            |of: &[Tally]| of.iter().enumerate().map(|(k, t)| (format!("n{k}"), *t)).collect::<Vec<_>>();
        StateDifference::new(1, &named(views), &named(links))
    }

    #[test]
    fn shares_are_of_all_views_together() {
        let found = of(&[tally(3000, 30, 0), tally(1000, 0, 10)], &[tally(2000, 20, 0)]);
        assert_eq!((found.share, found.lacks, found.surplus, found.readings), (0.01, 0.0075, 0.0025, 4000));
        assert_eq!((found.views[1].share, found.links[0].share), (0.01, 0.01));
        assert_eq!(found.difference_warning(), None);
        assert_eq!(of(&[Tally::default()], &[]).difference_warning(), None);
    }

    #[test]
    fn a_state_or_a_link_that_differs_much_is_a_warning() {
        let warned =
            |views: Tally, link: Tally| of(&[views], &[tally(5000, 0, 0), link]).difference_warning();
        let text = warned(tally(10_000, 700, 50), tally(0, 0, 0)).unwrap().text;
        assert!(text.starts_with("state 1: 7.5 % of what") && text.contains("(7.0 %"), "{text}");
        let text = warned(tally(10_000, 0, 200), tally(1000, 0, 200)).unwrap().text;
        assert!(text.ends_with("; of n1 it is 20.0 %; report.html shows where"), "{text}");
        // Of a link that is hardly seen much may differ.
        assert_eq!(warned(tally(10_000, 0, 20), tally(30, 0, 20)), None);
    }
}
