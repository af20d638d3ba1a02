//! Sets of fewer and fewer motions, and which of them stand. See docs/method.md 7.3.

use serde::{Deserialize, Serialize};

use super::score::LEAST_SCORE;

/// A set of motions with less than this share of a smaller set's evidence splits one of its parts: another
/// part would add to the sum, while a second motion of one part takes away most of that part's evidence.
/// tuned: shared/bags
const SPLIT: f64 = 0.8;
/// Share of the least evidence that a motion needs if it takes nothing from the others.
/// tuned: shared/bags
const ADDING: f64 = 0.6;
/// A part with this many times the least evidence is accepted even if the sum falls a little.
/// chosen: enough for two parts
const FIRM: f64 = 2.0;

/// The evidence for a number of parts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EvidencePoint {
    /// Number of parts, the static one included.
    pub parts: usize,
    /// Sum over all motions of the evidence that only one motion explains: cells of matches, and a sixth of
    /// the cells of surface.
    pub evidence: f64,
    /// Evidence that only the weakest motion explains; none where nothing moves.
    pub weakest: Option<f64>,
    /// Unexplained surface: a sixth of its cells, each weighted by the cost of its best motion.
    pub unexplained: f64,
}

/// Whether a set of motions stands: each has enough evidence for a part, and none splits a part.
pub(crate) fn is_standing(point: &EvidencePoint, curve: &[EvidencePoint]) -> bool {
    let is_enough = |w| w >= LEAST_SCORE || (w >= ADDING * LEAST_SCORE && adds_evidence(point, curve));
    point.weakest.is_none_or(is_enough) && !splits_a_part(point, curve, FIRM * LEAST_SCORE)
}

/// Whether a set of motions splits a part of a smaller set: two motions of one part explain the same, and
/// what each alone explains falls, as does the sum. A motion of another part adds to the sum, or has `firm`
/// evidence by itself.
fn splits_a_part(point: &EvidencePoint, curve: &[EvidencePoint], firm: f64) -> bool {
    let weakest = point.weakest.unwrap_or(f64::INFINITY);
    next_smaller(point, curve).is_some_and(|p| weakest < firm && point.evidence < p.evidence)
        || smaller_sets(point, curve).any(|p| point.evidence < SPLIT * p.evidence)
}

/// The sets of fewer motions.
fn smaller_sets<'a>(
    point: &EvidencePoint,
    curve: &'a [EvidencePoint],
) -> impl Iterator<Item = &'a EvidencePoint> {
    let parts = point.parts;
    curve.iter().filter(move |p| p.parts < parts)
}

/// The largest of these.
fn next_smaller<'a>(point: &EvidencePoint, curve: &'a [EvidencePoint]) -> Option<&'a EvidencePoint> {
    smaller_sets(point, curve).max_by_key(|p| p.parts)
}

/// Whether the weakest motion of a set takes next to nothing from the others (there are some): the next
/// smaller set explains less than this one by at least half its evidence. Wrong motions take their evidence
/// from the right ones.
fn adds_evidence(point: &EvidencePoint, curve: &[EvidencePoint]) -> bool {
    next_smaller(point, curve)
        .is_some_and(|p| p.parts > 1 && p.evidence + 0.5 * point.weakest.unwrap_or(0.0) <= point.evidence)
}

/// The evidence of a set from its motions' scores; the first is the static part's.
pub(crate) fn evidence_point(scores: &[f64]) -> EvidencePoint {
    let moving = &scores[1..];
    let weakest = moving.iter().copied().reduce(f64::min);
    EvidencePoint { parts: scores.len(), evidence: moving.iter().sum(), weakest, unexplained: 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_of_little_evidence_must_add_to_the_sum() {
        let point = |parts, evidence, weakest| EvidencePoint { parts, evidence, weakest, unexplained: 0.0 };
        let curve = [
            point(1, 0.0, None),
            point(2, 100.0, Some(100.0)),
            point(3, 150.0, Some(50.0)),
            point(4, 159.0, Some(10.0)),
        ];
        assert!(adds_evidence(&curve[3], &curve) && !adds_evidence(&point(4, 153.0, Some(10.0)), &curve));
        assert!(!adds_evidence(&point(2, 10.0, Some(10.0)), &curve), "nothing else is known to have moved");
    }

    #[test]
    fn a_second_motion_of_one_part_takes_its_evidence_away() {
        let point = |parts, evidence, weakest| EvidencePoint { parts, evidence, weakest, unexplained: 0.0 };
        let curve = [
            point(1, 0.0, None),
            point(2, 414.0, Some(414.0)),
            point(3, 64.0, Some(30.0)),
            point(4, 500.0, Some(60.0)),
            point(5, 495.0, Some(20.0)),
        ];
        let splits = |k: usize| splits_a_part(&curve[k], &curve, 35.0);
        assert!(splits(2) && splits(4));
        assert!(!splits(3) && !splits(1) && !splits(0));
    }

    #[test]
    fn a_set_stands_where_each_has_the_evidence_that_a_part_needs() {
        let point = |parts, evidence, weakest| EvidencePoint { parts, evidence, weakest, unexplained: 0.0 };
        let curve = [point(1, 0.0, None), point(2, 100.0, Some(100.0))];
        let stands = |evidence, weakest: f64| is_standing(&point(3, evidence, Some(weakest)), &curve);
        assert!(super::is_standing(&curve[0], &curve) && super::is_standing(&curve[1], &curve));
        // The least, or six tenths of it where half of that comes to the sum.
        assert!(stands(104.0, 14.0) && !stands(104.0, 13.9));
        assert!(stands(104.5, 8.5) && stands(104.25, 8.5) && !stands(104.2, 8.5) && !stands(104.2, 8.3));
        // Where the sum falls, twice the least is a part, unless a fifth of it is gone.
        assert!(stands(99.0, 28.0) && !stands(99.0, 27.9) && stands(100.0, 14.0));
        assert!(stands(80.0, 50.0) && !stands(79.9, 50.0));
        // Alone, a motion of less than the least adds to nothing.
        assert!(!super::is_standing(&point(2, 10.0, Some(10.0)), &curve[..1]));
    }

    #[test]
    fn the_evidence_of_motions_is_that_of_those_that_move() {
        let found = evidence_point(&[50.0, 3.0, 2.0, 4.0]);
        assert_eq!(found, EvidencePoint { parts: 4, evidence: 9.0, weakest: Some(2.0), unexplained: 0.0 });
        let rest = evidence_point(&[50.0]);
        assert_eq!(rest, EvidencePoint { parts: 1, evidence: 0.0, weakest: None, unexplained: 0.0 });
    }
}
