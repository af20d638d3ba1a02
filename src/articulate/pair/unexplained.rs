//! Surface that no motion explains.

use crate::pair::{
    reprojection::{EXPLAINED, FREE},
    surface_pair::SurfacePair,
};
use geometry::Pose;

/// Least share of all samples that a motion must explain: less could not outweigh the cost of a part.
/// tuned: shared/bags
pub(crate) const LEAST_SHARE: f64 = 0.004;

/// The unexplained samples of each state, and those among them that moved (the first motion is the static
/// part's).
pub(crate) struct Unexplained {
    /// Samples that no motion takes onto a surface.
    pub open: [Vec<bool>; 2],
    /// Those of them whose place was seen empty in the other state.
    pub moved: [Vec<bool>; 2],
}

impl Unexplained {
    /// The samples that `motions` leave unexplained.
    pub(crate) fn left_by_motions(pair: &SurfacePair<'_>, motions: &[Pose]) -> Self {
        let both = [0, 1].map(|s| {
            let costs = pair.shape_costs(s, motions, None);
            let free = pair.free[1 - s].is_some();
            let rows = costs.chunks_exact(motions.len());
            let open: Vec<bool> = rows.clone().map(|row| row.iter().all(|c| *c >= EXPLAINED)).collect();
            // Under the first motion, the static part's, its place in the other state was seen empty: it
            // moved and was not merely hidden.
            let moved = rows.zip(&open).map(|(row, open)| *open && (!free || row[0] >= FREE)).collect();
            (open, moved)
        });
        let [(open0, moved0), (open1, moved1)] = both;
        Self { open: [open0, open1], moved: [moved0, moved1] }
    }

    /// Whether a correspondence between a sample and one of the other state calls for a motion: both are
    /// open, and one of them is where the other state saw empty space. Surfaces hidden in turn, as by doors,
    /// may look alike by chance.
    pub(crate) fn calls_for(&self, state: usize, sample: usize, partner: usize) -> bool {
        self.open[1 - state][partner] && (self.moved[state][sample] || self.moved[1 - state][partner])
    }
}
