//! Two states: their surfaces and the matches between them.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use tracing::debug;

use crate::{
    observations::LiftedMatch,
    pair::surface_pair::SurfacePair,
    propose::ransac::{Gate, cell_side_m},
    samples::spacing::{cell_of, occupied_cells},
};
use geometry::Pose;

/// The observations from which sets of motions are judged.
pub(crate) struct MatchedPair<'a> {
    pub matches: &'a [LiftedMatch],
    /// The matches that can be evidence for a motion.
    pub informative: Vec<LiftedMatch>,
    /// Longest side of the object, meters.
    pub extent_m: f64,
    pub gate: Gate,
    pub surfaces: SurfacePair<'a>,
}

impl<'a> MatchedPair<'a> {
    /// The pair for an object with a longest side of `extent_m`.
    pub(crate) fn new(matches: &'a [LiftedMatch], extent_m: f64, surfaces: SurfacePair<'a>) -> Self {
        let gate = Gate::new(extent_m);
        let informative = informative_matches(matches, gate, &surfaces);
        debug!(matches = matches.len(), informative = informative.len(), "matches that can show a motion");
        Self { matches, informative, extent_m, gate, surfaces }
    }

    /// The motion that every match supports; `None` where it supports none.
    pub(crate) fn match_labels(&self, motions: &[Pose]) -> Vec<Option<u8>> {
        self.matches.iter().map(|m| self.match_label(m, motions)).collect()
    }

    /// The motion that a match supports most, the first of equal ones; `None` where it supports none.
    fn match_label(&self, m: &LiftedMatch, motions: &[Pose]) -> Option<u8> {
        let supports = motions.iter().enumerate().map(|(k, t)| (self.gate.support(m, t), k));
        let (support, k) = supports.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
        (support > 0.0).then_some(k as u8)
    }

    /// The matches that follow a motion and have moved.
    pub(crate) fn followers_of(&self, match_labels: &[Option<u8>], label: u8) -> Vec<LiftedMatch> {
        let labelled = self.matches.iter().zip(match_labels).filter(|(_, l)| **l == Some(label));
        labelled.map(|(m, _)| *m).filter(|m| self.gate.has_moved(m)).collect()
    }

    /// Side of the cells in which support is counted, meters.
    pub(crate) fn cell_m(&self) -> f64 {
        cell_side_m(self.extent_m)
    }

    /// Cells of the matches of each motion. A cell counts by the match that most prefers the motion over all
    /// others; the state with the smaller sum decides.
    pub(crate) fn match_cells(&self, motions: &[Pose]) -> Vec<f64> {
        let cell_m = self.cell_m();
        let mut best: Vec<[BTreeMap<[i64; 3], f64>; 2]> =
            motions.iter().map(|_| Default::default()).collect();
        for m in self.informative.iter().filter(|m| self.gate.has_moved(m)) {
            // The evidence of a match for its motion is its support beyond that for any other motion.
            let mut first = 0.0;
            let mut second = 0.0;
            let mut follows = 0;
            for (k, motion) in motions.iter().enumerate() {
                let support = self.gate.support(m, motion);
                if support > first {
                    (second, first, follows) = (first, support, k);
                } else {
                    second = f64::max(second, support);
                }
            }
            for (cells, point) in best[follows].iter_mut().zip([&m.point0, &m.point1]) {
                let value = cells.entry(cell_of(point, cell_m)).or_default();
                *value = value.max(first - second);
            }
        }
        // If many spots of one state match a single one of the other, they count as one.
        best.iter().map(|[a, b]| a.values().sum::<f64>().min(b.values().sum::<f64>())).collect()
    }

    /// Number of cells of the surface of both states.
    pub(crate) fn surface_cells(&self) -> usize {
        self.surfaces.samples.iter().map(|s| occupied_cells(&s.points, self.cell_m())).sum()
    }
}

/// The matches that can be evidence for a motion: not those between two unchanged places. Equal things in a
/// row, such as keys, match each other though none has moved.
fn informative_matches(matches: &[LiftedMatch], gate: Gate, surfaces: &SurfacePair<'_>) -> Vec<LiftedMatch> {
    let mut informative = matches.to_vec();
    informative.retain(|m| {
        // Features lie where colors change most, so a place is only as exact as the match.
        let around_m = gate.distance_m(m.sigma_m);
        // A match has no normal: the zero vector is equally far from all.
        let are_static = [(0, m.point0), (1, m.point1)].into_iter().all(|(s, p)| {
            let sample = surfaces.indices[s].nearest_sample(&p, &Vector3::zeros());
            sample.is_some_and(|i| surfaces.has_alike_nearby(s, i, around_m))
        });
        !are_static
    });
    informative
}
