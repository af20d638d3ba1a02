//! How the number of parts was found, for both reports.

use serde::{Deserialize, Serialize};

use super::{
    number::{decimal, round_significant},
    page::row,
};
use articulate::EvidencePoint;

/// Significant digits of evidence.
const DIGITS: usize = 6;

/// How the number of parts was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PartCountReport {
    /// Number of parts that was asked for; none where the evidence chose it.
    pub given: Option<usize>,
    /// Number of parts of the twin, the static one included.
    pub found: usize,
    /// Evidence that a moving part must bring, cells.
    pub least_evidence: f64,
    /// Evidence by number of parts, fewest first.
    pub curve: Vec<EvidencePointReport>,
}

/// Evidence for a number of parts, in cells of matches and sixths of cells of surface.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EvidencePointReport {
    /// Number of parts, the static one included.
    pub parts: usize,
    /// What the motions explain, each alone.
    pub evidence: f64,
    /// What the weakest motion alone explains.
    pub weakest: Option<f64>,
    /// What no motion explains.
    #[serde(default)]
    pub unexplained: f64,
}

impl PartCountReport {
    /// Of a registration that was asked for `given` parts, or for as many as there are, and found some on a
    /// `curve` of evidence, most parts first.
    #[must_use]
    pub fn new(given: Option<usize>, found: usize, curve: &[EvidencePoint], least_evidence: f64) -> Self {
        let point = |p: &EvidencePoint| EvidencePointReport {
            parts: p.parts,
            evidence: round_significant(p.evidence, DIGITS),
            weakest: p.weakest.map(|w| round_significant(w, DIGITS)),
            unexplained: round_significant(p.unexplained, DIGITS),
        };
        // The search removes motions one by one; a table reads from few to many.
        let curve = curve.iter().rev().map(point).collect();
        Self { given, found, least_evidence, curve }
    }

    /// Head and rows of a table: number of parts, evidence, weakest motion, what is left; the chosen one
    /// marked.
    pub(super) fn table(&self) -> ([&'static str; 4], String) {
        let head = ["Parts", "Evidence of all motions", "Weakest motion", "Unexplained"];
        let cells = |p: &EvidencePointReport| {
            let mark = if p.parts == self.found { " (the twin)" } else { "" };
            let weakest = p.weakest.map_or_else(|| "\u{2013}".to_owned(), |w| decimal(w, 1));
            [format!("{}{mark}", p.parts), decimal(p.evidence, 1), weakest, decimal(p.unexplained, 1)]
        };
        (head, self.curve.iter().map(|p| row(&head, &cells(p))).collect())
    }
}
