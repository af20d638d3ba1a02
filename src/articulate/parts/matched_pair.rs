//! Two states: their surfaces and the matches between them.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use crate::{
    observations::LiftedMatch,
    pair::{reprojection::EXPLAINED, surface_pair::SurfacePair},
    parts::config::RegisterConfig,
    propose::ransac::Gate,
    samples::spacing::{cell_of, occupied_cells},
};
use geometry::Pose;

/// What sets of motions are judged by.
pub(crate) struct MatchedPair<'a> {
    pub matches: &'a [LiftedMatch],
    /// Those of them that can speak for a motion.
    pub informative: Vec<LiftedMatch>,
    /// Longest side of the object, meters.
    pub extent_m: f64,
    pub gate: Gate,
    pub config: &'a RegisterConfig,
    pub surfaces: SurfacePair<'a>,
}

impl<'a> MatchedPair<'a> {
    /// For an object whose longest side is `extent_m`.
    pub(crate) fn new(
        matches: &'a [LiftedMatch],
        extent_m: f64,
        config: &'a RegisterConfig,
        surfaces: SurfacePair<'a>,
    ) -> Self {
        let gate = Gate::new(&config.ransac, extent_m);
        Self { matches, informative: informative(matches, &surfaces), extent_m, gate, config, surfaces }
    }

    /// The motion that every match follows.
    pub(crate) fn match_labels(&self, motions: &[Pose]) -> Vec<Option<u8>> {
        let one = |m: &LiftedMatch| {
            let supports = motions.iter().enumerate().map(|(k, t)| (self.gate.support(m, t), k));
            let (support, k) = supports.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
            (support > 0.0).then_some(k as u8)
        };
        self.matches.iter().map(one).collect()
    }

    /// The matches that moved and follow a motion.
    pub(crate) fn followers(&self, match_labels: &[Option<u8>], label: u8) -> Vec<LiftedMatch> {
        let follows = |(m, l): &(&LiftedMatch, &Option<u8>)| **l == Some(label) && self.gate.has_moved(m);
        self.matches.iter().zip(match_labels).filter(follows).map(|(m, _)| *m).collect()
    }

    /// Side of the cells in which support is counted, meters.
    pub(crate) fn cell_m(&self) -> f64 {
        self.config.ransac.cell * self.extent_m
    }

    /// Cells of the matches that follow each motion, every cell by the match that most prefers it to all
    /// other motions; the state with fewer decides.
    pub(crate) fn match_cells(&self, motions: &[Pose]) -> Vec<f64> {
        let cell_m = self.cell_m();
        let mut best: Vec<[BTreeMap<[i64; 3], f64>; 2]> =
            motions.iter().map(|_| Default::default()).collect();
        for m in self.informative.iter().filter(|m| self.gate.has_moved(m)) {
            // A match speaks for its motion by the support that no other motion gives it.
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
        let sum = |cells: &BTreeMap<[i64; 3], f64>| cells.values().sum::<f64>();
        // Many spots of one state that match a single one of the other are one spot.
        best.iter().map(|[a, b]| sum(a).min(sum(b))).collect()
    }

    /// Cells of the surface of both states.
    pub(crate) fn surface_cells(&self) -> usize {
        self.surfaces.samples.iter().map(|s| occupied_cells(&s.points, self.cell_m())).sum()
    }
}

/// The matches that can speak for a motion: not those between two places that both look in the other state as
/// they do in their own. Equal things in a row, such as keys, match each other where none has moved.
fn informative(matches: &[LiftedMatch], surfaces: &SurfacePair<'_>) -> Vec<LiftedMatch> {
    let costs = [0, 1].map(|s| surfaces.costs(s, &[Pose::identity()], None));
    let stands = |s: usize, p: &Point3<f64>| {
        // A match has no normal: a zero one is as far from all.
        surfaces.indices[s].nearest(p, &Vector3::zeros()).is_some_and(|i| costs[s][i] < EXPLAINED)
    };
    matches.iter().filter(|m| !(stands(0, &m.point0) && stands(1, &m.point1))).copied().collect()
}
