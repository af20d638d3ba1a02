//! Surface that no motion explains.

use crate::pair::{
    reprojection::{EXPLAINED, FREE},
    surface_pair::SurfacePair,
};
use geometry::Pose;

/// What a motion explains must have this share of all samples: less could not outweigh the cost of a part.
/// tuned: shared/bags
pub(crate) const LEAST_SHARE: f64 = 0.004;

/// Samples of each state that no motion explains, and those of them that moved (the first motion is the
/// static part's).
pub(crate) struct Unexplained {
    /// Samples that no motion takes onto a surface.
    pub open: [Vec<bool>; 2],
    /// Those of them whose place was seen empty in the other state.
    pub moved: [Vec<bool>; 2],
}

impl Unexplained {
    /// What `motions` leave.
    pub(crate) fn of(pair: &SurfacePair<'_>, motions: &[Pose]) -> Self {
        let both = [0, 1].map(|s| {
            let costs = pair.shape_costs(s, motions, None);
            let free = pair.free[1 - s].is_some();
            let rows = || costs.chunks_exact(motions.len());
            let open: Vec<bool> = rows().map(|row| row.iter().all(|c| *c >= EXPLAINED)).collect();
            // By the static part's motion, the first: its place in the other state was seen empty, so that it
            // moved and was not merely hidden.
            let left = |(row, open): (&[f32], &bool)| *open && (!free || row[0] >= FREE);
            let moved = rows().zip(&open).map(left).collect();
            (open, moved)
        });
        let [(open0, moved0), (open1, moved1)] = both;
        Self { open: [open0, open1], moved: [moved0, moved1] }
    }

    /// Whether a correspondence of a sample with one of the other state calls for a motion: both are open,
    /// and one of the two is where the other state saw nothing. Surface that doors hid in turn may look alike
    /// by chance.
    pub(crate) fn calls_for(&self, state: usize, sample: usize, partner: usize) -> bool {
        self.open[1 - state][partner] && (self.moved[state][sample] || self.moved[1 - state][partner])
    }
}
