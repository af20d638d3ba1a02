//! How the number of parts was found, for both forms of the report.

use serde::{Deserialize, Serialize};

use super::{
    number::{decimal, round_significant},
    page::table_row,
};
use articulate::EvidencePoint;

/// Significant digits of evidence.
const DIGITS: usize = 6;

/// How the number of parts was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PartCountReport {
    /// Requested number of parts; none if the evidence chose it.
    pub given: Option<usize>,
    /// Number of parts of the twin, the static one included.
    pub found: usize,
    /// Least evidence for a moving part, cells.
    pub least_evidence: f64,
    /// Evidence by number of parts, fewest first.
    pub curve: Vec<EvidencePointReport>,
}

/// Evidence for a number of parts, in cells of matches and sixths of cells of surface.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EvidencePointReport {
    /// Number of parts, the static one included.
    pub parts: usize,
    /// Sum over the motions of the evidence that each alone explains.
    pub evidence: f64,
    /// Evidence that the weakest motion alone explains.
    pub weakest: Option<f64>,
    /// Evidence that no motion explains.
    #[serde(default)]
    pub unexplained: f64,
}

impl EvidencePointReport {
    fn new(point: &EvidencePoint) -> Self {
        Self {
            parts: point.parts,
            evidence: round_significant(point.evidence, DIGITS),
            weakest: point.weakest.map(|w| round_significant(w, DIGITS)),
            unexplained: round_significant(point.unexplained, DIGITS),
        }
    }
}

impl PartCountReport {
    /// The report of a registration: the requested and the found number of parts, and the evidence by number
    /// of parts, most parts first.
    pub fn new(given: Option<usize>, found: usize, curve: &[EvidencePoint], least_evidence: f64) -> Self {
        // The search removes motions one by one; a table reads from few to many.
        let curve = curve.iter().rev().map(EvidencePointReport::new).collect();
        Self { given, found, least_evidence, curve }
    }

    /// Head and rows of a table: number of parts, evidence, weakest motion, unexplained rest. The chosen
    /// number is marked.
    pub(super) fn head_and_rows(&self) -> ([&'static str; 4], String) {
        let head = ["Parts", "Evidence of all motions", "Weakest motion", "Unexplained"];
        let mut rows = String::new();
        for p in &self.curve {
            let mark = if p.parts == self.found { " (the twin)" } else { "" };
            let weakest = p.weakest.map_or_else(|| "\u{2013}".to_owned(), |w| decimal(w, 1));
            let cells =
                [format!("{}{mark}", p.parts), decimal(p.evidence, 1), weakest, decimal(p.unexplained, 1)];
            rows.push_str(&table_row(&head, &cells));
        }
        (head, rows)
    }
}
